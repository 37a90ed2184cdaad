"""Goals, feedback and results of control_msgs/action/FollowJointTrajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Duration
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.control.goal_tolerances import JointLimits
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import to_float_array, to_nanoseconds
from robot_dynamics.nodes.codecs.joint_order import resolve_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.control.goal_execution import GoalProgress
    from robot_dynamics.control.goal_tolerances import GoalTolerances


def read_tolerances(goal: Any, defaults: GoalTolerances, joints: Sequence[str], namespace: str) -> GoalTolerances:
    """Return the tolerances of a goal, with those of the parameters where it leaves them open.

    Raises InvalidInputError, also for tolerances of what this node does not measure or control.
    """
    if goal.component_path_tolerance or goal.component_goal_tolerance or goal.multi_dof_trajectory.points:
        raise InvalidInputError(
            "multi_dof_trajectory and component tolerances are for joints of several degrees of freedom: leave them "
            "empty"
        )
    return defaults.with_requests(
        joints,
        [_read_limits(tolerance, "path_tolerance", joints, namespace) for tolerance in goal.path_tolerance],
        [_read_limits(tolerance, "goal_tolerance", joints, namespace) for tolerance in goal.goal_tolerance],
        to_nanoseconds(goal.goal_time_tolerance) * 1e-9,
    )


def _read_limits(tolerance: Any, field: str, joints: Sequence[str], namespace: str) -> JointLimits:
    if tolerance.acceleration > 0:
        raise InvalidInputError(
            f"{field} limits the acceleration of {tolerance.name!r}, which is not measured: set it to 0"
        )
    name = resolve_name("joint", tolerance.name, joints, namespace)
    return JointLimits(name, tolerance.position, tolerance.velocity)


def write_progress(feedback: Any, progress: GoalProgress, joints: Sequence[str]) -> None:
    """Write the progress of a goal into a feedback message, but for its stamp."""
    feedback.joint_names = list(joints)
    nanoseconds = max(round(progress.time * 1e9), 0)
    elapsed = Duration(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
    errors = progress.reference - progress.measured
    feedback.desired = _point(progress.reference, elapsed)
    feedback.desired.accelerations = to_float_array(progress.accelerations)
    feedback.actual = _point(progress.measured, elapsed)
    feedback.error = _point(errors, elapsed)


def _point(values: Array, elapsed: Duration) -> JointTrajectoryPoint:
    positions, velocities = map(to_float_array, np.ascontiguousarray(values))
    return JointTrajectoryPoint(positions=positions, velocities=velocities, time_from_start=elapsed)
