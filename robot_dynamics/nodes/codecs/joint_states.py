"""The state of a robot out of streamed sensor_msgs/JointState, matched by name without a search in each message."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from sensor_msgs.msg import JointState

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.joint_order import resolve_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.dynamics import Dynamics

MAX_MAPPINGS = 16  # lists of names whose mapping is kept


@dataclass(frozen=True, eq=False)
class JointMapping:
    """Where the joints of a robot are in messages with the same list of names.

    Attributes
    ----------
    has_required_joints : whether these messages contain required joints.
    rejection_reason : why such messages are refused; empty if they are not.
    joint_indices, message_indices : of independent joints, in the robot and in the message.
    dependent_indices, dependent_message_indices : of joints that loops place, in the robot and in the message.
    """

    has_required_joints: bool
    rejection_reason: str
    joint_indices: IntArray
    message_indices: IntArray
    dependent_indices: IntArray
    dependent_message_indices: IntArray


class JointStateReader:
    """Copies joint states from messages into arrays.

    A message must have all required joints or none: one with none comes from another publisher on the same topic, for
    example of a gripper, and its values of other joints of the robot are used. Names that the robot does not have are
    those of other robots. The mapping of names is computed once, and again when the names change.

    Parameters
    ----------
    required : names of the required joints.
    namespace : of the node, which may precede names.
    q, qd : (n,) positions and velocities of the independent joints, written in place.
    dependent_positions : positions of the joints that loops place, written in place.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        required: Sequence[str],
        namespace: str,
        q: Array,
        qd: Array,
        dependent_positions: Array,
    ) -> None:
        self._dynamics = dynamics
        self._required = tuple(required)
        self._namespace = namespace
        self._q = q
        self._qd = qd
        self._dependent_positions = dependent_positions
        self._names: list[str] = []
        self._mapping = self._new_mapping(())
        self._mappings: dict[tuple[str, ...], JointMapping] = {}
        self._reported: set[str] = set()

    @property
    def unreported_joint_names(self) -> list[str]:
        """Names of the independent joints that no message has contained so far."""
        return [name for name in self._dynamics.joint_names if name not in self._reported]

    def find_mapping(self, message: JointState) -> JointMapping:
        """Return where the joints of the robot are in a message: the same object for equal lists of names."""
        if message.name != self._names:
            self._names = list(message.name)
            self._mapping = self._mapping_of_names(tuple(self._names))
        return self._mapping

    def read(self, message: JointState, velocities_required: bool) -> bool:
        """Copy the state of a message, and return whether it contains the required joints.

        velocities_required: whether a message without velocities is refused; else they are zero. Raises
        InvalidInputError.
        """
        mapping = self.find_mapping(message)
        size = len(self._names)
        if mapping.rejection_reason:
            raise InvalidInputError(mapping.rejection_reason)
        if not mapping.has_required_joints and not len(mapping.joint_indices) and not len(mapping.dependent_indices):
            return False  # of another robot
        if len(message.position) != size:
            raise InvalidInputError(f"joint_states has {len(message.position)} positions for {size} names")
        positions = np.frombuffer(message.position)
        velocity_count = len(message.velocity)
        if velocity_count != size and (velocity_count or (velocities_required and mapping.has_required_joints)):
            raise InvalidInputError(f"joint_states has {velocity_count} velocities for {size} names")
        self._q[mapping.joint_indices] = positions[mapping.message_indices]
        if velocity_count:
            self._qd[mapping.joint_indices] = np.frombuffer(message.velocity)[mapping.message_indices]
        else:
            self._qd[mapping.joint_indices] = 0.0
        if len(mapping.dependent_indices):
            self._dependent_positions[mapping.dependent_indices] = positions[mapping.dependent_message_indices]
        return mapping.has_required_joints

    def _mapping_of_names(self, names: tuple[str, ...]) -> JointMapping:
        """Return the mapping of messages with these names; the last few are kept, for topics with many publishers."""
        mapping = self._mappings.get(names)
        if mapping is None:
            if len(self._mappings) >= MAX_MAPPINGS:
                self._mappings.clear()
            mapping = self._mappings[names] = self._new_mapping(names)
        self._reported.update(self._dynamics.joint_names[k] for k in mapping.joint_indices)
        return mapping

    def _new_mapping(self, names: tuple[str, ...]) -> JointMapping:
        known = self._dynamics.robot.joint_numbers
        message_indices = {}
        for index, name in enumerate(names):
            with suppress(InvalidInputError):  # a joint of another robot
                message_indices[resolve_name("joint", name, known, self._namespace)] = index
        repeated = [name for name, count in Counter(names).items() if count > 1]
        missing = [name for name in self._required if name not in message_indices]
        has_required_joints = len(missing) < len(self._required)
        rejection_reason = ""
        if repeated:
            rejection_reason = f"joint_states names {', '.join(map(repr, repeated))} more than once"
        elif missing and has_required_joints:
            rejection_reason = (
                f"joint_states has no {', '.join(map(repr, missing))}: all controlled joints must be in one message"
            )
        return JointMapping(
            has_required_joints,
            rejection_reason,
            *_index_pairs(self._dynamics.joint_names, message_indices),
            *_index_pairs(self._dynamics.dependent_joint_names, message_indices),
        )


def _index_pairs(names: Sequence[str], message_indices: Mapping[str, int]) -> tuple[IntArray, IntArray]:
    """Return indices in `names` and in the message of those names that the message has."""
    pairs = [(index, message_indices[name]) for index, name in enumerate(names) if name in message_indices]
    joint_indices, indices_in_message = np.array(pairs, dtype=int).reshape(-1, 2).T
    return joint_indices, indices_in_message
