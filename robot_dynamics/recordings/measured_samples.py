"""Joint samples of a running robot, kept to be read as those of a bag are."""

from __future__ import annotations

from collections.abc import Collection, Generator
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample


class MeasuredSamples:
    """Joint samples in the order of their arrival, with the interface of a Bag.

    Parameters
    ----------
    name : in the place of a path, for notes and errors.

    Attributes
    ----------
    path : the name.
    counts : {topic: number of messages}.
    notes : empty: no file is damaged.
    """

    def __init__(self, name: str) -> None:
        self.path = Path(name)
        self.counts: dict[str, int] = {}
        self.notes: list[str] = []
        self._samples: list[JointSample] = []
        self._base_topics: set[str] = set()

    def __len__(self) -> int:
        return len(self._samples)

    def add(self, sample: JointSample, is_base: bool = False) -> None:
        """Append a sample; is_base: whether it is of the odometry of the base."""
        if self._samples and sample.names == self._samples[-1].names:
            sample = sample._replace(names=self._samples[-1].names)  # one tuple for all
        self._samples.append(sample)
        self.counts[sample.source] = self.counts.get(sample.source, 0) + 1
        if is_base:
            self._base_topics.add(sample.source)

    def joint_topics(self, requested: Collection[str] = ()) -> list[str]:
        """The topics of joint states. Raises RecordingError where there are none."""
        topics = [topic for topic in self.counts if topic not in self._base_topics]
        if not topics:
            raise RecordingError(f"{self.path}: no message arrived")
        return topics

    def base_topics(self, requested: Collection[str] = ()) -> list[str]:
        """The topics of odometry. Raises RecordingError where there are none."""
        if not self._base_topics:
            raise RecordingError(f"{self.path}: no odometry of the base of the robot arrived")
        return sorted(self._base_topics)

    def samples(self, topics: Collection[str], base: str | None = None) -> Generator[JointSample, None, None]:
        """Yield the samples of topics, as often as needed."""
        yield from (sample for sample in self._samples if sample.source in topics)
