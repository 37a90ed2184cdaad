"""Comparison of the states of several publishers: a robot cannot be at two positions at once."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from sensor_msgs.msg import JointState

from robot_dynamics.nodes.codecs.joint_states import MAX_MAPPINGS

if TYPE_CHECKING:
    from robot_dynamics.array_types import IntArray
    from robot_dynamics.nodes.codecs.joint_states import JointMapping

POSITION_TOLERANCE = 0.01
"""Difference of two positions of a joint at the same time [rad or m] that is none: of encoders before and behind a
gear, or of rounded numbers."""
VELOCITY_TOLERANCE = 0.1
"""The same of two velocities [rad/s or m/s]: of different filters."""
ACCELERATION = 100.0
"""Acceleration [rad/s² or m/s²] that joints may have between two states."""
HOLD_TIME = 1.0
"""Time [s] without contradiction after which states are used again."""
DESCRIPTION_PERIOD = 1.0
"""Time [s] for which the description of a contradiction is kept: the names of new nodes come late."""


class ReceivedState(NamedTuple):
    """A message with joints of the robot.

    Attributes
    ----------
    message : the message.
    number : of the message among those of its publisher; None if the middleware has none.
    time : of the state [s].
    """

    message: JointState
    number: int | None
    time: float


@dataclass(frozen=True, eq=False)
class CommonJoints:
    """Joints that messages with two lists of names have in common, and their indices in both."""

    first: IntArray
    second: IntArray


class StateAgreement:
    """Finds states of the same joint that contradict each other, which only two publishers can send.

    The middleware does not pass on which publisher a message is from. It numbers the messages of each publisher: a
    number that follows the last one is taken for the next message of the same publisher, which may jump, as a simulator
    that is reset. Others are compared with the last state of these joints. Publishers of other joints have nothing to
    compare, and publishers of equal states agree.

    Parameters
    ----------
    count_publishers : returns the number of publishers of the states.
    describe_publishers : returns the names and endpoints of these publishers.
    """

    def __init__(self, count_publishers: Callable[[], int], describe_publishers: Callable[[], str]) -> None:
        self._count_publishers = count_publishers
        self._describe_publishers = describe_publishers
        self.restart()

    def restart(self) -> None:
        """Forget all states and contradictions."""
        self.forget_states()
        self._contradicted_at = -inf
        self._description = ""
        self._described_at = -inf

    def forget_states(self) -> None:
        """Forget all states, as before messages with other mappings."""
        self._latest: dict[JointMapping, ReceivedState] = {}
        self._overlapping: dict[JointMapping, list[JointMapping]] = {}
        self._common: dict[tuple[JointMapping, JointMapping], CommonJoints] = {}

    def check(self, mapping: JointMapping, state: ReceivedState, now: float, timeout: float) -> str:
        """Take a state, and return why no state can be used at present; empty if there is no contradiction.

        Parameters
        ----------
        mapping : of the message of the state.
        now : time of the machine [s].
        timeout : age [s] at which states are no longer compared.
        """
        if not len(mapping.joint_indices) or len(state.message.position) != len(state.message.name):
            return self._present_description(now)
        previous = self._latest.get(mapping)
        if previous is None:
            self._add_mapping(mapping)
        overlapping = self._overlapping[mapping]
        is_next = previous is not None and previous.number is not None and state.number == previous.number + 1
        if not (is_next and len(overlapping) == 1):
            for other_mapping in overlapping:
                other = self._latest.get(other_mapping)
                if other is None or abs(state.time - other.time) > timeout:
                    continue
                difference = self._difference(mapping, state, other_mapping, other)
                if difference and self._count_publishers() > 1:
                    self._contradict(difference, now)
                    break
        self._latest[mapping] = state
        return self._present_description(now)

    def _add_mapping(self, mapping: JointMapping) -> None:
        """Compute which joints messages with other names share with those of a new mapping."""
        if len(self._overlapping) >= MAX_MAPPINGS:
            self.forget_states()
        known = [*self._overlapping, mapping]
        self._overlapping[mapping] = []
        for other in known:
            _, first, second = np.intersect1d(mapping.joint_indices, other.joint_indices, return_indices=True)
            if not len(first):
                continue
            self._common[mapping, other] = CommonJoints(mapping.message_indices[first], other.message_indices[second])
            self._overlapping[mapping].append(other)
            if other is not mapping:
                self._common[other, mapping] = CommonJoints(
                    other.message_indices[second], mapping.message_indices[first]
                )
                self._overlapping[other].append(mapping)

    @np.errstate(all="ignore")  # numbers that are not finite are refused elsewhere
    def _difference(
        self, mapping: JointMapping, state: ReceivedState, other_mapping: JointMapping, other: ReceivedState
    ) -> str:
        """Return how two states contradict each other; empty if a joint can have both, or if one is not finite."""
        common = self._common[mapping, other_mapping]
        elapsed = abs(state.time - other.time)
        positions = np.frombuffer(state.message.position)[common.first]
        other_positions = np.frombuffer(other.message.position)[common.second]
        distances = np.abs(positions - other_positions)
        allowed = POSITION_TOLERANCE + 0.5 * ACCELERATION * elapsed**2
        sizes = len(state.message.velocity), len(other.message.velocity)
        if sizes == (len(state.message.name), len(other.message.name)):
            velocities = np.frombuffer(state.message.velocity)[common.first]
            other_velocities = np.frombuffer(other.message.velocity)[common.second]
            changes = np.abs(velocities - other_velocities)
            k = int(np.argmax(changes))
            if VELOCITY_TOLERANCE + ACCELERATION * elapsed < changes[k] < inf:
                name = state.message.name[common.first[k]]
                return f"{name} moves at {other_velocities[k]:.4g} and {velocities[k]:.4g} rad/s or m/s"
            distances -= np.maximum(np.abs(velocities), np.abs(other_velocities)) * elapsed
        k = int(np.argmax(distances))
        if allowed < distances[k] < inf:
            name = state.message.name[common.first[k]]
            return f"{name} is at {other_positions[k]:.4g} and {positions[k]:.4g} rad or m"
        return ""

    def _contradict(self, difference: str, now: float) -> None:
        is_new = now - self._contradicted_at > HOLD_TIME
        self._contradicted_at = now
        if is_new or now - self._described_at > DESCRIPTION_PERIOD:
            self._described_at = now
            self._description = (
                f"publishers of joint_states contradict each other ({difference}): {self._describe_publishers()}; "
                "let one of them publish these joints"
            )

    def _present_description(self, now: float) -> str:
        return self._description if now - self._contradicted_at <= HOLD_TIME else ""
