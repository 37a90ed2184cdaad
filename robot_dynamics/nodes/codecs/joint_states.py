"""The state of a robot out of sensor_msgs/JointState, by name: what streams, without a search in each message."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.joint_order import resolve_name

MOST_MATCHES = 16  # lists of names that are remembered


@dataclass(frozen=True, eq=False)
class JointMapping:
    """Where the joints of a robot stand in messages with the same names.

    ours: whether these tell of the needed joints; refusal: why they are refused, if they are. to, source: the numbers
    of the independent joints, and their places in the message; placed, placed_source: of those that loops place.
    """

    has_required_joints: bool
    rejection_reason: str
    joint_indices: np.ndarray
    message_indices: np.ndarray
    dependent_indices: np.ndarray
    dependent_message_indices: np.ndarray


class JointStateReader:
    """Writes what messages tell into q and qd (n,) of the independent joints, and into `looped` of those of loops.

    needed: names of the joints that a message must have all of, if it has one: a message with none of them is that of
    someone else on the same topic, a gripper's say, and what it tells of the robot's other joints is taken. Names that
    the robot does not have are those of other robots. Where each joint stands in the message is found once, and again
    when the names change.
    """

    def __init__(self, dynamics, required, namespace, q, qd, dependent_positions):
        self._dynamics, self._needed, self._namespace = dynamics, tuple(required), namespace
        self._q, self._qd, self._looped = q, qd, dependent_positions
        self._names, self._match, self._matches = None, None, {}
        self._heard = set()

    @property
    def unreported_joint_names(self):
        """Names of the independent joints of which no message told, so far."""
        return [name for name in self._dynamics.joint_names if name not in self._heard]

    def read(self, message, velocities_required):
        """Take over a message. Returns whether it tells of the needed joints; raises QuestionError where it should.

        rates_needed: whether it is refused without velocities; where it has none and none are needed they are zero.
        """
        if message.name != self._names:
            self._names = list(message.name)
            self._match = self._matched(tuple(self._names))
        match, size = self._match, len(self._names)
        if match.rejection_reason:
            raise InvalidInputError(match.rejection_reason)
        if not match.has_required_joints and not len(match.joint_indices) and not len(match.dependent_indices):
            return False  # of another robot
        if len(message.position) != size:
            raise InvalidInputError(f"joint_states has {len(message.position)} positions for {size} names")
        position, rates = np.frombuffer(message.position), len(message.velocity)
        if rates != size and (rates or (velocities_required and match.has_required_joints)):
            raise InvalidInputError(f"joint_states has {rates} velocities for {size} names")
        self._q[match.joint_indices] = position[match.message_indices]
        self._qd[match.joint_indices] = np.frombuffer(message.velocity)[match.message_indices] if rates else 0.0
        if len(match.dependent_indices):
            self._looped[match.dependent_indices] = position[match.dependent_message_indices]
        return match.has_required_joints

    def _matched(self, names):
        """The Match of messages with these names; the last few are kept, as more than one may publish."""
        match = self._matches.get(names)
        if match is None:
            if len(self._matches) >= MOST_MATCHES:
                self._matches.clear()
            match = self._matches[names] = self._new_match(names)
        self._heard.update(self._dynamics.joint_names[k] for k in match.joint_indices)
        return match

    def _new_match(self, names):
        known, found = self._dynamics.robot.joint_numbers, {}
        for place, name in enumerate(names):
            with suppress(InvalidInputError):  # a joint of another robot
                found[resolve_name("joint", name, known, self._namespace)] = place
        repeated = [name for name, times in Counter(names).items() if times > 1]
        missing = [name for name in self._needed if name not in found]
        has_required_joints, rejection_reason = len(missing) < len(self._needed), ""
        if repeated:
            rejection_reason = f"joint_states names {', '.join(map(repr, repeated))} more than once"
        elif missing and has_required_joints:
            rejection_reason = (
                f"joint_states has no {', '.join(map(repr, missing))}: all controlled joints must be in one message"
            )
        return JointMapping(has_required_joints, rejection_reason, *_places(self._dynamics.joint_names, found),
                     *_places(self._dynamics.dependent_joint_names, found))  # fmt: skip


def _places(names, found):
    """(numbers in `names` of those that were found, where each was found)."""
    pairs = [(number, found[name]) for number, name in enumerate(names) if name in found]
    return np.array(pairs, dtype=int).reshape(-1, 2).T
