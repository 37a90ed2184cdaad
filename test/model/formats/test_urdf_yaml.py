"""A URDF with a YAML beside it: the URDF's robot, with the loops, roles and springs of the YAML."""

import re
from pathlib import Path

import numpy as np
import pytest

from robot_dynamics import DescriptionError, Spring, load_robot
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.loading import read_robot
from robot_dynamics.model.minimal_frames import minimal_frames
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw

BODY = """<inertial><origin xyz="0.1 0 0"/><mass value="1"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.01" iyz="0" izz="0.01"/></inertial>"""
URDF = f"""\
<?xml version="1.0"?>
<robot name="bars">
  <link name="ground"/>
  <link name="left">{BODY}</link> <link name="left_tip"/>
  <link name="right">{BODY}</link> <link name="third">{BODY}</link>
  <joint name="shoulder" type="revolute"><parent link="ground"/><child link="left"/><axis xyz="0 1 0"/>
    <limit lower="-2" upper="2" effort="10" velocity="3"/><dynamics damping="0.1" friction="0.2"/></joint>
  <joint name="weld" type="fixed"><parent link="left"/><child link="left_tip"/><origin xyz="0.3 0 0"/></joint>
  <joint name="hip" type="continuous"><parent link="ground"/><child link="right"/><axis xyz="0 1 0"/>
    <origin xyz="0.2 0 0"/></joint>
  <joint name="copy" type="continuous"><parent link="right"/><child link="third"/><axis xyz="0 1 0"/>
    <mimic joint="hip"/><origin xyz="0.2 0 0"/></joint>
</robot>
"""
BESIDE = """\
urdf: bars.urdf
parameters: {l: 0.3}
gravity: [0, 0, -1.62]
roles: {hip: elastic}
springs:
  hip: {stiffness: 3, rest: l}
initial_positions: {shoulder: 0.5, hip: -l}
loops:
  - joint: knee
    moved: {antecedent: left_tip, rpy: [-pi/2, 0, 0]}
    closed_on: {antecedent: third, xyz: [l, 0, 0], rpy: [-pi/2, 0, 0]}
    viscous_friction: 0.5
"""


def with_text(beside=BESIDE, urdf=URDF):
    """Return the document with the text of the URDF in place of its path."""
    return beside.replace("bars.urdf", "|\n" + "".join(f"    {line}\n" for line in urdf.splitlines()).rstrip(), 1)


def check(robot):
    assert (robot.name, robot.gravity.tolist()) == ("bars", [0, 0, -1.62])
    alone = read_urdf(URDF)
    for joint, expected in zip(robot.joints, alone.joints, strict=False):
        assert (joint.name, joint.limits, joint.mimic) == (expected.name, expected.limits, expected.mimic)
        assert joint.viscous_friction == expected.viscous_friction
        np.testing.assert_array_equal(joint.placement, expected.placement)
    assert [joint.role for joint in robot.joints] == ["actuated", "elastic", "mimic", "passive"]
    assert [joint.initial_position for joint in robot.joints] == [0.5, -0.3, 0, 0]
    assert robot.joints[1].spring == Spring(3, 0.3) and robot.joints[3].viscous_friction == 0.5
    (loop,) = robot.loops
    assert (loop.name, loop.moved.link, loop.closed_on.link) == ("knee", 4, 3) and cut_joints(robot) == {0: 3}
    tip, third = robot.frame("left_tip").placement, robot.frame("third").placement
    np.testing.assert_allclose(robot.joints[3].placement[:3, 3], tip[:3, 3], atol=1e-15)
    np.testing.assert_allclose(robot.joints[3].placement[:3, 2], tip[:3, 1], atol=1e-15)  # turned onto y
    np.testing.assert_allclose(loop.closed_on.placement[:3, 3], (third @ [0.3, 0, 0, 1])[:3], atol=1e-15)
    assert robot.frame("knee_link").link == 4


def test_urdf_is_read_from_the_folder_an_absolute_path_or_the_text(tmp_path, monkeypatch):
    (tmp_path / "bars.urdf").write_text(URDF)
    (tmp_path / "bars.yaml").write_text(BESIDE)
    check(load_robot(tmp_path / "bars.yaml"))
    monkeypatch.chdir(tmp_path)
    check(load_robot("bars.yaml"))
    (tmp_path / "elsewhere").mkdir()
    moved = tmp_path / "elsewhere" / "bars.yaml"
    moved.write_text(BESIDE.replace("bars.urdf", str(tmp_path / "bars.urdf")))
    check(load_robot(moved))
    moved.write_text(BESIDE.replace("bars.urdf", "../bars.urdf"))
    check(load_robot(str(moved)))
    check(load_robot(with_text()))


def test_supplemented_urdf_as_a_table_is_the_same_robot():
    robot = minimal_frames(load_robot(with_text()))
    again = read_mdh_yaml(write_mdh_yaml(robot))
    assert cut_joints(again) == {0: 3} and [link.name for link in again.links] == [link.name for link in robot.links]
    for end, same in zip(robot.loops[0].ends, again.loops[0].ends, strict=True):
        np.testing.assert_allclose(same.placement, end.placement, atol=1e-12)


def test_supplemented_urdf_takes_values_name_gravity_and_base_as_a_table_does():
    text = with_text("robot: other\n" + BESIDE)
    robot = load_robot(text, values={"l": 0.7}, gravity=(1, 2, 3), moving_base=True)
    assert robot.name == "other" and robot.joints[1].spring.rest == 0.7
    assert robot.moving_base and robot.gravity.tolist() == [1, 2, 3]


def test_text_without_a_file_opens_no_file(tmp_path):
    (tmp_path / "bars.urdf").write_text(URDF)
    for path in ("bars.urdf", str(tmp_path / "bars.urdf")):
        with pytest.raises(DescriptionError, match=r"line 1, column 7: '.*bars.urdf' is a path, but this"):
            load_robot(BESIDE.replace("bars.urdf", path))
        with pytest.raises(DescriptionError, match=r"topic, line 1, column 7: .*give the text of the URDF instead"):
            read_robot(BESIDE.replace("bars.urdf", path), source="topic")


def test_malformed_urdf_is_refused_with_its_own_line(tmp_path):
    (tmp_path / "bars.yaml").write_text(BESIDE)
    with pytest.raises(DescriptionError, match=r"bars.yaml, line 1, column 7: '.*bars.urdf' cannot be read as a file"):
        load_robot(tmp_path / "bars.yaml")
    (tmp_path / "bars.urdf").write_text(URDF.replace('type="continuous"', 'type="planar"', 1))
    with pytest.raises(DescriptionError, match=r"bars.urdf, line 12: joint 'hip' has type 'planar'"):
        load_robot(tmp_path / "bars.yaml")
    (tmp_path / "bars.urdf").unlink()
    (tmp_path / "bars.urdf").mkdir()
    with pytest.raises(DescriptionError, match=r"line 1, column 7: '.*bars.urdf' is not a file"):
        load_robot(tmp_path / "bars.yaml")


def test_examples_of_the_documentation_are_the_same_robot_and_start_nearly_closed(tmp_path):
    text = (Path(__file__).parents[3] / "docs" / "how_to" / "closed_loops.md").read_text(encoding="utf-8")
    table, beside = re.findall(r"```yaml\n(# four_bar\S*.yaml\n.*?)```", text, re.DOTALL)
    (urdf,) = re.findall(r"```xml\n<!-- four_bar.urdf -->\n(.*?)```", text, re.DOTALL)
    robot = load_robot(table)
    (tmp_path / "four_bar.urdf").write_text(urdf)
    (tmp_path / "four_bar.yaml").write_text(beside)
    with_urdf = load_robot(tmp_path / "four_bar.yaml")
    assert not robot.warnings and not with_urdf.warnings
    for example in (robot, with_urdf):
        placed = [np.eye(4)]
        for joint in example.joints:
            turn = placement(rotation_from_roll_pitch_yaw(0, 0, joint.initial_position))
            placed.append(placed[joint.antecedent] @ joint.placement @ turn)
        moved, closed_on = (placed[end.link] @ end.placement for end in example.loops[0].ends)
        np.testing.assert_allclose(moved, closed_on, atol=0.01)
    assert [joint.role for joint in with_urdf.joints] == [joint.role for joint in robot.joints]
    assert [link.name for link in with_urdf.links] == [link.name for link in robot.links]


MISTAKES = {
    "unknown joint": ("roles: {hip: elastic}", "roles: {hop: passive}", "unknown moving joint 'hop': known are"),
    "fixed joint": ("roles: {hip: elastic}", "roles: {weld: passive}", "unknown moving joint 'weld'"),
    "unknown spring": ("  hip: {stiffness", "  hipp: {stiffness", "unknown moving joint 'hipp': did you mean 'hip'"),
    "unknown position": ("shoulder: 0.5", "shulder: 0.5", "unknown moving joint 'shulder': did you mean 'shoulder'"),
    "no role": ("elastic", "slack", "'slack' is none of actuated, passive, elastic"),
    "elastic without spring": (
        "{hip: elastic}",
        "{hip: elastic, shoulder: elastic}",
        "'shoulder': an elastic joint",
    ),
    "spring without role": ("roles: {hip: elastic}\n", "", "joint 'hip': role missing: elastic"),
    "passive with spring": (
        "hip: elastic",
        "hip: passive",
        "joint 'hip': a passive joint with a spring",
    ),
    "role of a follower": ("hip: elastic", "hip: elastic, copy: passive", "joint 'copy': a mimic joint"),
    "cut joint": ("hip: elastic", "hip: elastic, knee: passive", "loop 'knee' is cut at that joint: describe"),
    "negative stiffness": ("stiffness: 3", "stiffness: -3", "joint 'hip': stiffness -3 is negative"),
    "no number": ("shoulder: 0.5", "shoulder: left", "unknown name 'left'"),
    "name of a joint": ("joint: knee", "joint: hip", "joint 'hip' is already defined"),
    "unknown antecedent": ("antecedent: left_tip", "antecedent: left_top", "unknown link 'left_top': did you mean"),
    "joint as antecedent": ("antecedent: third", "antecedent: copy", "'copy' is a joint: it moves 'third'"),
    "two ways to say it": ("loops:", "joints: []\nloops:", "'joints': a robot has its joints here or in its urdf"),
    "misspelt key": ("roles:", "rolls:", "unknown key 'rolls': did you mean 'roles'"),
    "empty": ("urdf: bars.urdf", "urdf: ''", "is invalid: the path of a URDF"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_malformed_supplement_is_refused_with_line_and_remedy(mistake):
    wrong, right, reason = MISTAKES[mistake]
    text = with_text(BESIDE.replace(wrong, right, 1))
    with pytest.raises(DescriptionError) as refusal:
        load_robot(text)
    assert reason in str(refusal.value) and str(refusal.value).startswith("description, line "), str(refusal.value)
