"""The references of computed_torque: trajectories, read in a thread beside the efforts, and single points."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import TYPE_CHECKING

from rclpy.node import Node
from rclpy.serialization import deserialize_message
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.message_info import MessageInfoCallback
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS
from robot_dynamics.nodes.serialized_subscription import SerializedSubscription

if TYPE_CHECKING:
    from robot_dynamics.array_types import ByteArray
    from robot_dynamics.control.goal_execution import GoalExecution
    from robot_dynamics.nodes.computed_torque.control_loop import ControlLoop, TimedReference
    from robot_dynamics.nodes.message_info import MessageInfo

MAX_POINT_SIZE = 65_536  # bytes of a message with one point


@dataclass(frozen=True, eq=False)
class ReadReference:
    """A message on ~/reference that has been read for a loop: its content, or why it is refused."""

    loop: ControlLoop | None
    received_at: float  # [s] by perf_counter
    content: TimedReference | Exception


class ReferenceInputs:
    """Subscriptions of ~/reference and ~/reference_point; the later message has priority.

    A trajectory of any length leaves the streaming thread free: another thread reads it, and the present reference goes
    on until `follow_read` takes over the result.

    Parameters
    ----------
    loop : returns the control loop; None while the node is not configured.

    Attributes
    ----------
    refusal : why the last reference was refused; empty if it was not.
    last_refusal : the last refusal.
    refused_count : number of references that were refused.
    """

    def __init__(self, node: Node, loop: Callable[[], ControlLoop | None]) -> None:
        self._logger = node.get_logger()
        self._loop = loop
        self.refusal = ""
        self.last_refusal = ""
        self.refused_count = 0
        self._followed_since = 0.0  # [s] by perf_counter: reception of the present reference
        self._read: deque[ReadReference] = deque()
        on_point = MessageInfoCallback(self._on_point)
        self._points = node.create_subscription(
            JointTrajectory, "~/reference_point", on_point, INPUT_STREAM_QOS, raw=True
        )
        self._trajectories = SerializedSubscription(node, JointTrajectory, "~/reference", self._on_trajectory, 1)

    def close(self) -> None:
        """End the thread that reads."""
        self._trajectories.close()

    def follow_read(self) -> None:
        """Follow the trajectories that have been read since the last call."""
        while self._read:
            self._take("reference", partial(self._follow, self._read.popleft()))

    def follow_goal(self, read: ReadReference, goal: GoalExecution) -> None:
        """Follow the trajectory of a goal, which ends if it cannot be followed."""
        try:
            if not self._follow(read):
                goal.abort("Current goal preempted by another reference.")
                return
            assert read.loop is not None, "a goal is read for a loop"
            goal.begin(read.loop.controller)
        except Exception as error:
            goal.abort(failure_reason(self._logger, error))

    def _on_trajectory(self, data: ByteArray) -> None:
        """Read a message in the thread of the subscription."""
        received_at = perf_counter()
        loop = self._loop()
        content: TimedReference | Exception
        try:
            content = require_active(loop).read_trajectory(data)
        except Exception as error:
            content = error
        self._read.append(ReadReference(loop, received_at, content))

    def _follow(self, read: ReadReference) -> bool:
        """Follow a trajectory, and return True; False if a later reference has come."""
        if isinstance(read.content, Exception):
            raise read.content
        loop = require_active(self._loop())
        if loop is not read.loop or read.received_at < loop.activated_at:
            raise InvalidInputError("the node was activated anew while the reference was read: send it again")
        if read.received_at < self._followed_since:  # a point came in the meantime
            return False
        loop.follow_trajectory(read.content)
        self._followed_since = read.received_at
        return True

    def _on_point(self, data: bytes, info: MessageInfo) -> None:
        self._take("reference_point", partial(self._track, data, info))

    def _track(self, data: bytes, info: MessageInfo) -> None:
        received_at = perf_counter()
        loop = require_active(self._loop())
        if len(data) > MAX_POINT_SIZE:
            raise InvalidInputError(f"{len(data)} bytes came for one point: publish a trajectory on ~/reference")
        loop.track_point(deserialize_message(data, JointTrajectory), info)
        self._followed_since = received_at

    def _take(self, topic: str, take: Callable[[], object]) -> None:
        try:
            take()
            self.refusal = ""
        except Exception as error:
            self.refused_count += 1
            self.refusal = f"{topic} refused: {failure_reason(self._logger, error)}"
            self.last_refusal = self.refusal
            self._logger.warning(self.refusal, throttle_duration_sec=1.0)


def require_active(loop: ControlLoop | None) -> ControlLoop:
    """Return the control loop. Raises InvalidInputError if there is none, or it is not active."""
    if loop is None or not loop.is_active:
        raise InvalidInputError("the node is not active")
    return loop
