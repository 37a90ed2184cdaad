"""The execution of a trajectory goal: whether it has succeeded, was aborted or was cancelled, and why."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING, Literal

import numpy as np

from robot_dynamics.control.goal_tolerances import describe_violation
from robot_dynamics.control.modes import GRAVITY

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.control.controller import Controller
    from robot_dynamics.control.goal_tolerances import GoalTolerances
    from robot_dynamics.control.reference import ReferencePoint, ScheduledTrajectory


class ErrorCode(IntEnum):
    """Codes of the result of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


@dataclass(frozen=True)
class Outcome:
    """The end of a goal.

    Attributes
    ----------
    state : the terminal state of the goal.
    code, reason : of the result.
    """

    state: Literal["succeeded", "aborted", "cancelled"]
    code: ErrorCode
    reason: str


@dataclass(frozen=True)
class GoalProgress:
    """Positions and velocities (2, n) that a goal reports as feedback; accelerations (n,) are of the reference.

    Attributes
    ----------
    time : float
        Since the start of the trajectory [s].
    """

    time: float
    reference: Array
    accelerations: Array
    measured: Array


class GoalExecution:
    """Watches a trajectory that a controller follows until it has an outcome.

    A goal ends with its reference: when another one takes its place, and when the controller drops it, after a fault
    longer than `ramp_time`. A goal whose tolerances are violated ends with a stop, as does one that is cancelled.

    Parameters
    ----------
    tolerances : GoalTolerances

    Attributes
    ----------
    outcome : Outcome or None
        None until the goal has ended; it never changes after that.
    """

    def __init__(self, tolerances: GoalTolerances) -> None:
        self.tolerances = tolerances
        self.outcome: Outcome | None = None
        self._source: ScheduledTrajectory | ReferencePoint | None = None
        self._is_first_step = True
        self._efforts: Array | None = None  # before the tolerances were violated

    def begin(self, controller: Controller) -> None:
        """Watch a trajectory that the controller has just begun to follow."""
        self._source = controller.source
        self._efforts = controller.last_efforts.copy()

    def step(self, controller: Controller, time: float) -> GoalProgress | None:
        """Check the goal after a step of the controller for a state of a time [s], and return its progress."""
        self.check_reference(controller)
        source = self._source
        if self.outcome is not None or source is None or controller.fault:
            return None
        law = controller.law
        measured = np.stack([law.q[law.joint_indices], law.qd[law.joint_indices]])
        errors = controller.reference[:2] - measured
        if time < source.end or self._is_first_step:
            violation = describe_violation(errors, self.tolerances.path, law.joints)
            if violation:
                reason = f"path tolerance violation: {violation}"
                self._stop(controller, time, ErrorCode.PATH_TOLERANCE_VIOLATED, reason)
        self._is_first_step = False
        if self.outcome is None and time >= source.end:
            self._check_goal(controller, time, time - source.end, errors)
        if self._efforts is not None and self.outcome is None:
            np.copyto(self._efforts, controller.last_efforts)
        reference = controller.reference.copy()
        return GoalProgress(time - source.start, reference[:2], reference[2], measured)

    def check_reference(self, controller: Controller) -> None:
        """Abort the goal if the controller does not follow its trajectory any more."""
        if self.outcome is not None or self._source is None:
            return
        if controller.settings.mode == GRAVITY:
            self.abort(f"mode {GRAVITY} follows no reference")
        elif controller.source is not self._source and controller.collision != "none":
            self.abort(f"a collision was reported, and the reaction is {controller.collision}")
        elif controller.no_reference_reason:
            self.abort(controller.no_reference_reason)
        elif controller.source is not self._source:
            self.abort("Current goal preempted by another reference.")

    def abort(self, reason: str, code: ErrorCode = ErrorCode.INVALID_GOAL) -> None:
        """End the goal, unless it has ended."""
        if self.outcome is None:
            self.outcome = Outcome("aborted", code, reason)

    def abort_and_hold(self, controller: Controller, now: float, reason: str) -> None:
        """End the goal, and stop the robot if it follows its trajectory."""
        if self.outcome is None:
            self._hold(controller, now)
            self.abort(reason)

    def cancel(self, controller: Controller, now: float) -> None:
        """Stop the robot, and end the goal on request of its client."""
        self.check_reference(controller)
        if self.outcome is None:
            self._hold(controller, now)
            self.outcome = Outcome("cancelled", ErrorCode.SUCCESSFUL, "")

    def _check_goal(self, controller: Controller, time: float, elapsed: float, errors: Array) -> None:
        violation = describe_violation(errors, self.tolerances.goal, controller.law.joints)
        if not violation:
            self.outcome = Outcome("succeeded", ErrorCode.SUCCESSFUL, "Goal successfully reached!")
        elif elapsed > self.tolerances.goal_time:
            reason = f"goal_time_tolerance exceeding by {elapsed:.6f} seconds: {violation}"
            self._stop(controller, time, ErrorCode.GOAL_TOLERANCE_VIOLATED, reason)

    def _stop(self, controller: Controller, time: float, code: ErrorCode, reason: str) -> None:
        """End a goal that the robot does not follow, and hold the robot where it is.

        The efforts depart from those before, because the last ones have pushed the robot towards a refused reference.
        """
        controller.hold(time, measured=True, efforts=self._efforts)
        self.abort(f"Aborted due to {reason}", code)

    def _hold(self, controller: Controller, now: float) -> None:
        if self._source is not None and controller.source is self._source:
            controller.hold(now)
