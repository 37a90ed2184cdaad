"""A URDF from write_urdf is the same robot as the original, for Pinocchio and for read_urdf."""

import itertools
import math
import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from peers.pinocchio_model import PinocchioModel
from peers.random_robots import inertial, numbers, random_states, random_urdf
from peers.real_robots import real_urdf
from scipy.spatial.transform import Rotation

from robot_dynamics import DescriptionError, Dynamics, Inertia
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.formats.urdf.writer import UNLIMITED, write_urdf
from robot_dynamics.model.joint import Joint, Limits, Mimic, Spring
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.placement import placement, roll_pitch_yaw
from robot_dynamics.model.robot import Frame, Link, Robot

TOLERANCE = 1e-12
FRAMES = pytest.mark.parametrize("minimal", [False, True], ids=["as read", "minimal frames"])
BASES = pytest.mark.parametrize("moving_base", [False, True], ids=["fixed", "moving"])


class WrittenModel(PinocchioModel):
    """Pinocchio's model of a written URDF; a moving base has the floating joint of the text itself."""

    def __init__(self, urdf, joints, moving_base):
        self.model = pin.buildModelFromXML(urdf)
        self.data = self.model.createData()
        self.base_size = 6 if moving_base else 0
        assert (self.model.joints[1].shortname() == "JointModelFreeFlyer") == moving_base
        self.joints = [self.model.joints[self.model.getJointId(name)] for name in joints]
        self.rows = np.array([*range(self.base_size), *(joint.idx_v for joint in self.joints)], dtype=int)
        assert sorted(self.rows) == list(range(self.model.nv))


def relative_error(actual, expected):
    return np.abs(actual - expected).max(initial=0) / (np.abs(expected).max(initial=0) or 1)


def check_in_pinocchio(urdf, moving_base, minimal, seed):
    """Inertia matrix, inverse dynamics with wrenches on links, and link poses are those of the original text."""
    robot = read_urdf(urdf, moving_base=moving_base)
    written = write_urdf(minimal_frames(robot) if minimal else robot)
    names = [joint.name for joint in robot.joints]
    assert [joint.name for joint in read_urdf(written).joints] == names
    original, actual = PinocchioModel(urdf, names, moving_base), WrittenModel(written, names, moving_base)
    states = random_states(robot, len(names), 1, seed)
    q, qd, (pose, twist) = states.q[0], states.qd[0], states.base_of(0)
    state = (q, qd, pose, twist, states.wrenches_of(0))
    assert relative_error(actual.inertia_matrix(q), original.inertia_matrix(q)) < TOLERANCE
    assert relative_error(actual.bias(*state), original.bias(*state)) < TOLERANCE
    for frame in robot.frames:
        expected = original.link_pose(frame.name, q, pose)
        np.testing.assert_allclose(actual.link_pose(frame.name, q, pose), expected, rtol=0, atol=TOLERANCE)


@FRAMES
@BASES
@pytest.mark.parametrize("name", ["panda", "ur5", "talos", "pr2", "tiago", "anymal_c"])
def test_urdf_of_a_real_robot_is_unchanged_for_pinocchio(name, moving_base, minimal):
    check_in_pinocchio(real_urdf(name), moving_base, minimal, seed=3)


@FRAMES
@BASES
@pytest.mark.parametrize("seed", range(40))
def test_urdf_of_a_random_tree_is_unchanged_for_pinocchio(seed, moving_base, minimal):
    check_in_pinocchio(random_urdf(seed), moving_base, minimal, seed)


@FRAMES
@pytest.mark.parametrize("misalignment", [1e-15, 1e-12, 1e-9, 3.7e-6, 1e-4, 1e-3])
def test_nearly_parallel_and_perpendicular_axes_keep_full_precision(misalignment, minimal):
    rng = np.random.default_rng(int(-math.log10(misalignment)))
    parts = [f'<link name="0">{inertial(rng)}</link>']
    for k in range(1, 9):
        angles = rng.choice([0, math.pi / 2, -math.pi / 2, math.pi], 3) + misalignment * rng.uniform(-1, 1, 3)
        where = f'xyz="{numbers(rng.uniform(-0.4, 0.4, 3))}" rpy="{numbers(angles)}"'
        parts.append(
            f'<link name="{k}">{inertial(rng)}</link><joint name="j{k}" type="continuous"><origin {where}/>'
            f'<parent link="{k - 1}"/><child link="{k}"/><axis xyz="{numbers(rng.permutation([0, 0, 1]))}"/></joint>'
        )
    check_in_pinocchio(f'<robot name="r">{"".join(parts)}</robot>', False, minimal, seed=1)


def check_reads_back(robot):
    """Assert that read_urdf returns the written robot, joints matched by name; return the result."""
    result = read_urdf(write_urdf(robot))
    assert result.name == robot.name and result.moving_base == robot.moving_base and result.base_link == robot.base_link
    assert set(result.joint_numbers) == set(robot.joint_numbers) and set(result.frames_by_name) >= {
        *robot.frames_by_name
    }
    for joint in robot.joints:
        read = result.joints[result.joint_numbers[joint.name]]
        kept = ("prismatic", "viscous_friction", "coulomb_friction", "mimic")
        assert [getattr(read, key) for key in kept] == [getattr(joint, key) for key in kept]
    dynamics, answers = Dynamics(robot), Dynamics(result)
    states = random_states(robot, len(dynamics.joint_names), 3, seed=4)
    order = [dynamics.joint_names.index(name) for name in answers.joint_names]
    for name in robot.frames_by_name:
        expected = dynamics.link_pose(name, states.q, base=states.base)
        read = answers.link_pose(name, states.q[:, order], base=states.base)
        np.testing.assert_allclose(read, expected, rtol=0, atol=TOLERANCE)
    inputs = {"base": states.base, "external_wrenches": states.wrenches}
    expected = dynamics.solve(states.q, states.qd, qdd=states.qdd, **inputs).efforts[:, order]
    read = answers.solve(states.q[:, order], states.qd[:, order], qdd=states.qdd[:, order], **inputs).efforts
    assert relative_error(read, expected) < TOLERANCE
    return result


def random_robot(seed, joints=9, antecedents=None):
    """Return a robot whose named frames are anywhere on their links, on axes and off them, with other frames fixed."""
    rng = np.random.default_rng(seed)

    def anywhere(scale=1.0):
        return placement(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), scale * rng.normal(size=3))

    links, moved = [Link("base", Inertia(1.0, (0, 0, 0.1), np.eye(3)))], []
    frames = [Frame("base", 0, np.eye(4)), Frame("world", 0, anywhere()), Frame("l1_joint", 0, anywhere())]
    for j in range(1, joints + 1):
        antecedent = int(rng.integers(j)) if antecedents is None else antecedents[j - 1]
        friction = rng.uniform(0, 1, 2) * rng.integers(0, 2, 2)
        moved.append(Joint(f"j{j}", antecedent, bool(rng.integers(2)), anywhere(), 0.0, *map(float, friction)))
        body = Inertia.about_centre_of_mass(rng.uniform(0.1, 9), np.diag(rng.uniform(0.4, 0.6, 3)), anywhere(0.3))
        links.append(Link(f"l{j}", body if rng.random() < 0.8 or j == joints else Inertia()))
        own = anywhere()
        if j % 3:  # else the origin is off the axis
            own[:2, 3] = 0
        frames += [Frame(f"l{j}", j, own), Frame(f"tool{j}", j, anywhere())]
    return Robot("robot", tuple(links), tuple(moved), tuple(frames), moving_base=bool(seed % 2))


@pytest.mark.parametrize("seed", range(12))
def test_named_frames_are_unchanged_by_write_and_read(seed):
    robot = random_robot(seed)
    check_reads_back(robot)
    check_reads_back(minimal_frames(robot))


def test_named_frame_off_its_axis_is_fixed_to_a_link_at_the_joint():
    robot = random_robot(1, joints=6, antecedents=[0, 1, 2, 3, 4, 5])
    joints = tuple(replace(joint, prismatic=joint.name == "j6") for joint in robot.joints)
    result = check_reads_back(replace(robot, joints=joints))
    # 3 is off its axis; so is 6, which slides
    assert [link.name for link in result.links] == ["base", "l1", "l2", "l3_joint", "l4", "l5", "l6"]
    taken = (*robot.frames, Frame("l3_joint", 2, np.eye(4)))
    result = check_reads_back(replace(robot, joints=joints, frames=taken))
    assert result.links[3].name == "l3_joint_2"


def test_order_of_joints_is_kept_where_branches_allow_it():
    assert list(check_reads_back(random_robot(3, 5, [0, 1, 1, 0, 4])).joint_numbers) == ["j1", "j2", "j3", "j4", "j5"]
    assert list(check_reads_back(random_robot(3, 4, [0, 0, 1, 2])).joint_numbers) == ["j1", "j3", "j2", "j4"]


def test_moving_base_has_a_floating_joint_from_an_empty_world():
    fixed, root = (etree.fromstring(write_urdf(random_robot(seed)).encode()) for seed in (2, 1))
    (floating,) = root.findall("joint[@type='floating']")
    world = floating.find("parent").get("link")
    assert world == "world_2" and floating.find("child").get("link") == "base"  # a frame is called world
    assert len(root.find(f"link[@name='{world}']")) == 0
    assert len([parent for parent in root.iter("parent") if parent.get("link") == world]) == 1
    assert not fixed.findall("joint[@type='floating']")


BASE = Frame("base", 0, np.eye(4))
KILOGRAM = Inertia(1.0)


def one_joint(name="j", link="tip", robot="robot", own=BASE.placement, body=KILOGRAM, **changes):
    joint = replace(Joint(name, 0, False, np.eye(4)), **changes)
    return Robot(robot, (Link("base", Inertia()), Link(link, body)), (joint,), (BASE, Frame(link, 1, own)))


@pytest.mark.parametrize(
    ("prismatic", "limits", "kind", "expected"),
    [
        (False, Limits(-1.5, 2, 3, 4), "revolute", Limits(-1.5, 2, 3, 4)),
        (False, Limits(lower=0.1), "revolute", Limits(0.1, UNLIMITED, UNLIMITED, UNLIMITED)),
        (False, Limits(), "continuous", Limits()),
        (False, Limits(velocity=3), "continuous", Limits(velocity=3, effort=UNLIMITED)),
        (True, Limits(), "prismatic", Limits(-UNLIMITED, UNLIMITED, UNLIMITED, UNLIMITED)),
        (True, Limits(0, 1e-3, effort=1e10), "prismatic", Limits(0, 1e-3, UNLIMITED, 1e10)),
    ],
)
def test_limits_read_back_and_pinocchio_reads_them_too(prismatic, limits, kind, expected):
    """Limits that URDF requires in place of infinite ones are read back as infinite."""
    text = write_urdf(one_joint(prismatic=prismatic, limits=limits))
    finite = {key: value for key, value in vars(limits).items() if abs(value) < UNLIMITED}
    assert f'<joint name="j" type="{kind}">' in text and read_urdf(text).joints[0].limits == Limits(**finite)
    model = pin.buildModelFromXML(text)
    if kind != "continuous":
        assert (model.lowerPositionLimit[0], model.upperPositionLimit[0]) == (expected.lower, expected.upper)
        assert (model.velocityLimit[0], model.effortLimit[0]) == (expected.velocity, expected.effort)


def test_mimic_and_friction_read_back():
    robot = random_robot(0, joints=3, antecedents=[0, 1, 2])
    follower = replace(robot.joints[0], mimic=Mimic("j3", -0.1, 1 / 3), viscous_friction=0.1, coulomb_friction=0.0)
    robot = replace(robot, joints=(follower, *robot.joints[1:]))
    assert check_reads_back(robot).mimic_relations[0] == (2, -0.1, 1 / 3)
    assert '<dynamics damping="0.1"/>' in write_urdf(robot)


def test_numbers_of_a_clean_robot_are_clean():
    turned = Rotation.from_euler("xyz", [0, 90, 0], degrees=True).as_matrix()
    robot = one_joint(own=placement(turned, (0, 0, 0.1 + 0.2)), body=Inertia(2.0, (0, 0, 1.0), np.eye(3)))
    root = etree.fromstring(write_urdf(robot).encode())
    joint, link = root.find("joint"), root.find("link[@name='tip']")
    assert joint.find("origin").attrib == {"xyz": "0 0 0.3", "rpy": "0 1.5707963267948966 0"}
    assert joint.find("axis").get("xyz") == "-1 0 0"
    assert link.find("inertial/origin").attrib == {"xyz": "-0.2 0 0", "rpy": "0 0 0"}
    moments = {"ixx": "1", "ixy": "0", "ixz": "0", "iyy": "0.5", "iyz": "0", "izz": "0.5"}
    assert link.find("inertial/inertia").attrib == moments
    assert root.find("link[@name='base']/inertial") is None


@FRAMES
def test_numbers_of_a_real_robot_come_back_digit_for_digit(minimal):
    robot = read_urdf(real_urdf("panda"))
    written = etree.fromstring(write_urdf(minimal_frames(robot) if minimal else robot).encode())
    for joint in etree.fromstring(real_urdf("panda").encode()).xpath("joint[@type='revolute']"):
        element = written.find(f"joint[@name='{joint.get('name')}']/origin")
        expected = [float(number) + 0.0 for number in joint.find("origin").get("xyz").split()]
        assert element.get("xyz") == " ".join(map(repr, expected)).replace(".0 ", " ").removesuffix(".0")


def test_quarter_turns_with_their_rounding_are_written_as_such():
    quarters = [[Rotation.from_euler(axis, k * math.pi / 2).as_matrix() for k in range(4)] for axis in "xyz"]
    for x, y, z in itertools.product(*quarters):
        robot = one_joint(own=placement(x @ y @ z))
        text, result = write_urdf(robot), read_urdf(write_urdf(robot))
        rpy = re.search('rpy="([^"]*)"/>\n    <parent', text)
        assert {*(rpy.group(1) if rpy else "0").split()} <= {"0", *map(repr, (math.pi, math.pi / 2, -math.pi / 2))}
        turned = result.joints[0].placement[:3, :3] @ result.frame("tip").placement[:3, :3]
        np.testing.assert_allclose(turned, np.round(x @ y @ z), rtol=0, atol=1e-15)


def test_names_that_are_added_differ_from_those_of_links_and_joints():
    root = etree.fromstring(write_urdf(one_joint("tip_joint", own=placement(None, (1, 0, 0)))).encode())
    assert [link.get("name") for link in root.findall("link")] == ["base", "tip_joint_2", "tip"]


LOSSES = {
    "rotor inertia": (one_joint(rotor_inertia=0.25), "joint 'j': rotor inertia 0.25 kg m²"),
    "spring": (one_joint(spring=Spring(50.0, 0.1, 2.0)), "joint 'j': spring of stiffness 50 N m/rad, rest 0.1 rad"),
    "viscous asymmetry": (
        one_joint(viscous_friction=2.0, viscous_asymmetry=-0.5),
        "asymmetry of viscous friction -0.5 N m s/rad",
    ),
    "Coulomb asymmetry": (
        one_joint(prismatic=True, coulomb_friction=2.0, coulomb_asymmetry=0.5),
        "joint 'j': asymmetry of Coulomb friction 0.5 N",
    ),
    "Stribeck": (
        one_joint(stribeck_friction=1.5, stribeck_velocity=0.1),
        "joint 'j': Stribeck friction 1.5 N m at 0.1 rad/s",
    ),
    "load": (one_joint(load_friction=0.15), "joint 'j': load-dependent friction 0.15"),
    "passive": (one_joint(actuated=False), "joint 'j': role passive"),
    "gravity": (replace(one_joint(), gravity=(0, 0, 9.81)), r"gravity \[0.0, 0.0, 9.81\] m/s²"),
    "massless": (one_joint(body=Inertia(0.0, (1, 0, 0), np.eye(3))), "link 'tip': first moments"),
    "nearly massless": (one_joint(body=Inertia(1e-17, (1, 0, 0), np.eye(3))), "mass of 1e-17 kg"),
}


@pytest.mark.parametrize("case", LOSSES)
def test_losses_of_a_urdf_are_refused_or_omitted_and_listed(case):
    robot, reason = LOSSES[case]
    with pytest.raises(DescriptionError, match=reason):
        write_urdf(robot)
    text = write_urdf(robot, lossy=True)
    (comment,) = etree.fromstring(text.encode()).xpath("preceding-sibling::comment()")
    assert re.search(reason, comment.text)
    left = read_urdf(text).links[1].inertia
    np.testing.assert_array_equal(left.second_moments, robot.links[1].inertia.second_moments)


def test_loop_is_listed_as_lost_and_its_cut_link_remains():
    robot = one_joint()
    cut = Joint("cut", 1, False, placement(None, (1, 0, 0)), actuated=False, initial_position=0.5)
    robot = replace(
        robot,
        links=(*robot.links, Link("cut_link", Inertia())),
        joints=(*robot.joints, cut),
        frames=(*robot.frames, Frame("cut_link", 2, np.eye(4))),
        loops=(Loop("cut", LoopEnd(2, np.eye(4)), LoopEnd(0, np.eye(4))),),
    )
    losses = "joint 'cut': role passive, initial position 0.5 rad; loop 'cut', which closes link 'cut_link' on"
    with pytest.raises(DescriptionError, match=f"URDF cannot represent {losses} link 'base'"):
        write_urdf(robot)
    text = write_urdf(robot, lossy=True)
    assert "loop 'cut', which closes" in text.split("<robot")[0]
    left = read_urdf(text)
    assert [link.name for link in left.links] == [link.name for link in robot.links] and not left.loops
    assert left.links[2].inertia.mass == 0


def test_long_list_of_losses_is_cut_in_the_error_and_complete_in_the_comment():
    robot = random_robot(0, joints=26)
    robot = replace(robot, joints=tuple(replace(joint, rotor_inertia=0.5, actuated=False) for joint in robot.joints))
    with pytest.raises(DescriptionError, match=r"j20': rotor inertia .*role passive; \.\.\. and 6 more\."):
        write_urdf(robot)
    assert "'j26': rotor inertia" in write_urdf(robot, lossy=True).split("<robot")[0]


ODD_NAMES = ["a\nb", "\ta", "a\r\n", " ", " a  b ", "a--b---", "<!DOCTYPE -->", "\"&amp;'", "🤖", "{j}", "tip_fixed"]
ANY_TEXT = st.text(st.characters(exclude_categories=["Cs", "Cc"], exclude_characters="\ufffe\uffff"), min_size=1)
NAMES = st.sampled_from([*ODD_NAMES, "$", "$x{(", "{$"]) | ANY_TEXT.filter(
    lambda name: "${" not in name and "$(" not in name
)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(NAMES, NAMES.filter(lambda name: name != "base"), NAMES)
def test_names_are_unchanged_by_write_and_read(joint, link, robot):
    named = one_joint(joint, link, robot, rotor_inertia=1.0, own=placement(None, (1, 0, 0)))
    result = read_urdf(write_urdf(named, lossy=True))
    assert (result.joints[0].name, result.name) == (joint, robot) and {link, "base"} < {*result.frames_by_name}


MOVED_BASE = Frame("base", 0, placement(None, (1, 0, 0)))
REFUSED = {
    "symbols": (one_joint(placement=np.eye(4).astype(object)), "joint 'j' has symbols"),
    "moved base": (replace(one_joint(), frames=(MOVED_BASE, Frame("tip", 1, np.eye(4)))), "frame 0"),
    "robot of no name": (one_joint(robot=None), "robot None: a text is needed"),
}
for name in ("", "a\0", "a\x1b[0m", "\ud800", "\uffff", "a\x0b", 7):
    REFUSED[f"joint {name!r}"] = one_joint(name=name), "joint .*(XML has no character|a text is needed)"
    REFUSED[f"link {name!r}"] = one_joint(link=name), "link .*(XML has no character|a text is needed)"
for name in ("${j}", "$(", "a$(arg b)"):
    REFUSED[f"joint {name!r}"] = one_joint(name=name), "joint .* begins an expression of xacro"
    REFUSED[f"link {name!r}"] = one_joint(link=name), "link .* begins an expression of xacro"


@pytest.mark.parametrize("case", REFUSED)
def test_robots_without_a_urdf_are_refused_even_if_lossy(case):
    robot, reason = REFUSED[case]
    with pytest.raises(DescriptionError, match=reason):
        write_urdf(robot, lossy=True)


RIGHT_ANGLES = st.sampled_from([0.0, math.pi / 2, -math.pi / 2, math.pi])
NEAR = st.sampled_from([0.0, 1e-16, -1e-15, 1e-13, -1e-10, 1e-8, 3.7e-6, -1e-4]) | st.floats(-math.pi, math.pi)
ANGLES = st.builds(float.__add__, RIGHT_ANGLES, NEAR)


@settings(max_examples=500, deadline=None)
@given(ANGLES, ANGLES, ANGLES)
def test_roll_pitch_yaw_is_exact_near_gimbal_lock_too(roll, pitch, yaw):
    rotation = Rotation.from_euler("xyz", [roll, pitch, yaw]).as_matrix()
    again = Rotation.from_euler("xyz", roll_pitch_yaw(rotation)).as_matrix()
    np.testing.assert_allclose(again, rotation, rtol=0, atol=2e-15)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(st.tuples(ANGLES, ANGLES, ANGLES), st.floats(1e-6, 1e6), st.floats(1e-9, 1e2), st.integers(0, 2**31))
def test_rotations_and_inertias_are_unchanged_by_write_and_read(angles, mass, length, seed):
    """Bodies of any mass and size, and point masses far from the frame, whose central inertia is rounding."""
    rng = np.random.default_rng(seed)
    spread = rng.choice([0.0, 1.0]) * np.diag(rng.uniform(0.4, 0.6, 3)) * mass * length**2
    body = Inertia.about_centre_of_mass(mass, spread, placement(None, length * rng.normal(size=3)))
    own = placement(Rotation.from_euler("xyz", angles).as_matrix(), length * rng.normal(size=3))
    result = read_urdf(write_urdf(one_joint(own=own, body=body)))  # off the axis: the body is on a link at frame j
    np.testing.assert_allclose(result.frame("tip").placement, own, rtol=0, atol=1e-14 * max(1, length))
    on_axis = read_urdf(write_urdf(one_joint(own=placement(own[:3, :3], (0, 0, own[2, 3])), body=body)))
    turn = on_axis.frame("tip").placement[:3, :3] @ own[:3, :3].T  # frame j as read is turned about z_j
    for robot, expected in ((result, body), (on_axis, body.transformed_by(placement(turn, (0, 0, -own[2, 3]))))):
        read = robot.links[1].inertia
        assert read.mass == mass and relative_error(read.first_moments, expected.first_moments) < TOLERANCE
        assert relative_error(read.second_moments, expected.second_moments) < TOLERANCE
