"""Parallel modules in series: each platform in coordinates of its stand, all platforms together and each alone, against
closed forms, the first solution, multipliers on maximal coordinates and Pinocchio."""

import numpy as np
import pytest
from peers.first_solution import attached, seed_of_attached
from peers.maximal_coordinates import MaximalCoordinates
from peers.pinocchio_loops import PinocchioLoops
from peers.planar_stack import planar_stack
from peers.platform_states import random_states
from scipy.spatial.transform import Rotation

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.parallel.pose_map import pose_map

COUNT = {"hexapod_stack": 250, "planar_stack": 1000}
DYNAMICS = {name: Dynamics(load_robot(text)) for name, text in
            (("hexapod_stack", "hexapod_stack"), ("planar_stack", planar_stack()))}  # fmt: skip
STATES = {name: random_states(dynamics, COUNT[name], np.random.default_rng(0)) for name, dynamics in DYNAMICS.items()}
HYBRIDS = tuple(DYNAMICS)


def first_states(name, count=None):
    """Return dynamics, and poses, twists, accelerations and other joints of the first states."""
    states = STATES[name]
    cut = ({link: values[:count] for link, values in part.items()} for part in states[:3])
    return DYNAMICS[name], *cut, tuple(values[:count] for values in states.other_joints)


def independent(dynamics):
    return [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]


@pytest.mark.slow
@pytest.mark.parametrize("name", HYBRIDS)
def test_pose_is_relative_to_the_frame_on_which_the_platform_stands(name):
    dynamics, poses, _, _, other_joints = first_states(name)
    q = dynamics.platform.joint_positions(poses, other_joints=other_joints)
    for link, platform in zip(dynamics.robot.platform_links, dynamics.robot.platforms, strict=True):
        stand = np.eye(4) if platform.base is None else dynamics.link_pose(platform.base, q)
        np.testing.assert_allclose(dynamics.link_pose(link, q), stand @ poses[link], atol=1e-11)


def test_legs_of_both_hexapods_have_the_distance_between_their_joints():
    dynamics, poses, *_ = first_states("hexapod_stack")
    q = dynamics.platform.joint_positions(poses)
    around = np.radians(np.arange(3) * 120)
    base = np.sort(np.concatenate([around - np.radians(2.5), around + np.radians(2.5)]))
    plate = np.sort(np.concatenate([around - np.radians(50), around + np.radians(50)]))
    for link, size in (("lower", 1), ("upper", 1 / 3)):
        numbers = [dynamics.robot.joint_numbers[f"leg_{link}_{k}"] for k in range(1, 7)]
        leg_vectors = [(poses[link] @ [size * np.cos(above), size * np.sin(above), 0, 1])[:, :3]
                - 3 * size * np.array([np.cos(below), np.sin(below), 0])
                for below, above in zip(base, plate, strict=True)]  # fmt: skip
        # copies go round by 120°, 240°; these are sorted by angles from -180° on
        lengths = np.sort(np.linalg.norm(leg_vectors, axis=-1).T, axis=1)
        np.testing.assert_allclose(np.sort(q[:, numbers], axis=1), lengths, rtol=1e-13)


@pytest.mark.slow
@pytest.mark.parametrize("name", HYBRIDS)
def test_direct_geometry_inverts_inverse_geometry(name):
    dynamics, poses, _, _, other_joints = first_states(name)
    q = dynamics.platform.joint_positions(poses, other_joints=other_joints)
    actual = dynamics.platform.pose(q[:, independent(dynamics)])
    for link, pose in poses.items():
        np.testing.assert_allclose(actual[link], pose, atol=1e-10)


@pytest.mark.slow
@pytest.mark.parametrize("name", HYBRIDS)
def test_direct_model_inverts_the_inverse_model(name):
    dynamics, poses, twists, accelerations, other_joints = first_states(name)
    assert (
        dynamics.platform.condition_number(dynamics.platform.joint_positions(poses, other_joints=other_joints)).max()
        < 1e4
    )
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    result = dynamics.platform.solve(poses, twists, efforts=efforts, other_joints=other_joints)
    actual, rates = dynamics.platform.acceleration(result.motion), dynamics.platform.twist(result.motion)
    for link, expected in accelerations.items():
        assert np.abs(actual[link] - expected).max() < 1e-9
        assert np.abs(rates[link] - twists[link]).max() < 1e-10
    numbers = [dynamics.robot.joint_numbers[joint] for joint in dynamics.platform.other_joint_names]
    np.testing.assert_allclose(result.motion.accelerations[:, numbers], other_joints[2], atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "legs"), [("hexapod_stack", (0, 9)), ("planar_stack", (3, 2))])
def test_second_solution_agrees_with_the_first(name, legs):
    """Each platform on one of its legs, loops through all others: all states, to 1e-10 of the efforts."""
    dynamics, poses, twists, accelerations, other_joints = first_states(name)
    robot, first = dynamics.robot, Dynamics(attached(dynamics.robot, *legs))
    q, qd, qdd = dynamics.platform.joint_motion(poses, twists, accelerations, other_joints=other_joints)
    n = [robot.joint_numbers[joint] for joint in first.joint_names]
    actual = first.inverse(seed_of_attached(dynamics, first, q, *legs), qd[:, n], qdd[:, n])
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    efforts = efforts[:, [dynamics.joint_names.index(joint) for joint in first.joint_names]]
    assert np.abs(actual - efforts).max() < 1e-10 * np.abs(efforts).max()


@pytest.mark.slow
@pytest.mark.parametrize(("name", "count"), [("hexapod_stack", 10), ("planar_stack", 50)])
def test_both_models_agree_with_multipliers_and_pinocchio(name, count):
    dynamics, poses, twists, accelerations, other_joints = first_states(name, count)
    maximal, pinocchio, n = MaximalCoordinates(dynamics.robot), PinocchioLoops(dynamics.robot), independent(dynamics)
    q, qd, qdd = dynamics.platform.joint_motion(poses, twists, accelerations, other_joints=other_joints)
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    prescribed = np.full(q.shape, np.nan)
    prescribed[:, n] = qdd[:, n]
    for k in range(count):
        expected = maximal.inverse(q[k], qd[k], prescribed[k])
        assert np.abs(expected.efforts[n] - efforts[k]).max() < 1e-8 * np.abs(efforts[k]).max()
        assert np.abs(expected.accelerations - qdd[k]).max() < 1e-8 * np.abs(qdd[k]).max()
    for k in range(3):
        actual = pinocchio.inverse(q[k], qd[k], prescribed[k]).efforts[n]
        assert np.abs(actual - efforts[k]).max() < 1e-6 * np.abs(efforts[k]).max()


@pytest.mark.slow
@pytest.mark.parametrize("name", HYBRIDS)
def test_single_platform_takes_the_motors_of_the_other_as_joints(name):
    dynamics, poses, twists, accelerations, other_joints = first_states(name, 20)
    q, qd, qdd = dynamics.platform.joint_motion(poses, twists, accelerations, other_joints=other_joints)
    efforts = dynamics.platform.inverse(poses, twists, accelerations, other_joints=other_joints)
    assert dynamics.platforms.keys() == {"lower", "upper"}
    for link, single in dynamics.platforms.items():
        numbers = [dynamics.robot.joint_numbers[joint] for joint in single.other_joint_names]
        other_motion = (q[:, numbers], qd[:, numbers], qdd[:, numbers])
        assert len(numbers) == len(dynamics.joint_names) - len(single.free)
        np.testing.assert_allclose(single.joint_positions(poses[link], other_joints=other_motion), q, atol=1e-10)
        actual = single.inverse(poses[link], twists[link], accelerations[link], other_joints=other_motion)
        assert np.abs(actual - efforts).max() < 1e-9 * np.abs(efforts).max()
        back = single.direct(poses[link], twists[link], efforts, other_joints=other_motion)
        np.testing.assert_allclose(back, accelerations[link], atol=1e-8)
        np.testing.assert_allclose(single.pose(q), poses[link], atol=1e-12)
        seeded = single.joint_positions(poses[link], seed=q)  # the seed has positions of the other joints too
        np.testing.assert_allclose(seeded, q, atol=1e-10)


def test_jacobians_map_motor_rates_to_the_relative_twist():
    dynamics, poses, twists, *_ = first_states("hexapod_stack", 50)
    q, qd, _ = dynamics.platform.joint_motion(poses, twists)
    actual = dynamics.platform.jacobian(q)
    for link, twist in twists.items():
        rates = qd[:, independent(dynamics), None]
        np.testing.assert_allclose((actual[link] @ rates)[..., 0], twist, atol=1e-10)
    assert np.abs(actual["upper"][..., :6]).max() < 1e-12  # the lower module does not move it relative to its stand


@pytest.mark.slow
def test_weight_on_the_upper_platform_loads_both_modules():
    """Virtual work: wrench w on the upper platform, efforts -Jᵀ w of its absolute twist, by differences of poses."""
    dynamics, poses, *_ = first_states("hexapod_stack", 1)
    pose = {link: values[0] for link, values in poses.items()}
    wrench = np.array([30.0, -20, -100, 5, 8, -3])
    q = dynamics.platform.joint_positions(pose)
    change = dynamics.platform.inverse(pose, external_wrenches={"upper": wrench}) - dynamics.platform.inverse(pose)
    n, h, upper_pose = independent(dynamics), 1e-6, dynamics.link_pose("upper", q)
    for k, number in enumerate(n):
        steps = []
        for side in (1, -1):
            displaced = q.copy()
            displaced[number] += side * h
            steps.append(np.linalg.inv(upper_pose) @ dynamics.link_pose("upper", displaced))
        rotations = [Rotation.from_matrix(step[:3, :3]).as_rotvec() for step in steps]
        twist = np.concatenate([steps[0][:3, 3] - steps[1][:3, 3], rotations[0] - rotations[1]]) / (2 * h)
        assert change[k] == pytest.approx(-twist @ wrench, rel=1e-6, abs=1e-5)


@pytest.mark.slow
def test_invalid_platform_arguments_are_refused():
    dynamics, poses, twists, *_ = first_states("hexapod_stack", 2)
    platform = dynamics.platform
    with pytest.raises(InvalidInputError, match="pose of platforms lower, upper: a mapping by these names is needed"):
        platform.inverse(poses["upper"])
    with pytest.raises(InvalidInputError, match="pose of platform 'upper' missing"):
        platform.inverse({"lower": poses["lower"]})
    with pytest.raises(InvalidInputError, match="unknown platform 'uper': did you mean 'upper'"):
        platform.inverse({**poses, "uper": poses["upper"]})
    with pytest.raises(InvalidInputError, match="twist of platform 'lower'"):
        platform.inverse(poses, {**twists, "lower": np.zeros(5)})
    with pytest.raises(InvalidInputError, match="give acceleration or efforts"):
        platform.solve(poses, twists)
    with pytest.raises(InvalidInputError, match=r"has 2 platforms \(lower, upper\): name one of them"):
        _ = dynamics.robot.platform
    with pytest.raises(InvalidInputError, match="positions of other joints has shape"):
        dynamics.platforms["upper"].joint_positions(poses["upper"], other_joints=[np.zeros(5)])
    with pytest.raises(InvalidInputError, match="unknown platform 'foo': known are lower, upper"):
        dynamics.platforms["foo"]
    with pytest.raises(InvalidInputError, match="a map is of one alone"):
        pose_map(dynamics, {"x": np.zeros(2)})
    dynamics, poses, *_ = first_states("planar_stack", 2)
    far = np.zeros((4, 4))
    far[0, 3] = 3.0
    with pytest.raises(SingularModelError, match=r"loop 'wrist_upper_\d' does not close"):
        dynamics.platform.joint_positions({**poses, "upper": poses["upper"] + far})
