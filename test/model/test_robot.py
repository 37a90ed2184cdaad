"""The robot as data: lumping, frames, inertias that cannot be, joints that depend on others, payloads."""

import re
import time
from dataclasses import replace

import numpy as np
import pytest
from peers.random_robots import random_urdf

from robot_dynamics import DescriptionError, Dynamics, Inertia, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.joint import Limits, Mimic
from robot_dynamics.model.placement import invert_placement, placement, rotation_with_z_along
from robot_dynamics.model.robot import Frame


def arm(tip="", joint="", between=""):
    return f"""<robot name="arm">
      <link name="base"/>
      <link name="upper"><inertial><origin xyz="0.2 0 0"/><mass value="2"/>
        <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
      <link name="tip">{tip}</link>
      <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>{joint}
        <limit lower="-1" upper="2" effort="30" velocity="4"/></joint>
      <joint name="weld" type="fixed"><parent link="upper"/><child link="tip"/>
        <origin xyz="0.4 0 0" rpy="0 0 1.2"/></joint>
      {between}</robot>"""


def inertial(mass, ixx, iyy, izz):
    entries = f'ixx="{ixx}" ixy="0" ixz="0" iyy="{iyy}" iyz="0" izz="{izz}"'
    return f'<inertial><mass value="{mass}"/><inertia {entries}/></inertial>'


def random_inertia(rng):
    points, masses = rng.normal(size=(6, 3)), rng.uniform(0.1, 2, 6)
    return points, masses, point_masses(points, masses)


def point_masses(points, masses):
    """Return the inertia of point masses, from its definition."""
    second = sum(m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, points, strict=True))
    return Inertia(masses.sum(), masses @ points, second)


def test_inertia_in_another_frame_is_that_of_the_moved_points():
    rng = np.random.default_rng(0)
    for _ in range(20):
        points, masses, body = random_inertia(rng)
        frame = placement(rotation_with_z_along(rng.normal(size=3)), rng.normal(size=3))
        moved = point_masses(points @ frame[:3, :3].T + frame[:3, 3], masses)
        seen = body.transformed_by(frame)
        assert seen.mass == pytest.approx(moved.mass)
        np.testing.assert_allclose(seen.first_moments, moved.first_moments, atol=1e-12)
        np.testing.assert_allclose(seen.second_moments, moved.second_moments, atol=1e-11)
        assert body.find_inconsistencies() == [] and seen.find_inconsistencies() == []


def test_spatial_inertia_gives_the_kinetic_energy_of_the_points():
    points, masses, body = random_inertia(np.random.default_rng(1))
    twist = np.array([0.3, -1, 0.5, 0.7, 0.2, -0.4])
    velocities = twist[:3] + np.cross(twist[3:], points)
    energy = 0.5 * (masses * (velocities**2).sum(axis=1)).sum()
    assert 0.5 * twist @ body.spatial @ twist == pytest.approx(energy)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, -2, 0), (0, 0, -1), (0, 0, 3)])
def test_frames_along_axes_of_the_description_have_entries_zero_and_one_only(axis):
    rotation = rotation_with_z_along(axis)
    assert set(np.unique(np.abs(rotation))) == {0.0, 1.0}
    np.testing.assert_array_equal(rotation[:, 2], np.array(axis) / np.linalg.norm(axis))
    assert np.linalg.det(rotation) == pytest.approx(1)


def test_fixed_link_is_lumped_and_remains_a_frame():
    robot = read_urdf(arm(tip=inertial(0.5, 1e-3, 1e-3, 1e-3)))
    assert [link.name for link in robot.links] == ["base", "upper"]
    assert {frame.name for frame in robot.frames} == {"base", "upper", "tip"}
    assert robot.links[1].inertia.mass == 2.5
    # the joint turns about y: both masses by parallel axes
    assert Dynamics(robot).inertia_matrix([0.0])[0, 0] == pytest.approx(0.02 + 2 * 0.2**2 + 1e-3 + 0.5 * 0.4**2)


def test_limits_and_friction_are_read():
    robot = read_urdf(arm(joint='<dynamics damping="0.5" friction="0.2"/>'))
    (joint,) = robot.joints
    assert (joint.limits.lower, joint.limits.upper, joint.limits.velocity, joint.limits.effort) == (-1, 2, 4, 30)
    np.testing.assert_allclose(Dynamics(robot).friction([[2.0], [-2.0], [0.0]]), [[1.2], [-1.2], [0.0]])


def test_joint_without_limits_and_continuous_joint_are_unbounded():
    text = arm().replace('<limit lower="-1" upper="2" effort="30" velocity="4"/>', "")
    assert read_urdf(text).joints[0].limits.upper == np.inf
    assert read_urdf(arm().replace("revolute", "continuous")).joints[0].limits.upper == np.inf


def test_floating_root_makes_the_base_move_by_default():
    text = f"""<robot name="free"><link name="world"/><link name="body">{inertial(3, 1, 1, 1)}</link>
      <joint name="root" type="floating"><parent link="world"/><child link="body"/></joint></robot>"""
    robot = read_urdf(text)
    assert robot.moving_base and robot.base_link == "body" and robot.joints == ()
    assert robot.links[0].inertia.mass == 3
    assert not read_urdf(text, moving_base=False).moving_base
    assert read_urdf(arm(), moving_base=True).moving_base


def test_fixed_floating_base_stands_at_the_origin_of_its_joint():
    text = """<robot name="tilted"><link name="world"/><link name="body"/><link name="rod">{}</link>
      <joint name="root" type="{}"><parent link="world"/><child link="body"/>
        <origin xyz="0 0 1" rpy="1.2 0 0"/></joint>
      <joint name="hinge" type="continuous"><parent link="body"/><child link="rod"/>
        <axis xyz="0 0 1"/></joint></robot>"""
    rod = inertial(2, 1, 1, 1).replace("<mass", '<origin xyz="0.5 0 0"/><mass')
    held = Dynamics(read_urdf(text.format(rod, "floating"), moving_base=False))
    fixed = Dynamics(read_urdf(text.format(rod, "fixed")))
    assert held.robot.base_link == "world"
    np.testing.assert_array_equal(held.gravity([0.3]), fixed.gravity([0.3]))
    np.testing.assert_array_equal(held.link_pose("rod", [0.3]), fixed.link_pose("rod", [0.3]))
    assert abs(held.gravity([0.3])[0]) > 1


def test_base_inertia_counts_only_where_the_base_moves():
    text = arm().replace('<link name="base"/>', f'<link name="base">{inertial(7, -1, 1, 1)}</link>')
    fixed, moving = read_urdf(text), read_urdf(text, moving_base=True)
    assert fixed.links[0].inertia.mass == moving.links[0].inertia.mass == 7
    assert fixed.warnings == ()
    assert "base" in moving.warnings[0] and "positive definite" in moving.warnings[0]


@pytest.mark.parametrize(
    ("moments", "objection"), [((1, 1, 3), "triangle"), ((-0.5, 1, 1), "positive definite"), ((1, 1, 1.5), None)]
)
def test_impossible_inertia_causes_a_warning_and_is_refused_when_strict(moments, objection, caplog):
    text = arm().replace('ixx="0.01"', f'ixx="{moments[0]}"').replace('iyy="0.02"', f'iyy="{moments[1]}"')
    text = text.replace('izz="0.02"', f'izz="{moments[2]}"')
    robot = load_robot(text)
    if objection is None:
        assert robot.warnings == () and not caplog.records
        load_robot(text, strict=True)
    else:
        assert "'upper'" in caplog.text and objection in caplog.text
        with pytest.raises(DescriptionError, match=f"'upper'.*{objection}"):
            load_robot(text, strict=True)


def test_impossible_fixed_link_causes_no_warning_in_a_possible_body():
    assert read_urdf(arm(tip=inertial(0.1, 0, 0, 1e-3))).warnings == ()


def test_moving_link_without_mass_causes_a_warning():
    text = arm().replace('<mass value="2"/>', '<mass value="0"/>')
    text = text.replace('ixx="0.01"', 'ixx="0"').replace('iyy="0.02"', 'iyy="0"').replace('izz="0.02"', 'izz="0"')
    (warning,) = read_urdf(text).warnings  # no link that moves has a mass
    assert "none of its moving links has a mass" in warning and "robot-dynamics identify" in warning
    two = text.replace("</robot>", "").rstrip() + (
        '<link name="free"/><joint name="idle" type="continuous"><parent link="upper"/><child link="free"/></joint>'
        f'<link name="heavy">{inertial(1, 1, 1, 1)}</link>'
        '<joint name="hip" type="continuous"><parent link="base"/><child link="heavy"/></joint></robot>'
    )
    assert any("idle" in warning and "nothing with inertia" in warning for warning in read_urdf(two).warnings)


def test_joint_about_a_thin_rod_causes_a_warning():
    text = arm(between=mimicking(1, 0)).replace('<mimic joint="shoulder" multiplier="1" offset="0"/>', "")
    rod = text.replace(inertial(1, 1, 1, 1), inertial(1, 1, 1, 0))
    assert read_urdf(text).warnings == ()
    assert any("follower" in warning and "nothing with inertia" in warning for warning in read_urdf(rod).warnings)
    with pytest.raises(SingularModelError, match="follower"):
        Dynamics(read_urdf(rod)).direct([0, 0], [0, 0], [0, 0])


def test_massless_mimic_joint_causes_no_warning():
    text = arm(between=mimicking(1, 0)).replace(inertial(1, 1, 1, 1), "")
    assert read_urdf(text).warnings == ()
    assert np.isfinite(Dynamics(read_urdf(text)).direct([0], [0], [1])).all()


def test_moments_rounded_to_four_digits_cause_no_warning():
    assert Inertia(1, np.zeros(3), np.diag([0.0333, 0.0833, 0.1167])).find_inconsistencies() == []
    assert "triangle" in Inertia(1, np.zeros(3), np.diag([0.0333, 0.0833, 0.1177])).find_inconsistencies()[0]
    assert "positive" in Inertia(1, np.zeros(3), np.diag([1, 1, -1e-10])).find_inconsistencies()[0]


@pytest.mark.parametrize(
    "arguments",
    [
        ("a",),
        (1j,),
        (1, [0, 0]),
        (1, [0] * 3, [1, 1, 1]),
        (1, [0] * 3, [[1, 2], [3]]),
        (1, [0] * 3, np.triu(np.ones((3, 3)))),
    ],
)
def test_inertia_of_a_wrong_shape_is_refused(arguments):
    with pytest.raises(DescriptionError, match="of an inertia"):
        Inertia(*arguments)


def mimicking(multiplier, offset, of="shoulder"):
    return f"""<link name="finger">{inertial(1, 1, 1, 1)}</link>
      <joint name="follower" type="revolute"><parent link="tip"/><child link="finger"/><axis xyz="0 0 1"/>
        <mimic joint="{of}" multiplier="{multiplier}" offset="{offset}"/></joint>"""


def test_mimic_joint_is_not_a_coordinate():
    dynamics = Dynamics(read_urdf(arm(between=mimicking(-2, 0.5))))
    assert dynamics.joint_names == ("shoulder",) and dynamics.all_joint_names == ("shoulder", "follower")
    np.testing.assert_allclose(dynamics.expand_positions(np.array([0.3])), [0.3, -0.1])
    np.testing.assert_allclose(dynamics.expand_velocities(np.array([0.3])), [0.3, -0.6])
    np.testing.assert_allclose(dynamics.project_efforts(np.array([1.0, 2.0])), [-3.0])


def test_mimic_of_a_mimic_is_resolved():
    chain = mimicking(-2, 0.5) + mimicking(3, 1, of="follower").replace('"follower"', '"last"', 1).replace(
        '"finger"', '"claw"'
    ).replace('joint="last"', 'joint="follower"')
    dynamics = Dynamics(read_urdf(arm(between=chain)))
    np.testing.assert_allclose(dynamics.expand_positions(np.array([0.3])), [0.3, -0.1, 0.7])


@pytest.mark.parametrize(("of", "reason"), [("shoudler", "did you mean 'shoulder'"), ("follower", "mimics itself")])
def test_mimic_of_an_unknown_joint_is_refused(of, reason):
    with pytest.raises(DescriptionError, match=reason):
        read_urdf(arm(between=mimicking(1, 0, of=of)))


def test_payload_equals_a_link_welded_there():
    payload = Inertia(0.5, [0.05, 0.0, 0.02], np.diag([0.01, 0.02, 0.02]))
    loaded = read_urdf(arm()).with_payload("tip", payload)
    com = payload.first_moments / 0.5
    central = payload.second_moments - 0.5 * (com @ com * np.eye(3) - np.outer(com, com))
    entries = " ".join(
        f'{name}="{central[index]!r}"'.replace("np.float64(", "").replace(")", "")
        for name, index in {
            "ixx": (0, 0),
            "ixy": (0, 1),
            "ixz": (0, 2),
            "iyy": (1, 1),
            "iyz": (1, 2),
            "izz": (2, 2),
        }.items()
    )
    welded = read_urdf(
        arm(tip=f'<inertial><origin xyz="{com[0]} 0 {com[2]}"/><mass value="0.5"/><inertia {entries}/></inertial>')
    )
    np.testing.assert_allclose(loaded.links[1].inertia.spatial, welded.links[1].inertia.spatial, atol=1e-14)
    assert read_urdf(arm()).links[1].inertia.mass == 2  # the robot itself is as it was


@pytest.mark.parametrize(
    ("link", "payload", "reason"),
    [
        ("tipp", Inertia(1.0), "did you mean 'tip'"),
        ("tip", Inertia(-1.0), "mass -1"),
        ("tip", Inertia(np.nan), "finite"),
        ("tip", Inertia(1.0, [np.inf, 0, 0]), "finite"),
        ("tip", None, "an Inertia is needed"),
    ],
)
def test_impossible_payload_is_refused(link, payload, reason):
    with pytest.raises(InvalidInputError, match=reason):
        read_urdf(arm()).with_payload(link, payload)


@pytest.mark.parametrize(
    ("fields", "reason"),
    [
        ({"limits": Limits(upper=np.nan)}, "limits lower -inf, upper nan"),
        ({"limits": Limits(lower=np.inf)}, "mean nothing"),
        ({"limits": Limits(velocity=-np.inf)}, "mean nothing"),
        ({"placement": np.eye(3)}, r"its placement has shape \(3, 3\)"),
        ({"placement": np.diag([2.0, 1, 1, 1])}, "its placement is no matrix"),
        ({"placement": np.diag([-1.0, 1, 1, 1])}, "its placement is no matrix"),
    ],
)
def test_undefined_urdf_joint_is_refused(fields, reason):
    robot = load_robot("ur5e")
    joints = (replace(robot.joints[0], **fields), *robot.joints[1:])
    with pytest.raises(DescriptionError, match=reason):
        replace(robot, joints=joints)


@pytest.mark.slow
def test_many_joints_are_checked_quickly():
    """The time is not quadratic: a table of 2000 rows loads, with its warnings, in seconds."""
    rows = "".join(
        f"  - {{joint: j{k}, link: l{k}, mdh: {{d: 0.1}}, mass: 1, inertia: {{zz: 1}}}}\n" for k in range(2000)
    )
    start = time.monotonic()
    assert len(load_robot(f"robot: long\njoints:\n{rows}").warnings) > 0
    assert time.monotonic() - start < 60


def test_inconsistent_robot_is_refused():
    robot = read_urdf(random_urdf(4, joints=5))
    with pytest.raises(DescriptionError, match="one link more"):
        replace(robot, links=robot.links[:-1])
    with pytest.raises(DescriptionError, match="comes after"):
        replace(robot, joints=(replace(robot.joints[0], antecedent=3), *robot.joints[1:]))
    with pytest.raises(DescriptionError, match="more than once"):
        replace(robot, joints=(*robot.joints[:-1], replace(robot.joints[-1], name=robot.joints[0].name)))
    with pytest.raises(DescriptionError, match="gravity"):
        replace(robot, gravity=(0, 0, np.nan))
    with pytest.raises(DescriptionError, match="gravity"):
        replace(robot, gravity="down")
    with pytest.raises(DescriptionError, match="moving_base is 'fixed'"):
        replace(robot, moving_base="fixed")
    with pytest.raises(DescriptionError, match="is on link 99"):
        replace(robot, frames=(*robot.frames, Frame("x", 99, np.eye(4))))
    with pytest.raises(DescriptionError, match="has no frame"):
        replace(robot, frames=())


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"placement": np.full((4, 4), np.nan)}, "placement is not finite"),
        ({"rotor_inertia": -1.0}, "rotor_inertia -1 is negative"),
        ({"viscous_friction": np.inf}, "viscous_friction is not finite"),
        ({"mimic": Mimic("joint_1", np.nan)}, "multiplier is not finite"),
    ],
)
def test_impossible_joint_is_refused(changes, reason):
    robot = read_urdf(random_urdf(4, joints=5))
    with pytest.raises(DescriptionError, match=reason):
        replace(robot, joints=(*robot.joints[:-1], replace(robot.joints[-1], **changes)))


def test_inverse_placement():
    frame = placement(rotation_with_z_along([1, 2, 3]), [4, 5, 6])
    np.testing.assert_allclose(frame @ invert_placement(frame), np.eye(4), atol=1e-15)


@pytest.mark.parametrize(
    ("payload", "objection"),
    [
        (Inertia(2.0, [0, 0, 0.2]), r"not positive definite.*\[0.02, 0.0, 0.0, 0.02, 0.0, 0.0\] kg m²"),
        (Inertia(0.0, [0, 0, 0.2]), "mass is zero but moments are not"),
        (Inertia(1.0, [0, 0, 0], np.diag([1, 1, 3])), "triangle"),
    ],
)
def test_payload_that_cannot_exist_causes_a_warning_that_names_it(payload, objection, caplog):
    robot = load_robot("panda")
    loaded = robot.with_payload("panda_link8", payload)
    [record] = caplog.records
    assert re.search(f"payload on link 'panda_link8': .*{objection}", record.getMessage())
    assert loaded.warnings[0] in record.getMessage() and robot.warnings == ()
    with pytest.raises(DescriptionError, match="payload on link 'panda_link8'"):
        loaded.raise_on_warnings()


def test_point_mass_of_a_payload_warning_is_the_body_that_causes_none(caplog):
    xx, xy, xz, yy, yz, zz = 0.02, 0.0, 0.0, 0.02, 0.0, 0.0
    point = Inertia(2.0, [0, 0, 0.2], [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    about_centre = Inertia.about_centre_of_mass(2.0, np.zeros((3, 3)), [0, 0, 0.1])
    np.testing.assert_allclose(point.spatial, about_centre.spatial, atol=1e-15)
    for payload in (point, about_centre, Inertia(1.0), Inertia()):
        assert load_robot("panda").with_payload("panda_link8", payload).warnings == ()
    assert not caplog.records
