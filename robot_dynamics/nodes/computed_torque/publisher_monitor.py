"""Publishers beside the expected ones: of the efforts, and of the states of the controlled joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from time import monotonic
from typing import TYPE_CHECKING

from rclpy.node import Node

from robot_dynamics.nodes.publisher_names import describe_publishers, find_publishers, join_other_names

if TYPE_CHECKING:
    from robot_dynamics.nodes.message_info import MessageInfo

PERIOD = 1.0  # [s] in which steps back are counted
MIN_STEPS_BACK = 2  # within PERIOD: a publisher that starts again makes one


class SequenceSteps:
    """Counts messages whose sequence number is not above that of the message before.

    The middleware numbers the messages of each publisher, so that the numbers of a single publisher rise.
    """

    def __init__(self) -> None:
        self._last = -1
        self._steps_back = 0

    def add(self, info: MessageInfo) -> None:
        """Take the next message."""
        number = info.get("publication_sequence_number")  # None if the middleware has no such numbers
        if number is not None:
            self._steps_back += number <= self._last
            self._last = number

    def take(self) -> int:
        """Return the number of steps back, and restart the count."""
        count = self._steps_back
        self._steps_back = 0
        return count


class PublisherMonitor:
    """Detects a second publisher of efforts, and a second publisher of the states of the controlled joints.

    Publishers of other joints on the topic of the states are no conflict.

    Parameters
    ----------
    effort_topics : topics that the node publishes efforts on.
    states_topic : topic of the states.
    steps : of the messages with the controlled joints.
    now : returns the time [s] of the machine.

    Attributes
    ----------
    conflicts : sentences with the names of the nodes that publish.
    """

    def __init__(
        self,
        node: Node,
        effort_topics: Sequence[str],
        states_topic: str,
        steps: SequenceSteps,
        now: Callable[[], float] = monotonic,
    ) -> None:
        self._node = node
        self._effort_topics = effort_topics
        self._states_topic = node.resolve_topic_name(states_topic)
        self._steps = steps
        self._now = now
        self._checked_at = now()
        self.conflicts: list[str] = []

    def check(self) -> None:
        """Update `conflicts` if a PERIOD is over, and log new ones as warnings."""
        now = self._now()
        if now - self._checked_at < PERIOD * 0.9:  # a report between two periodic ones
            return
        self._checked_at = now
        previous = self.conflicts
        self.conflicts = [*self._effort_conflicts(), *self._state_conflicts(self._steps.take())]
        for conflict in self.conflicts:
            if conflict not in previous:
                self._node.get_logger().warning(conflict)

    def _effort_conflicts(self) -> list[str]:
        node = self._node
        conflicts = []
        for topic in self._effort_topics:
            if node.count_publishers(topic) < 2:
                continue
            own_name = node.get_fully_qualified_name()
            names = find_publishers(node, topic)
            if len(names) > 1 and own_name in names:
                conflicts.append(
                    f"{topic} is published by {join_other_names(names, own_name)} as well, so that efforts alternate "
                    "between theirs and ours: let one of them publish"
                )
        return conflicts

    def _state_conflicts(self, steps_back: int) -> list[str]:
        topic = self._states_topic
        if steps_back < MIN_STEPS_BACK or self._node.count_publishers(topic) < 2:
            return []
        return [
            f"{topic} is published by {describe_publishers(self._node, topic)}, and more than one of them has the "
            "controlled joints: efforts go to zero where their states contradict each other. Let one of them publish "
            "these joints"
        ]
