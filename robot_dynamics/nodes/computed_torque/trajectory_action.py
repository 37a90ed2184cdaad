"""The action ~/follow_joint_trajectory of computed_torque, where control_msgs is installed."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from time import perf_counter
from typing import TYPE_CHECKING, Any

from rclpy.action.server import CancelResponse, GoalResponse, ServerGoalHandle
from rclpy.node import Node

from robot_dynamics.control.goal_execution import GoalExecution
from robot_dynamics.control.modes import GRAVITY
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.trajectory_goals import read_tolerances, write_progress
from robot_dynamics.nodes.computed_torque.reference_inputs import ReadReference, require_active
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.threaded_actions import ThreadedActionServer

if TYPE_CHECKING:
    from robot_dynamics.control.goal_execution import GoalProgress
    from robot_dynamics.control.goal_tolerances import GoalTolerances
    from robot_dynamics.nodes.computed_torque.control_loop import ControlLoop
    from robot_dynamics.nodes.computed_torque.reference_inputs import ReferenceInputs

DEACTIVATED = "Current goal cancelled during deactivate transition."


@dataclass(eq=False)
class ServedGoal:
    """A goal that has been accepted, and how far it is.

    Attributes
    ----------
    handle : of the action server; None until it has been accepted.
    progress : to be published as feedback; None if there is nothing new.
    """

    loop: ControlLoop
    execution: GoalExecution
    reference: ReadReference
    handle: ServerGoalHandle | None = None
    progress: GoalProgress | None = None
    progress_time: float = -inf  # [s], of the last progress
    is_cancel_requested: bool = False


class TrajectoryAction:
    """Serves goals in a thread of its own. The thread of the efforts follows them as it follows ~/reference.

    Parameters
    ----------
    kind : control_msgs.action.FollowJointTrajectory.
    loop : returns the control loop; None while the node is not configured.
    references : takes the trajectories of goals.
    tolerances : returns the default tolerances for joints of these names.
    feedback_rate : returns the rate of feedback [1/s].
    """

    def __init__(
        self,
        node: Node,
        kind: Any,
        loop: Callable[[], ControlLoop | None],
        references: ReferenceInputs,
        tolerances: Callable[[tuple[str, ...]], GoalTolerances],
        feedback_rate: Callable[[], float],
    ) -> None:
        self._node = node
        self._logger = node.get_logger()
        self._kind = kind
        self._loop = loop
        self._references = references
        self._tolerances = tolerances
        self._feedback_rate = feedback_rate
        self._checked: ServedGoal | None = None  # of the request that is being accepted
        self._goals: list[ServedGoal] = []  # in the thread of the efforts: those without an outcome
        self._accepted: deque[ServedGoal] = deque()  # from the thread of the action to that of the efforts
        self._ended: deque[ServedGoal] = deque()  # and back
        self._served: list[ServedGoal] = []  # in the thread of the action
        self._server = ThreadedActionServer(
            node,
            kind,
            "~/follow_joint_trajectory",
            goal_callback=self._on_goal,
            accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            wake_callback=self._report_goals,
        )
        self._server.start()

    def close(self) -> None:
        """End the thread and the server."""
        self._server.close()

    # In the thread of the efforts

    def follow_accepted(self) -> None:
        """Take over goals that have been accepted since the last call, and those that clients cancel."""
        while self._accepted:
            goal = self._accepted.popleft()
            self._goals.append(goal)
            self._references.follow_goal(goal.reference, goal.execution)
        if not self._goals:
            return
        for goal in self._goals:
            controller = goal.loop.controller
            if goal.is_cancel_requested:
                goal.execution.cancel(controller, goal.loop.now())
            goal.execution.check_reference(controller)
        self._pass_on_ended()

    def step(self, time: float) -> None:
        """Check the goals after a step of the controller for a state of a time [s]."""
        if not self._goals:
            return
        has_progress = False
        for goal in self._goals:
            progress = goal.execution.step(goal.loop.controller, time)
            rate = self._feedback_rate()
            if progress is not None and rate > 0 and not 0 <= time - goal.progress_time < 1 / rate:
                goal.progress, goal.progress_time = progress, time
                has_progress = True
        if not self._pass_on_ended() and has_progress:
            self._server.wake()

    def abort(self, reason: str, hold: bool = False) -> None:
        """End all goals with a reason; `hold`: and stop the robot."""
        self._goals.extend(self._accepted)
        self._accepted.clear()
        for goal in self._goals:
            if hold:
                goal.execution.abort_and_hold(goal.loop.controller, goal.loop.now(), reason)
            goal.execution.abort(reason)
        self._pass_on_ended()

    def _pass_on_ended(self) -> bool:
        ended = [goal for goal in self._goals if goal.execution.outcome is not None]
        if not ended:
            return False
        self._goals = [goal for goal in self._goals if goal not in ended]
        self._ended.extend(ended)
        self._server.wake()
        return True

    # In the thread of the action

    def _on_goal(self, request: Any) -> GoalResponse:
        received_at = perf_counter()
        try:
            loop = require_active(self._loop())
            if loop.controller.settings.mode == GRAVITY:
                raise InvalidInputError(f"mode {GRAVITY} follows no reference: set another mode")
            content = loop.read_trajectory_message(request.trajectory)
            defaults = self._tolerances(loop.law.joints)
            tolerances = read_tolerances(request, defaults, loop.law.joints, loop.namespace)
        except Exception as error:
            self._logger.error(f"goal rejected: {failure_reason(self._logger, error)}")
            return GoalResponse.REJECT
        self._checked = ServedGoal(loop, GoalExecution(tolerances), ReadReference(loop, received_at, content))
        return GoalResponse.ACCEPT

    def _on_accepted(self, handle: ServerGoalHandle) -> None:
        goal = self._checked
        assert goal is not None, "the goal of this handle has just been checked"
        self._checked = None
        goal.handle = handle
        self._served.append(goal)
        self._accepted.append(goal)

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        for goal in self._served:
            if goal.handle is handle:
                goal.is_cancel_requested = True
                return CancelResponse.ACCEPT
        return CancelResponse.REJECT

    def _report_goals(self) -> None:
        """Publish feedback, and send the results of goals that have ended."""
        for goal in self._served:
            progress, goal.progress = goal.progress, None
            if progress is not None and goal.handle is not None:
                feedback = self._kind.Feedback()
                write_progress(feedback, progress, goal.loop.law.joints)
                feedback.header.stamp = self._node.get_clock().now().to_msg()
                goal.handle.publish_feedback(feedback)
        while self._ended:
            goal = self._ended.popleft()
            self._served.remove(goal)
            self._finish(goal)

    def _finish(self, goal: ServedGoal) -> None:
        outcome, handle = goal.execution.outcome, goal.handle
        assert outcome is not None, "the goal has ended"
        assert handle is not None, "the goal was accepted"
        result = self._kind.Result(error_code=int(outcome.code), error_string=outcome.reason)
        end = {"succeeded": handle.succeed, "aborted": handle.abort, "cancelled": handle.canceled}[outcome.state]
        self._server.finish(handle, end, result)
        if outcome.state == "aborted":
            self._logger.warning(f"goal aborted: {outcome.reason}")
        else:
            self._logger.info(f"goal {outcome.state}")
