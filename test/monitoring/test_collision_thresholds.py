"""Files of thresholds: written, read, refused with reasons; and thresholds without a file."""

from dataclasses import replace

import numpy as np
import pytest

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import DescriptionError
from robot_dynamics.monitoring.collision_thresholds import (
    CollisionThresholds,
    default_thresholds,
    dry_friction,
    load_thresholds,
    write_thresholds,
)

NAMES = ("joint a", "b", "c")


def test_written_thresholds_are_read_again(tmp_path):
    written = CollisionThresholds(NAMES, np.array([1.25, np.inf, 1e-3]), np.array([0.5, 0.0, 0.0]), 30.0, 0.02)
    text = write_thresholds(written, ["learnt on Monday"])
    (tmp_path / "t.yaml").write_text(text)
    read = load_thresholds(tmp_path / "t.yaml", NAMES)
    assert "# learnt on Monday\n" in text and "b" not in text.partition("joints:")[2].replace("joint", "")
    assert read.joint_names == NAMES and (read.bandwidth, read.slow_velocity) == (30.0, 0.02)
    assert np.array_equal(read.moving, written.moving) and np.array_equal(read.slow, written.slow)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("format: 1\nbandwidth: 0\njoints: {b: {moving: 1}}", "a number above zero"),
        ("format: 1\nbandwidth: 5\njoints: {b: {moving: -1}}", "a number above zero"),
        ("format: 1\nbandwidth: 5\njoints: {b: {slow: 1}}", "moving"),
        ("format: 1\nbandwidth: 5\njoints: {d: {moving: 1}}", "unknown joint 'd'"),
        ("format: 1\nbandwidth: 5\njoints: {}", "joints"),
        ("format: 2\nbandwidth: 5\njoints: {b: {moving: 1}}", "format"),
        ("[1]", "a mapping"),
    ],
)
def test_wrong_files_are_refused_by_line(tmp_path, text, message):
    (tmp_path / "t.yaml").write_text(text)
    with pytest.raises(DescriptionError, match=message) as refused:
        load_thresholds(tmp_path / "t.yaml", NAMES)
    assert "t.yaml" in str(refused.value)


def test_default_thresholds_are_a_share_of_the_limits():
    dynamics = Dynamics(load_robot("panda"))
    thresholds = default_thresholds(dynamics, 0.1, 50.0)
    assert thresholds.moving == pytest.approx([8.7] * 4 + [1.2] * 3)
    robot = dynamics.robot
    joints = list(robot.joints)
    joints[2] = replace(joints[2], limits=replace(joints[2].limits, effort=np.inf), coulomb_friction=4.0)
    thresholds = default_thresholds(Dynamics(replace(robot, joints=tuple(joints))), 0.1, 50.0)
    assert np.isinf(thresholds.moving[2]) and thresholds.slow[2] == 6.0 and not thresholds.slow[[0, 1, 3]].any()


def test_dry_friction_is_the_largest_below_the_velocity():
    robot = load_robot("ur5e")
    changes = [
        {"coulomb_friction": 2.0},
        {"coulomb_friction": 2.0, "stribeck_friction": 1.0, "stribeck_velocity": 0.05},
        {"coulomb_friction": 2.0, "stribeck_friction": -1.0, "stribeck_velocity": 0.05},
        {"coulomb_friction": 2.0, "coulomb_asymmetry": -0.25},
    ]
    joints = [replace(joint, **change) for joint, change in zip(robot.joints, [*changes, {}, {}], strict=True)]
    dynamics = Dynamics(replace(robot, joints=tuple(joints)))
    assert dry_friction(dynamics, 0.05) == pytest.approx([2.0, 3.0, 1.5, 2.25, 0.0, 0.0])
