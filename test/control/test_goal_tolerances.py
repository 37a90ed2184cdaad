"""Tolerances of goals: zero keeps the default, -1 removes it, other numbers replace it."""

import numpy as np
import pytest

from robot_dynamics import InvalidInputError
from robot_dynamics.control.goal_tolerances import GoalTolerances, JointLimits, describe_violation

JOINTS = ("shoulder", "elbow")
DEFAULTS = GoalTolerances.from_defaults([0.1, 0.0], [0.02, 0.03], stopped_velocity=0.01, goal_time=0.0)


def test_defaults_of_zero_are_no_limit():
    np.testing.assert_array_equal(DEFAULTS.path, [[0.1, np.inf], [np.inf, np.inf]])
    np.testing.assert_array_equal(DEFAULTS.goal, [[0.02, 0.03], [0.01, 0.01]])
    assert DEFAULTS.goal_time == np.inf


def test_goal_changes_what_it_names():
    changed = DEFAULTS.with_requests(
        JOINTS, [JointLimits("elbow", 0.5, 2.0), JointLimits("shoulder", -1, 0)], [JointLimits("elbow", 0, -1)], 1.5
    )
    np.testing.assert_array_equal(changed.path, [[np.inf, 0.5], [np.inf, 2.0]])
    np.testing.assert_array_equal(changed.goal, [[0.02, 0.03], [0.01, np.inf]])
    assert changed.goal_time == 1.5
    unchanged = DEFAULTS.with_requests(JOINTS, [], [], 0.0)
    np.testing.assert_array_equal(unchanged.path, DEFAULTS.path)
    assert unchanged.goal_time == np.inf


@pytest.mark.parametrize(
    ("path", "goal", "goal_time", "message"),
    [
        ([JointLimits("wrist", 0.1, 0)], [], 0, r"path_tolerance\[0\]: unknown joint 'wrist'"),
        ([], [JointLimits("elbow", -0.5, 0)], 0, r"goal_tolerance\[0\].position is -0.5: a positive number"),
        ([], [JointLimits("elbow", 0, np.nan)], 0, r"goal_tolerance\[0\].velocity is nan"),
        ([], [], -2.0, "goal_time_tolerance is -2"),
    ],
)
def test_what_is_no_tolerance_is_refused(path, goal, goal_time, message):
    with pytest.raises(InvalidInputError, match=message):
        DEFAULTS.with_requests(JOINTS, path, goal, goal_time)


def test_violation_names_joint_error_and_tolerance():
    errors = np.array([[0.05, -0.04], [0.0, 0.0]])
    assert describe_violation(errors, DEFAULTS.path, JOINTS) == ""
    assert describe_violation(errors[:, ::-1], DEFAULTS.goal, JOINTS) == (
        "position of shoulder is 0.04 rad or m from its reference, tolerance 0.02"
    )
    errors = np.array([[0.0, 0.0], [0.0, -0.2]])
    assert describe_violation(errors, DEFAULTS.goal, JOINTS) == (
        "velocity of elbow is 0.2 rad/s or m/s from its reference, tolerance 0.01"
    )
