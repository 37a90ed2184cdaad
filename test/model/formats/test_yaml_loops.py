"""Loops in MDH tables: reading, writing, and errors with their position."""

import math

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Spring
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.joint import Limits
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw

FOUR_BAR = """\
robot: four_bar
parameters: {l: 0.5}
base: {link: ground}
joints:
  - {joint: crank, link: input, mdh: {alpha: pi/2}, mass: 1, initial_position: pi/3}
  - {joint: coupling, link: coupler, mdh: {d: 0.2}, role: passive, mass: 1}
  - {link: pin, type: fixed, mdh: {d: l, r: 0.01}}
  - {joint: rocker, link: output, antecedent: ground, mdh: {alpha: pi/2, d: l}, role: passive, mass: 1}
loops:
  - joint: knee
    type: revolute
    moved: {antecedent: pin, mdh: {alpha: 0.3, d: 0.1}}
    closed_on: {antecedent: output, xyz: [0.2, 0, 0.01], rpy: [0.3, 0, 0]}
    role: elastic
    spring: {stiffness: 3, rest: 0.1}
    viscous_friction: 0.2
    coulomb_friction: 0.4
    limits: {lower: -1, upper: 1}
    initial_position: -pi/3
"""


def test_cut_joint_is_a_joint_of_the_tree_that_moves_a_link_without_inertia():
    robot = read_mdh_yaml(FOUR_BAR)
    (loop,) = robot.loops
    assert (loop.name, loop.is_spherical, loop.moved.link, loop.closed_on.link) == ("knee", False, 4, 3)
    assert [link.name for link in robot.links] == ["ground", "input", "coupler", "output", "knee_link"]
    assert not np.any(robot.links[4].inertia.spatial) and robot.frame("knee_link").link == 4
    np.testing.assert_array_equal(loop.moved.placement, np.eye(4))
    turned = placement(rotation_from_roll_pitch_yaw(0.3, 0, 0), [0.2, 0, 0.01])
    np.testing.assert_allclose(loop.closed_on.placement, turned, atol=1e-15)
    knee = robot.joints[3]
    assert (knee.name, knee.antecedent, knee.prismatic, knee.role) == ("knee", 2, False, "elastic")
    expected = placement_from_mdh(MDHParameters(d=0.5, r=0.01)) @ placement_from_mdh(MDHParameters(alpha=0.3, d=0.1))
    np.testing.assert_allclose(knee.placement, expected, atol=1e-15)
    assert knee.spring == Spring(3, 0.1) and knee.limits == Limits(-1, 1)
    assert (knee.viscous_friction, knee.coulomb_friction) == (0.2, 0.4)
    assert [joint.initial_position for joint in robot.joints] == [math.pi / 3, 0, 0, -math.pi / 3]


@pytest.mark.parametrize(("kind", "ball"), [("fixed", False), ("spherical", True)])
def test_weld_and_spherical_loop_add_no_joint(kind, ball):
    text = FOUR_BAR[: FOUR_BAR.index("    role: elastic")].replace("revolute", kind)
    robot = read_mdh_yaml(text)
    (loop,) = robot.loops
    assert len(robot.joints) == 3 and loop.is_spherical == ball and loop.moved.link == 2
    expected = placement_from_mdh(MDHParameters(d=0.5, r=0.01)) @ placement_from_mdh(MDHParameters(alpha=0.3, d=0.1))
    np.testing.assert_allclose(loop.moved.placement, expected, atol=1e-15)


def test_name_of_the_cut_link_is_explicit_or_unique():
    taken = FOUR_BAR.replace("link: pin,", "link: knee_link,").replace("antecedent: pin,", "antecedent: knee_link,")
    assert read_mdh_yaml(taken).links[4].name == "knee_link_2"
    framed = FOUR_BAR + "frames:\n  - {frame: knee_link, link: input}\n"
    assert read_mdh_yaml(framed).links[4].name == "knee_link_2"
    named = FOUR_BAR.replace("type: revolute", "link: no") + "frames:\n  - {frame: tip, link: no, xyz: [1, 0, 0]}\n"
    robot = read_mdh_yaml(named)
    assert robot.links[4].name == "no" and robot.frame("tip").link == 4


def test_loop_may_end_on_an_earlier_cut_link_and_mimic_joint_may_follow_a_cut_joint():
    text = FOUR_BAR.replace("antecedent: ground, mdh: {alpha: pi/2, d: l}, role: passive", "mimic: {joint: knee}")
    text += "  - {joint: second, moved: {antecedent: knee_link}, closed_on: {antecedent: ground}, type: prismatic}\n"
    robot = read_mdh_yaml(text)
    assert robot.joints[4].antecedent == 4 and robot.joints[4].prismatic and robot.joints[2].mimic.joint == "knee"
    assert cut_joints(robot) == {1: 4}  # the first carries another joint now
    again = read_mdh_yaml(write_mdh_yaml(robot))
    assert [joint.name for joint in again.joints] == [joint.name for joint in robot.joints]


def test_cut_joint_is_written_as_a_loop_and_other_joints_as_welded_rows():
    robot = read_mdh_yaml(FOUR_BAR)
    text = write_mdh_yaml(robot)
    assert "type: fixed" not in text and "joint: knee\n    link: knee_link\n    moved: {antecedent: coupler" in text
    heavy = robot.with_payload("knee_link", robot.links[1].inertia)
    text = write_mdh_yaml(heavy)
    assert "  - joint: knee\n    type: fixed\n    moved: {antecedent: knee_link}\n" in text
    assert read_mdh_yaml(text).links[4].inertia.mass == 1 and len(read_mdh_yaml(text).joints) == 4


def test_minimal_frames_close_the_same_loop():
    """The frames k and k+B meet in the new frames at the variable at which they met in the old ones."""
    text = FOUR_BAR.replace("{alpha: 0.3, d: 0.1}", "{alpha: 0.3, d: 0.1, theta: 0.4, r: 0.2}")
    robot = read_mdh_yaml(text)
    chosen = minimal_frames(robot)
    assert cut_joints(chosen) == {0: 3} and "theta: 0, r: 0}" in write_mdh_yaml(chosen).split("moved:")[1]
    for variable in (0.0, 1.1):
        (k, closing), (new_k, new_closing) = (frames_of_the_loop(variant, variable) for variant in (robot, chosen))
        change = np.linalg.inv(k) @ new_k
        np.testing.assert_allclose(change[:, 2], [0, 0, 1, 0], atol=1e-12)
        np.testing.assert_allclose(np.linalg.inv(closing) @ new_closing, change, atol=1e-12)


def frames_of_the_loop(robot, variable):
    """Return frames k and k+B (4, 4) in frame 0, with all joints at that position."""
    placed = [np.eye(4)]
    for joint in robot.joints:
        placed.append(placed[joint.antecedent] @ joint.placement @ placement_from_mdh(MDHParameters(theta=variable)))
    return [placed[end.link] @ end.placement for end in robot.loops[0].ends]


MISTAKES = {
    "motor": ("role: elastic", "role: actuated", 14, 11, "joint 'knee' cannot be actuated, because the loop is cut"),
    "elastic without spring": ("    spring: {stiffness: 3, rest: 0.1}\n", "", 14, 11, "needs a spring"),
    "spring without role": ("    role: elastic\n", "", 14, 13, "role missing: elastic"),
    "passive with spring": ("role: elastic", "role: passive", 14, 11, "a passive joint with a spring is elastic"),
    "joint twice": ("joint: knee", "joint: rocker", 10, 12, "joint 'rocker' is already defined"),
    "loop twice": (
        "loops:\n",
        "loops:\n  - {joint: knee, type: fixed, moved: {antecedent: pin}, closed_on: {antecedent: input}}\n",
        11,
        12,
        "loop 'knee' is already defined",
    ),
    "link twice": ("type: revolute", "link: output", 11, 11, "link or frame 'output' is already defined"),
    "unknown antecedent": (
        "antecedent: pin,",
        "antecedent: pni,",
        12,
        25,
        "unknown link 'pni': known are",
    ),
    "joint as antecedent": ("antecedent: output,", "antecedent: rocker,", 13, 29, "it moves 'output'"),
    "two ways to say a place": (
        "xyz: [0.2",
        "mdh: {}, xyz: [0.2",
        13,
        51,
        "mdh and xyz exclude each other",
    ),
    "friction of a weld": (
        "type: revolute",
        "type: fixed",
        14,
        11,
        "has no joint variable: omit role",
    ),
    "type that is none": ("type: revolute", "type: ball", 11, 11, "is none of revolute, prismatic, fixed, spherical"),
    "frame left out": ("    closed_on:", "    #", 10, 5, "closed_on missing"),
    "no antecedent": ("antecedent: output, ", "", 13, 16, "loops[0].closed_on: antecedent missing"),
    "follower": (
        "    limits:",
        "    mimic: {joint: crank}\n    limits:",
        18,
        5,
        "a cut joint mimics no other",
    ),
    "negative friction": ("coulomb_friction: 0.4", "coulomb_friction: -1", 17, 23, "coulomb_friction -1 is negative"),
    "degrees": ("alpha: 0.3", "alpha: 30", 12, 43, "radians(30)"),
    "no number": ("initial_position: -pi/3", "initial_position: [1]", 19, 23, "a number or an expression"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_malformed_table_is_refused_with_line_column_and_remedy(mistake):
    wrong, right, line, column, reason = MISTAKES[mistake]
    text = FOUR_BAR.replace(wrong, right, 1)
    assert text != FOUR_BAR
    with pytest.raises(DescriptionError) as refusal:
        read_mdh_yaml(text, source="bars.yaml")
    message = str(refusal.value)
    assert reason in message and message.startswith(f"bars.yaml, line {line}, column {column}: "), message


def test_named_frame_as_antecedent_of_a_loop_is_refused_with_a_remedy():
    text = FOUR_BAR.replace("antecedent: pin,", "antecedent: tip,") + "frames:\n  - {frame: tip, link: coupler}\n"
    with pytest.raises(
        DescriptionError, match="line 12, column 25: frame 'tip' is defined after the loops: give its link"
    ):
        read_mdh_yaml(text)


def test_loop_of_a_link_with_itself_is_refused():
    text = (
        FOUR_BAR[: FOUR_BAR.index("    role: elastic")].replace("revolute", "fixed").replace("output, xyz", "pin, xyz")
    )
    with pytest.raises(DescriptionError, match="line 10, column 5: loop 'knee': both its ends are on the same link"):
        read_mdh_yaml(text)
