"""Locked joints: models of reduced robots equal those of the whole robot at rest there, and Pinocchio's reductions."""

import numpy as np
import pinocchio as pin
import pytest
from peers.pinocchio_model import PinocchioModel
from peers.reachable import reachable
from peers.real_robots import real_urdf

from robot_dynamics import (
    Base,
    DescriptionError,
    Dynamics,
    Inertia,
    InvalidInputError,
    SingularModelError,
    load_robot,
    shipped_robots,
    write_mdh_yaml,
    write_urdf,
)
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw

BODY = Inertia(0.5, [0.01, 0.02, 0.03], np.diag([0.01, 0.02, 0.015]))
FINGER = """<robot name="gripper"><link name="base"/>
  <link name="hand"><inertial><mass value="1"/>
    <inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="finger"/><link name="follower"/>
  <joint name="wrist" type="revolute"><parent link="base"/><child link="hand"/><axis xyz="0 1 0"/>
    <limit lower="-1" upper="1" effort="9" velocity="9"/></joint>
  <joint name="slide" type="prismatic"><parent link="hand"/><child link="finger"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 0.1"/><limit lower="0.01" upper="0.04" effort="9" velocity="9"/></joint>
  <joint name="mimic" type="prismatic"><parent link="hand"/><child link="follower"/><axis xyz="-1 0 0"/>
    <mimic joint="slide" multiplier="2" offset="0.001"/><limit lower="0" upper="0.1" effort="9" velocity="9"/></joint>
</robot>"""


@pytest.mark.parametrize(
    ("name", "pattern"), [("panda", "finger_joint1"), ("talos_reduced", "arm_"), ("tiago", "arm_|torso|gripper|hand")]
)
def test_reduced_tree_equals_that_of_pinocchio(name, pattern):
    urdf, rng = real_urdf(name), np.random.default_rng(1)
    robot = load_robot(urdf)
    independent = [robot.joints[k].name for k, (leader, _, _) in enumerate(robot.mimic_relations) if leader == k]
    for trial in range(3):
        if trial == 0:  # the named part of the robot
            names = [joint for joint in independent if any(part in joint for part in pattern.split("|"))]
        else:
            names = rng.choice(independent, rng.integers(1, len(independent)), replace=False).tolist()
        reduced = robot.with_locked_joints(dict(zip(names, rng.uniform(-1, 1, len(names)), strict=True)))
        dynamics = Dynamics(reduced)
        positions = {joint.name: joint.position for joint in reduced.locked_joints}
        locked_names = set(positions)
        joints = [joint.name for joint in robot.joints]
        whole = PinocchioModel(urdf, joints)
        reference = whole.position([positions.get(joint, 0.0) for joint in joints])
        model = pin.buildReducedModel(whole.model, [whole.model.getJointId(joint) for joint in locked_names], reference)
        peer = PinocchioModel.__new__(PinocchioModel)
        peer.model, peer.data, peer.base_size = model, model.createData(), 0
        peer.joints = [model.joints[model.getJointId(joint)] for joint in dynamics.all_joint_names]
        peer.rows = np.array([joint.idx_v for joint in peer.joints], dtype=int)
        G = dynamics.expand_velocities(np.eye(len(dynamics.joint_names))).T
        q, qd, qdd = rng.uniform(-1, 1, (3, len(dynamics.joint_names)))
        q_all = dynamics.expand_positions(q)
        A = G.T @ peer.inertia_matrix(q_all) @ G
        bias = G.T @ peer.bias(q_all, G @ qd)
        rigid = dynamics.inverse(q, qd, qdd) - dynamics.friction(qd)
        np.testing.assert_allclose(dynamics.inertia_matrix(q), A, rtol=1e-12, atol=1e-12 * np.abs(A).max())
        np.testing.assert_allclose(rigid, A @ qdd + bias, rtol=1e-12, atol=1e-12 * np.abs(A @ qdd + bias).max())
        accelerations = dynamics.direct(q, qd, rigid + dynamics.friction(qd))
        tolerance = 1e-15 * np.linalg.cond(A) * np.abs(qdd).max()
        np.testing.assert_allclose(accelerations, qdd, rtol=1e-12, atol=max(tolerance, 1e-12))


@pytest.mark.parametrize("name", sorted(set(shipped_robots()) - {"navaro"}))
def test_reduced_shipped_robot_equals_the_whole_one_at_rest_there(name):
    robot, rng = load_robot(name), np.random.default_rng(2)
    whole = Dynamics(robot)
    motors = [joint for joint in whole.joint_names if robot.joints[robot.joint_numbers[joint]].role != "passive"]
    locked = rng.choice(motors, rng.integers(1, max(len(motors), 2)), replace=False).tolist()
    q = whole.expand_positions(reachable(whole, 1, rng)[0] if robot.loops else rng.uniform(-1, 1, len(motors)))
    position = dict(zip(whole.all_joint_names, q, strict=True))
    reduced = Dynamics(robot.with_locked_joints({joint: position[joint] for joint in locked}))
    assert {*reduced.joint_names} == {*whole.joint_names} - {*locked}
    free = [whole.joint_names.index(joint) for joint in reduced.joint_names]
    qd = rng.normal(size=len(whole.joint_names))
    qd[np.setdiff1d(np.arange(len(qd)), free)] = 0.0
    q_reduced = np.array([position[joint] for joint in reduced.all_joint_names])
    state = {}
    if robot.moving_base:
        pose = placement(rotation_from_roll_pitch_yaw(0.3, -0.2, 1.0), [1.0, 2.0, 3.0])
        state = {"base": Base(pose=pose, twist=rng.normal(size=6))}
    rows = [*range(6), *(6 + k for k in free)] if robot.moving_base else free
    tip = robot.frames[-1].name
    for model, arguments in (("inertia_matrix", 0), ("gravity", 0), ("coriolis", 1)):
        base = {} if model == "inertia_matrix" else state
        of_whole = getattr(whole, model)(q, *([qd] * arguments), **base)
        of_reduced = getattr(reduced, model)(q_reduced, *([qd[free]] * arguments), **base)
        expected = of_whole[np.ix_(rows, rows)] if model == "inertia_matrix" else of_whole[rows]
        np.testing.assert_allclose(of_reduced, expected, rtol=1e-11, atol=1e-12 * max(np.abs(of_whole).max(), 1.0))
    poses = [dynamics.link_pose(tip, q_of, **state) for dynamics, q_of in ((reduced, q_reduced), (whole, q))]
    np.testing.assert_allclose(*poses, atol=1e-12)


def test_reduced_robot_is_written_and_read_back():
    robot = load_robot(real_urdf("panda"), locked={"panda_finger_joint1": 0.02, "panda_joint4": -1.5})
    q, qd, qdd = np.random.default_rng(3).uniform(-1, 1, (3, 6))
    expected = Dynamics(robot).inverse(q, qd, qdd)
    assert {frame.name for frame in robot.frames} >= {"panda_leftfinger", "panda_rightfinger", "panda_link4"}
    assert robot.visuals == load_robot(real_urdf("panda")).visuals or len(robot.visuals) > 0
    for text in (write_urdf(robot), write_mdh_yaml(robot)):
        again = Dynamics(load_robot(text))
        np.testing.assert_allclose(again.inverse(q, qd, qdd), expected, rtol=1e-10, atol=1e-10)
        pose = Dynamics(robot).link_pose("panda_rightfinger", q)
        np.testing.assert_allclose(again.link_pose("panda_rightfinger", q), pose, atol=1e-12)


def test_payload_on_a_locked_link_is_that_on_the_link_while_it_is_at_rest():
    robot = load_robot(FINGER)
    whole = Dynamics(robot.with_payload("finger", BODY))
    reduced = Dynamics(robot.with_locked_joints({"slide": 0.03}).with_payload("finger", BODY))
    np.testing.assert_allclose(
        reduced.inverse([0.4], [2.0], [3.0]), whole.inverse([0.4, 0.03], [2.0, 0], [3.0, 0])[:1], rtol=1e-12
    )


def test_mimic_joints_are_locked_with_the_joint_that_they_follow():
    robot = load_robot(FINGER, locked={"slide": 0.02})
    positions = {joint.name: joint.position for joint in robot.locked_joints}
    assert positions == {"slide": 0.02, "mimic": pytest.approx(0.041)}
    assert [joint.name for joint in robot.joints] == ["wrist"] and robot.warnings == ()
    assert load_robot(FINGER, locked={"slide": 0.02, "mimic": 0.041}).locked_joints[1].name == "mimic"


@pytest.mark.parametrize(
    ("locked", "message"),
    [
        ({"slid": 0}, "unknown moving joint 'slid': did you mean 'slide'"),
        ({"mimic": 0.041}, "lock 'slide' at 0.02, and 'mimic' is locked with it"),
        ({"slide": 0.02, "mimic": 0.05}, "'slide', which puts it at 0.041"),
        ({"slide": float("nan")}, "a finite number is needed"),
        ({"slide": "open"}, "a finite number is needed"),
        (["slide"], "{name: position} is needed"),
    ],
)
def test_wrong_locked_joints_are_refused_with_a_reason(locked, message):
    with pytest.raises(InvalidInputError, match=message):
        load_robot(FINGER, locked=locked)


def test_locked_joint_is_locked_once():
    with pytest.raises(InvalidInputError, match=r"'slide' is locked already, at 0\.02"):
        load_robot(FINGER, locked={"slide": 0.02}).with_locked_joints({"slide": 0.01})


def test_position_outside_the_limits_causes_a_warning(caplog):
    robot = load_robot(FINGER, locked={"slide": 0.2})
    assert any("'slide' is locked at 0.2, outside its limits 0.01 to 0.04" in warning for warning in robot.warnings)
    assert "outside its limits" in caplog.text
    with pytest.raises(DescriptionError, match="outside its limits"):
        load_robot(FINGER, locked={"slide": 0.2}, strict=True)


def test_massless_finger_is_locked_on_request():
    robot = load_robot(FINGER)
    with pytest.raises(SingularModelError, match="lock_massless"):
        Dynamics(robot).direct([0.1, 0.02], [0, 0], [0, 0])
    reduced = load_robot(FINGER, lock_massless=True)
    assert [(joint.name, joint.position) for joint in reduced.locked_joints] == [
        ("slide", 0.01),
        ("mimic", pytest.approx(0.021)),
    ]
    assert any("'slide' moves nothing with inertia: it is locked at 0.01" in warning for warning in reduced.warnings)
    whole = Dynamics(robot).inverse([0.3, 0.03], [1.0, 0.0], [2.0, 0.0])
    dynamics = Dynamics(reduced)
    np.testing.assert_allclose(dynamics.inverse([0.3], [1.0], [2.0]), whole[:1])
    np.testing.assert_allclose(dynamics.direct([0.3], [1.0], whole[:1]), [2.0])
    assert load_robot("panda", lock_massless=True).locked_joints == ()


def test_passive_joints_and_coordinates_of_platforms_are_not_locked():
    with pytest.raises(DescriptionError, match=r"'rocker' cannot be locked.*Lock these instead: 'crank'"):
        load_robot("four_bar", locked={"rocker": 1.0})
    with pytest.raises(DescriptionError, match="coordinate of platform 'platform'"):
        load_robot("gough_stewart", locked={"platform_x": 0.0})
    with pytest.raises(DescriptionError, match="'crank_1' is flexible, and link 'ground'"):
        load_robot("navaro", locked={"crank_1": 0.0})


def test_loop_of_locked_joints_is_left_out_where_it_closes():
    robot = load_robot("four_bar")
    dynamics = Dynamics(robot)
    positions = dict(zip(dynamics.all_joint_names, dynamics.initial_joint_positions, strict=True))
    locked = robot.with_locked_joints(positions)
    assert locked.loops == () and locked.joints == ()
    with pytest.raises(DescriptionError, match="does not close: its ends are"):
        robot.with_locked_joints({**positions, "crank": positions["crank"] + 0.01})


def test_locked_leg_leaves_the_platform_one_coordinate_less():
    robot = load_robot("gough_stewart", locked={"leg_1": load_robot("gough_stewart").joints[8].initial_position})
    dynamics = Dynamics(robot)
    assert len(dynamics.joint_names) == 5 and robot.platform is not None
    with pytest.raises(DescriptionError, match="mobility 5"):
        _ = dynamics.platform
