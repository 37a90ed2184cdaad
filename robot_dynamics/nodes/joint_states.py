"""The state of a robot out of sensor_msgs/JointState, by name: what streams, without a search in each message."""

from collections import Counter
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import QuestionError
from robot_dynamics.nodes.names import resolve

MOST_MATCHES = 16  # lists of names that are remembered


@dataclass(frozen=True, eq=False)
class Match:
    """Where the joints of a robot stand in messages with the same names.

    ours: whether these tell of the needed joints; refusal: why they are refused, if they are. to, source: the numbers
    of the independent joints, and their places in the message; placed, placed_source: of those that loops place.
    """

    ours: bool
    refusal: str
    to: np.ndarray
    source: np.ndarray
    placed: np.ndarray
    placed_source: np.ndarray


class JointStateReader:
    """Writes what messages tell into q and qd (n,) of the independent joints, and into `looped` of those of loops.

    needed: names of the joints that a message must have all of, if it has one: a message with none of them is that of
    someone else on the same topic, a gripper's say, and what it tells of the robot's other joints is taken. Names that
    the robot does not have are those of other robots. Where each joint stands in the message is found once, and again
    when the names change.
    """

    def __init__(self, dynamics, needed, namespace, q, qd, looped):
        self._dynamics, self._needed, self._namespace = dynamics, tuple(needed), namespace
        self._q, self._qd, self._looped = q, qd, looped
        self._names, self._match, self._matches = None, None, {}
        self._heard = set()

    @property
    def unheard(self):
        """Names of the independent joints of which no message told, so far."""
        return [name for name in self._dynamics.joint_names if name not in self._heard]

    def read(self, message, rates_needed):
        """Take over a message. Returns whether it tells of the needed joints; raises QuestionError where it should.

        rates_needed: whether it is refused without velocities; where it has none and none are needed they are zero.
        """
        if message.name != self._names:
            self._names = list(message.name)
            self._match = self._matched(tuple(self._names))
        match, size = self._match, len(self._names)
        if match.refusal:
            raise QuestionError(match.refusal)
        if not match.ours and not len(match.to) and not len(match.placed):
            return False  # of another robot
        if len(message.position) != size:
            raise QuestionError(f"joint_states has {len(message.position)} positions for {size} names")
        position, rates = np.frombuffer(message.position), len(message.velocity)
        if rates != size and (rates or (rates_needed and match.ours)):
            raise QuestionError(f"joint_states has {rates} velocities for {size} names")
        self._q[match.to] = position[match.source]
        self._qd[match.to] = np.frombuffer(message.velocity)[match.source] if rates else 0.0
        if len(match.placed):
            self._looped[match.placed] = position[match.placed_source]
        return match.ours

    def _matched(self, names):
        """The Match of messages with these names; the last few are kept, as more than one may publish."""
        match = self._matches.get(names)
        if match is None:
            if len(self._matches) >= MOST_MATCHES:
                self._matches.clear()
            match = self._matches[names] = self._new_match(names)
        self._heard.update(self._dynamics.joint_names[k] for k in match.to)
        return match

    def _new_match(self, names):
        known, found = self._dynamics.robot.joint_numbers, {}
        for place, name in enumerate(names):
            with suppress(QuestionError):  # a joint of another robot
                found[resolve("joint", name, known, self._namespace)] = place
        repeated = [name for name, times in Counter(names).items() if times > 1]
        missing = [name for name in self._needed if name not in found]
        ours, refusal = len(missing) < len(self._needed), ""
        if repeated:
            refusal = f"joint_states names {', '.join(map(repr, repeated))} more than once"
        elif missing and ours:
            refusal = (
                f"joint_states has no {', '.join(map(repr, missing))}: all controlled joints must be in one message"
            )
        return Match(ours, refusal, *_places(self._dynamics.joint_names, found),
                     *_places(self._dynamics.looped_joint_names, found))  # fmt: skip


def _places(names, found):
    """(numbers in `names` of those that were found, where each was found)."""
    pairs = [(number, found[name]) for number, name in enumerate(names) if name in found]
    return np.array(pairs, dtype=int).reshape(-1, 2).T
