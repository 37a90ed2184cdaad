"""Which columns of a message belong to which joints of the model, cached for each kind of message."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

MAX_MESSAGE_LAYOUTS = 1000  # kinds of messages whose columns are cached

JointNumbers: TypeAlias = tuple[int, ...]


class MessageLayout(NamedTuple):
    """The joints of one kind of message: their numbers, ascending, and their columns in the message."""

    joints: JointNumbers
    columns: list[int]


class MessageLayouts:
    """Matches the names of messages to joints; each joint is read from the first topic that has it."""

    def __init__(
        self, names: Sequence[str], statistics: SampleStatistics, sources: Iterable[tuple[int, str]] = ()
    ) -> None:
        self._joint_numbers = {name: number for number, name in enumerate(names)}
        self._statistics = statistics
        self._cache: dict[tuple[str, tuple[str, ...]], MessageLayout] = {}  # by topic and names of a message
        self.sources: dict[int, str] = dict(sources)  # topic of each joint

    def layout(self, sample: JointSample) -> MessageLayout:
        """The layout of messages with the topic and names of this one; RecordingError where a joint is in it twice."""
        key = sample.source, sample.names
        if key not in self._cache:
            if len(self._cache) >= MAX_MESSAGE_LAYOUTS:
                self._cache.clear()
            self._cache[key] = self._match_names(sample)
        return self._cache[key]

    def _match_names(self, sample: JointSample) -> MessageLayout:
        columns: dict[int, int] = {}
        for column, name in enumerate(sample.names):
            joint = self._joint_numbers.get(name)
            if joint is None:
                self._statistics.note_joint("joints that the model does not have", name)
            elif self.sources.setdefault(joint, sample.source) != sample.source:
                self._statistics.counts["second_source"] += 1
                sentence = f"joints of {sample.source} that come from {self.sources[joint]} already"
                self._statistics.note_joint(sentence, name)
            elif joint in columns:
                raise RecordingError(f"{sample.source}: joint {name!r} is named twice in one message")
            else:
                columns[joint] = column
        joints = tuple(sorted(columns))
        return MessageLayout(joints, [columns[joint] for joint in joints])
