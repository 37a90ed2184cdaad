"""Friction in MDH tables: reading, writing, and errors with their position."""

import numpy as np
import pytest
from peers.frictions import with_random_friction

from robot_dynamics import DescriptionError, load_robot
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.joint_friction import FRICTION_FIELDS

TABLE = """\
robot: arm
parameters: {ratio: 100}
joints:
  - joint: shoulder
    link: arm
    mass: 1
    viscous_friction: 2e-4*ratio^2
    coulomb_friction: 1.5
    viscous_asymmetry: -0.5
    coulomb_asymmetry: 0.25
    stribeck_friction: 0.75
    stribeck_velocity: 5/ratio
    load_friction: 0.1
  - {joint: elbow, link: forearm, mdh: {d: 0.3}, mass: 1}
"""
LOOP = """\
robot: bars
base: {link: ground}
joints:
  - {joint: turn, link: table, mass: 1, load_friction: 0.1}
  - {joint: crank, link: input, mdh: {alpha: pi/2}, mass: 1}
  - {joint: coupling, link: coupler, mdh: {d: 0.2}, role: passive, mass: 1}
  - {joint: rocker, link: output, antecedent: table, mdh: {alpha: pi/2, d: 0.5}, role: passive, mass: 1}
loops:
  - joint: knee
    moved: {antecedent: coupler, xyz: [0.5, 0, 0]}
    closed_on: {antecedent: output, xyz: [0.2, 0, 0]}
    viscous_friction: 1
    viscous_asymmetry: 0.5
    coulomb_friction: 1
    coulomb_asymmetry: -0.5
    stribeck_friction: 0.25
    stribeck_velocity: 0.1
"""


def friction_of(joint):
    return [getattr(joint, field) for field in FRICTION_FIELDS]


def test_table_has_all_friction_of_a_joint():
    robot = read_mdh_yaml(TABLE)
    assert friction_of(robot.joints[0]) == pytest.approx([2.0, 1.5, -0.5, 0.25, 0.75, 0.05, 0.1])
    assert friction_of(robot.joints[1]) == [0.0] * 7


def test_friction_is_unchanged_by_write_and_read():
    robot = with_random_friction(load_robot("ur5e"), 3)
    again = read_mdh_yaml(write_mdh_yaml(robot))
    for joint, same in zip(robot.joints, again.joints, strict=True):
        np.testing.assert_allclose(friction_of(same), friction_of(joint), rtol=1e-15)


def test_cut_joint_has_all_friction_but_that_of_its_load():
    robot = read_mdh_yaml(LOOP)
    assert friction_of(robot.joints[robot.joint_numbers["knee"]]) == [1, 1, 0.5, -0.5, 0.25, 0.1, 0]
    again = read_mdh_yaml(write_mdh_yaml(robot))
    assert [friction_of(joint) for joint in again.joints] == [friction_of(joint) for joint in robot.joints]
    with pytest.raises(DescriptionError, match="load_friction"):
        read_mdh_yaml(LOOP + "    load_friction: 0.1\n")


MISTAKES = {
    "viscous asymmetry": ("viscous_asymmetry: -0.5", "viscous_asymmetry: -2.5", 9, "is larger than viscous_friction 2"),
    "Coulomb asymmetry": ("coulomb_asymmetry: 0.25", "coulomb_asymmetry: 1.6", 10, "larger than the dry friction 1.5"),
    "Stribeck": ("stribeck_friction: 0.75", "stribeck_friction: -2", 11, "have a negative sum"),
    "velocity": ("stribeck_velocity: 5/ratio", "stribeck_velocity: 0", 12, "stribeck_velocity 0 is not above zero"),
    "no velocity": ("    stribeck_velocity: 5/ratio\n", "", 4, "stribeck_velocity 0 is not above zero"),
    "load": ("load_friction: 0.1", "load_friction: 1.5", 13, "load_friction 1.5 is not below 1"),
    "negative load": ("load_friction: 0.1", "load_friction: -0.5", 13, "load_friction -0.5 is negative"),
    "passive": ("load_friction: 0.1", "load_friction: 0.1\n    role: passive", 13, "it is passive"),
    "mimic": ("mdh: {d: 0.3}", "mimic: {joint: shoulder}", 13, "carries those of its mimic joints (elbow)"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_friction_that_no_joint_has_is_refused_with_its_line(mistake):
    right, wrong, line, reason = MISTAKES[mistake]
    assert right in TABLE
    with pytest.raises(DescriptionError) as refusal:
        read_mdh_yaml(TABLE.replace(right, wrong), source="arm.yaml")
    message = str(refusal.value)
    assert message.startswith(f"arm.yaml, line {line}, ") and reason in message and "'shoulder'" in message


def test_load_friction_in_a_loop_is_refused_with_its_line():
    text = LOOP.replace("mdh: {alpha: pi/2}, mass: 1}", "mdh: {alpha: pi/2}, mass: 1, load_friction: 0.2}", 1)
    with pytest.raises(DescriptionError, match=r"line 5, .*'crank' has no load of its own: it is in a loop"):
        read_mdh_yaml(text, source="bars.yaml")
