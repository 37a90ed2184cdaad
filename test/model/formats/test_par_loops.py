"""Closed loops in SYMORO+ .par: closure of published robots, and round trips through the format."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from peers.described_robots import robots

from robot_dynamics import DescriptionError, Spring
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.par.reader import read_par
from robot_dynamics.model.formats.par.writer import find_losses, write_par
from robot_dynamics.model.joint import Limits
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh

SAMPLES = Path(__file__).parents[3].parent / "shared" / "data" / "par"

# a parallelogram, a loop that is welded, and a prismatic one, whose frame k+B is placed in that of the loop before
LOOPS = """(* Robotname = 'loops' *)
NL = 4
NJ = 7
NF = 10
Type = 2
ant = {0,1,0,3,4,2,1,2,3,8}
sigma = {0,0,0,0,0,2,1,2,2,2}
b = {0,0,0,0,0,0,0,0,0,0}
d = {0,d,0,d,d,0,0,d,0.3,0.1}
r = {0,0,0,0,0,0,r7,0,0,0}
gamma = {0,0,0,0,0,0,0,0,0,0}
alpha = {0,0,0,0,0,pi/3,pi/2,0,0,0}
mu = {1,0,1,0,0,0,0,0,0,0}
theta = {th1,th2,th3,th4,th5,0,0,0,0,0}
M = {1,2,3,4}
eta = {0,0,0,0,1,0,0}
k = {0,0,0,0,30,0,0}
"""


def placements(robot, positions):
    """Return the frames (4, 4) of the links in frame 0, by their definition; positions: {name of a joint: variable}."""
    placed = [np.eye(4)]
    for joint in robot.joints:
        variable = {"r" if joint.prismatic else "theta": positions[joint.name]}
        placed.append(placed[joint.antecedent] @ joint.placement @ placement_from_mdh(MDHParameters(**variable)))
    return placed


def gaps(robot, positions):
    """Return the pose of frame k+B in frame k minus the identity (4, 4), for each loop."""
    placed = placements(robot, positions)
    ends = [[placed[end.link] @ end.placement for end in loop.ends] for loop in robot.loops]
    return [np.linalg.inv(moved) @ closed_on - np.eye(4) for moved, closed_on in ends]


def sample(name, **lengths):
    path = SAMPLES / f"{name}.par"
    if not path.exists():
        pytest.skip(f"the published descriptions are not beside this checkout: {path} is not there")
    text = path.read_bytes()
    names = re.findall(rb"\b(?:XX|XY|XZ|YY|YZ|ZZ|MX|MY|MZ|M|IA|FV|FS)\d+\b", text)
    values = {name.decode(): 0.1 + 0.01 * k for k, name in enumerate(names)}
    return read_par(text, source=name, values=values | {"G3": -9.81} | lengths)


def test_parallelogram_of_the_sr400_closes_as_its_geometry_requires():
    """Opposite bars stay parallel: bar 8 as link 2, bar 7 as the lever d8 on link 3, a quarter of a turn before it."""
    robot = sample("SR400", d2=0.2, d3=0.5, d4=0.1, d8=0.3, r4=0.4)
    assert [joint.role for joint in robot.joints] == [
        *("actuated", "actuated", "passive", "actuated", "actuated", "actuated", "actuated", "passive", "passive")
    ]
    assert [(loop.name, loop.moved.link, loop.closed_on.link) for loop in robot.loops] == [("joint_9", 9, 3)]
    for q2, q7 in np.random.default_rng(0).uniform(-3, 3, (10, 2)):
        closed = {2: q2, 7: q7, 3: q7 - q2 - math.pi / 2, 8: q2 - q7, 9: q7 - q2}
        (gap,) = gaps(robot, {f"joint_{j}": closed.get(j, 0.3) for j in range(1, 10)})
        np.testing.assert_allclose(gap, 0, atol=1e-12)
    (gap,) = gaps(robot, {f"joint_{j}": closed.get(j, 0.3) + 0.1 * (j == 8) for j in range(1, 10)})
    assert np.abs(gap).max() > 0.01


def test_rhombus_of_the_test_loop_closes_as_its_geometry_requires():
    robot = sample("testLoop", d=0.5)
    for q1, q2 in np.random.default_rng(1).uniform(-3, 3, (10, 2)):
        positions = {"joint_1": q1, "joint_2": q2, "joint_3": q1 + q2, "joint_4": -q2, "joint_5": q2}
        np.testing.assert_allclose(gaps(robot, positions), 0, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "lengths", "motors", "ends"),
    [
        (
            "AKR3000",
            {"D3": 1, "D4": 1.2, "D7": 0.4, "RL8": 0.9, "D13": 0.3, "D14": 0.2, "gam13": 0.1, "gam14": 0.7},
            {1, 5, 6, 8, 9, 10},
            [(11, 7), (12, 2)],
        ),
        ("TwoLoops", {"d12": 0.3, "g12": 0.4, "d3": 0.5, "d4": 0.6, "d7": 0.2}, {1, 2, 3, 5}, [(9, 8), (10, 8)]),
    ],
)
def test_loops_of_published_robots_match_their_tables(name, lengths, motors, ends):
    robot = sample(name, **lengths)
    assert {number for number, joint in enumerate(robot.joints, start=1) if joint.actuated} == motors
    assert [(loop.moved.link, loop.closed_on.link) for loop in robot.loops] == ends
    assert list(cut_joints(robot).values()) == [len(robot.joints) - 2, len(robot.joints) - 1]
    assert not any(np.any(robot.links[loop.moved.link].inertia.spatial) for loop in robot.loops)


def test_closing_frame_may_be_placed_in_that_of_another_loop():
    robot = sample("TwoLoops", d12=0.3, g12=0.4, d3=0.5, d4=0.6, d7=0.2)
    first, second = robot.loops
    np.testing.assert_array_equal(first.closed_on.placement, second.closed_on.placement)  # row 12 is at row 11
    np.testing.assert_allclose(
        first.closed_on.placement, placement_from_mdh(MDHParameters(gamma=0.4 + math.pi / 2, d=0.2)), atol=1e-15
    )


def test_rows_after_the_links_are_loops():
    robot = read_par(LOOPS, values={"d": 0.5})
    names = [("joint_5", 5, 2), ("loop_6", 2, 3), ("joint_7", 6, 2)]
    assert [(loop.name, loop.moved.link, loop.closed_on.link) for loop in robot.loops] == names
    assert [joint.role for joint in robot.joints] == [
        *("actuated", "passive", "actuated", "passive", "elastic", "passive")
    ]
    assert robot.joints[4].spring == Spring(30) and robot.joints[5].prismatic
    np.testing.assert_allclose(
        robot.loops[1].moved.placement, placement_from_mdh(MDHParameters(alpha=math.pi / 3)), atol=1e-15
    )
    np.testing.assert_allclose(robot.loops[2].closed_on.placement, placement_from_mdh(MDHParameters(d=0.6)), atol=1e-15)
    assert robot.frame("frame_10").link == 2 and robot.frame("link_7").link == 6
    passive = read_par(LOOPS.replace("mu = {1,0,1", "mu = {0,0,0"), values={"d": 0.5})  # nothing drives it: it is said
    assert {joint.role for joint in passive.joints} == {"passive", "elastic"}


BAD = {
    "motor at a cut": (
        "mu = {1,0,1,0,0",
        "mu = {1,0,1,0,1",
        "line 13: mu of row 5 is 1, but a loop is cut there.*cut the",
    ),
    "no mu": (
        "mu = {1,0,1,0,0,0,0,0,0,0}\n",
        "",
        "par: mu missing: a robot with loops needs it to distinguish actuated joints",
    ),
    "no d": ("d = {0,d,0,d,d,0,0,d,0.3,0.1}\n", "", "par: d missing: the table of the frames needs ant,"),
    "too few frames": (
        "{0,1,0,3,4,2,1,2,3,8}",
        "{0,1,0,3,4,2,1}",
        "line 6: ant has 7 entries: it needs NF = 10.*3 close",
    ),
    "links as many as joints": ("M = {1,2,3,4}", "M = {1,2,3,4,5,6,7}", "line 15: M has 7 entries: it needs NL = 4"),
    "too few joints": ("eta = {0,0,0,0,1,0,0}", "eta = {0,0,0,0}", "line 16: eta has 4 entries: it needs NJ = 7"),
    "frames": (
        "NF = 10",
        "NF = 9",
        "line 4: NF = 9: NF = 2 NJ - NL = 10 is needed .*two for each of 3 cut joints.*omit",
    ),
    "joints": (
        "NJ = 7",
        "NJ = 3",
        "line 3: NJ = 3 joints cannot move NL = 4 links: NJ = NL in a tree, and one joint more",
    ),
    "more than a description has": ("NJ = 7", "NJ = 1900", "line 3: NJ = 1900: the maximum is 2000 frames"),
    "frame k+B that moves": (
        "0,2,1,2,2,2}",
        "0,2,1,0,2,2}",
        "line 7: sigma of row 8 is '0': 2 .fixed., as it closes.*5",
    ),
    "frame below": ("{0,1,0,3,4,2,1,2,3,8}", "{0,1,0,3,4,2,1,9,3,8}", "line 6: ant of row 8 is '9': 0 to 7"),
    "one link": (
        "{0,1,0,3,4,2,1,2,3,8}",
        "{0,1,0,3,4,2,1,5,3,8}",
        "line 6: rows 5 and 8, which must coincide, are on",
    ),
    "names of loops": (
        "NL = 4",
        "(* Loops = 'a', 'b' *)\nNL = 4",
        "line 2: the comment Loops = has 2 names: there are 3",
    ),
    "loop twice": ("NL = 4", "(* Loops = 'a', 'b', 'a' *)\nNL = 4", "par: loop 'a' is defined more than once"),
    "no stiffness": ("k = {0,0,0,0,30,0,0}\n", "", "line 16: row 5 is elastic, but the list k is missing"),
}


@pytest.mark.parametrize("name", BAD)
def test_malformed_par_is_refused_with_line_and_remedy(name):
    wrong, right, message = BAD[name]
    text = LOOPS.replace(wrong, right)
    assert text != LOOPS
    with pytest.raises(DescriptionError) as raised:
        read_par(text, values={"d": 0.5})
    assert re.search(message, str(raised.value), re.DOTALL), str(raised.value)


def same(actual, expected):
    assert [link.name for link in actual.links] == [link.name for link in expected.links]
    assert [loop.name for loop in actual.loops] == [loop.name for loop in expected.loops]
    assert actual.frames_by_name.keys() == expected.frames_by_name.keys()
    for joint, read in zip(expected.joints, actual.joints, strict=True):
        np.testing.assert_allclose(read.placement, joint.placement, rtol=0, atol=1e-12)
        assert (read.name, read.antecedent, read.role) == (joint.name, joint.antecedent, joint.role)
        for key in ("rotor_inertia", "viscous_friction", "coulomb_friction"):
            assert getattr(read, key) == pytest.approx(getattr(joint, key), rel=1e-15)
    for loop, read in zip(expected.loops, actual.loops, strict=True):
        for end, again in zip(loop.ends, read.ends, strict=True):
            assert again.link == end.link
            np.testing.assert_allclose(again.placement, end.placement, rtol=0, atol=1e-12)
    for frame in expected.frames:
        again = actual.frames_by_name[frame.name]
        assert again.link == frame.link
        np.testing.assert_allclose(again.placement, frame.placement, rtol=0, atol=1e-12)


def sayable(robot):
    """Return the robot without the parts that a .par cannot represent."""
    joints = []
    for joint in robot.joints:
        driven = joint.actuated and joint.mimic is None
        spring = None if driven or joint.spring is None else Spring(joint.spring.stiffness)
        changes = {"mimic": None, "actuated": driven, "spring": spring, "limits": Limits(), "initial_position": 0.0}
        changes |= {"viscous_asymmetry": 0.0, "coulomb_asymmetry": 0.0, "stribeck_friction": 0.0}
        joints.append(replace(joint, **changes))
    return replace(robot, joints=tuple(joints), loops=tuple(loop for loop in robot.loops if not loop.is_spherical))


@pytest.mark.slow
@settings(deadline=None, max_examples=200)
@given(robots(st.from_regex("[a-z]{1,3}", fullmatch=True)))
def test_robots_with_loops_are_unchanged_by_write_and_read(robot):
    robot = sayable(robot)
    assume(not find_losses(robot))
    same(read_par(write_par(robot)), robot)


def test_loops_are_unchanged_by_conversion_to_a_table_and_back():
    robot = read_par(LOOPS, values={"d": 0.5})
    table = write_mdh_yaml(robot)
    assert (
        table.count("joint: joint_5\n    link: link_5\n    moved:") == 1 and "joint: loop_6\n    type: fixed" in table
    )
    again = read_mdh_yaml(table)
    same(again, robot)
    text = write_par(again)
    assert "\nNL = 4\nNJ = 7\nNF = 10\nType = 2\n" in text and "(* Loops = 'joint_5', 'loop_6', 'joint_7' *)" in text
    same(read_par(text), robot)


def test_a_frame_at_the_end_of_a_loop_but_for_rounding_needs_no_row():
    robot = read_par(LOOPS, values={"d": 0.5})
    (index,) = [index for index, frame in enumerate(robot.frames) if frame.name == "frame_6"]
    frames = list(robot.frames)
    turned = frames[index].placement.copy()
    turned[:3, :3] = np.nextafter(turned[:3, :3], 2.0)
    frames[index] = replace(frames[index], placement=turned)
    assert not np.array_equal(turned, robot.frames[index].placement)
    assert "\nNL = 4\nNJ = 7\nNF = 10\n" in write_par(replace(robot, frames=tuple(frames)))


def test_cut_joint_with_friction_is_written_as_a_joint_of_the_tree_and_its_loop_as_a_weld():
    robot = read_par(LOOPS, values={"d": 0.5})
    *joints, last = robot.joints
    robot = replace(robot, joints=(*joints, replace(last, viscous_friction=0.5)))
    text = write_par(robot)
    assert "\nNL = 6\nNJ = 9\nNF = 12\n" in text and not find_losses(robot)
    same(read_par(text), robot)


def test_spherical_loop_is_listed_as_lost():
    robot = read_par(LOOPS, values={"d": 0.5})
    first, *rest = robot.loops
    robot = replace(robot, loops=(first, *(replace(loop, is_spherical=True) for loop in rest)))
    with pytest.raises(
        DescriptionError, match="'loop_6' is cut at a ball joint; loop 'joint_7' is cut at a ball joint"
    ):
        write_par(robot)
    text = write_par(robot, lossy=True)
    assert "(* Lost: loop 'loop_6' is cut at a ball joint *)" in text
    assert [loop.name for loop in read_par(text).loops] == ["joint_5"]


def test_initial_position_is_listed_as_lost():
    robot = read_par(LOOPS, values={"d": 0.5})
    robot = replace(robot, joints=(replace(robot.joints[0], initial_position=0.5), *robot.joints[1:]))
    with pytest.raises(DescriptionError, match="joint 'joint_1' has an initial position"):
        write_par(robot)
