"""Recordings: bags, CSV tables and folders of them, opened by their path and read as often as needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.alignment import Resampler, resample_samples
from robot_dynamics.recordings.bags import Bag
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.odometry import BASE_SIGNALS
from robot_dynamics.recordings.recorded_duration import count_duration
from robot_dynamics.recordings.recording_parts import IndivisibleRecordingError, PartReader
from robot_dynamics.recordings.sample_range import WHOLE
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.tables import Table

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.alignment import SignalSegment
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.measured_samples import MeasuredSamples
    from robot_dynamics.recordings.recording_parts import RecordingPart
    from robot_dynamics.recordings.sample_range import SampleRange

ProgressWrapper: TypeAlias = Callable[[Iterable[Any]], Iterable[Any]]
"""Wraps an iterator with an item for each message, to show progress."""


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording of a robot, to be read as often as needed.

    Attributes
    ----------
    source : the files, or the samples of a measurement.
    topics : topics that are read.
    drives : conversion from the recorded signals to the joints.
    base : name of the base link where the base moves, and one of the topics has its odometry; else None.
    sample_range : the part of the recording that is used.
    part : the part of a long recording that `divide_recording` made; None: the whole recording.
    """

    source: Bag | Table | MeasuredSamples
    topics: tuple[str, ...]
    drives: Drives
    base: str | None = None
    sample_range: SampleRange = WHOLE
    part: RecordingPart | None = None

    def __reduce__(self) -> tuple[Callable[..., Recording], tuple[object, ...]]:
        """Pickled as its path: another process opens the files itself."""
        topics = () if isinstance(self.source, Table) else self.topics
        return open_recording, (
            self.source.path.absolute(),
            self.drives,
            topics,
            self.base,
            self.sample_range,
            self.part,
        )

    @property
    def signal_names(self) -> tuple[str, ...]:
        """Names of the signals: of the drives, and of the base where it moves."""
        return self.drives.names + (BASE_SIGNALS if self.base is not None else ())

    @property
    def time_range(self) -> tuple[float, float]:
        """Times [s] of the samples that belong to the recording, the second one not included; others are context."""
        return (float("-inf"), float("inf")) if self.part is None else (self.part.start, self.part.stop)

    @property
    def name(self) -> str:
        """The path of the files."""
        return str(self.source.path)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on the range and damage of the files; complete after the whole recording was read."""
        part = () if self.sample_range == WHOLE else (f"a part is used: {self.sample_range}",)
        return (*part, *self.source.notes)

    @property
    def message_count(self) -> int | None:
        """Number of messages; None where it is not known before reading."""
        total = 0
        for topic in self.topics:
            count = self.source.counts.get(topic)
            if count is None:
                return None
            total += count
        return total

    def signal_segments(
        self,
        statistics: SampleStatistics | None = None,
        rate: float | None = None,
        progress: ProgressWrapper | None = None,
    ) -> Iterator[SignalSegment]:
        """Yield the segments of the signals on a uniform grid.

        Parameters
        ----------
        statistics : counts of skipped samples, updated while reading.
        rate : samples per second of the grid; None: as recorded.
        progress : wraps the iterator over messages.

        Raises
        ------
        RecordingError
            Where signals of joints are missing, or the samples are too few.
        """
        statistics = SampleStatistics() if statistics is None else statistics
        samples = self.sample_range.select(self.source.samples(self.topics, self.base), statistics)
        samples = count_duration(samples, statistics)
        return resample_samples(samples if progress is None else progress(samples), self.signal_names, statistics, rate)

    def motions(
        self,
        statistics: SampleStatistics | None = None,
        *,
        cutoff: float | None = None,
        rate: float | None = None,
        progress: ProgressWrapper | None = None,
    ) -> Iterator[Motion]:
        """Yield the motions of the joints, filtered, in pieces that fit the memory; of a part also of its context.

        Parameters
        ----------
        statistics : counts of skipped samples, updated while reading.
        cutoff : cut-off frequency of the low-pass filter [Hz]; None: 8, or a fifth of the rate.
        rate, progress : as for `signal_segments`.

        Raises
        ------
        RecordingError
            As for `signal_segments`; and at the end, where no motion is left after filtering.
        """
        statistics = SampleStatistics() if statistics is None else statistics
        if self.part is not None:
            yield from self._part_motions(self.part, statistics, cutoff, progress)
            return
        is_empty = True
        for motion in filter_motions(self.signal_segments(statistics, rate, progress), self.drives, statistics, cutoff):
            is_empty = False
            yield motion
        if is_empty:
            unit = "row" if isinstance(self.source, Table) else "message"
            nothing = f"It has no {unit}" + ("" if self.sample_range == WHOLE else f" {self.sample_range}")
            reason = "; ".join([*self.notes, *statistics.sentences]) or nothing
            raise RecordingError(f"{self.name}: no samples are left. {reason}")

    def _part_motions(
        self, part: RecordingPart, statistics: SampleStatistics, cutoff: float | None, progress: ProgressWrapper | None
    ) -> Iterator[Motion]:
        """Yield the motions of a part and its context. Raises IndivisibleRecordingError where it depends on others."""
        assert isinstance(self.source, Bag), "tables have no parts"
        reader = PartReader(part, Resampler(self.signal_names, statistics, part=part), statistics)
        begin, end = part.read_range
        samples: Iterable[JointSample] = self.source.samples(self.topics, self.base, begin=begin, end=end)
        if part.begin is None:
            samples = self.sample_range.select(samples, statistics)
        samples = samples if progress is None else progress(samples)
        try:
            yield from filter_motions(reader.segments(samples), self.drives, statistics, cutoff)
        except RecordingError as error:
            raise IndivisibleRecordingError(str(error)) from None
        if self.source.notes:
            raise IndivisibleRecordingError(self.source.notes[0])
        reader.restore_counts()


def open_recording(
    path: str | Path,
    drives: Drives,
    topics: Sequence[str] = (),
    base: str | None = None,
    sample_range: SampleRange = WHOLE,
    part: RecordingPart | None = None,
) -> Recording:
    """Open a recording.

    Parameters
    ----------
    path : path of a bag (folder or file), a CSV file, or a folder of CSV files that `drives.tables` names.
    drives : conversion from the recorded signals to the joints.
    topics : topics to read; empty: all topics of joint states.
    base : name of the base link where the base moves: then a topic of odometry is read too.
    sample_range : the part of the recording that is used.
    part : as in Recording.

    Raises
    ------
    RecordingError
        Where the files cannot be read, or do not have the topics.
    MissingPackageError
        Where the package that reads bags is not installed.
    """
    path = Path(path)
    try:
        return recording_of(_open_source(path, drives), drives, topics, base, sample_range, part)
    except OSError as error:
        raise RecordingError(f"{path} cannot be read: {error.strerror}") from None


def recording_of(
    source: Bag | Table | MeasuredSamples,
    drives: Drives,
    topics: Sequence[str] = (),
    base: str | None = None,
    sample_range: SampleRange = WHOLE,
    part: RecordingPart | None = None,
) -> Recording:
    """The Recording of opened files, or of a measurement. Arguments and errors are those of `open_recording`."""
    base_topics = source.base_topics(topics) if base is not None else []
    joint_topics = source.joint_topics([topic for topic in topics if topic not in base_topics])
    return Recording(source, (*joint_topics, *base_topics), drives, base, sample_range, part)


def _open_source(path: Path, drives: Drives) -> Bag | Table:
    if not path.exists():
        raise RecordingError(f"{path} does not exist")
    if path.suffix == ".csv":
        return Table(path)
    if path.is_dir() and drives.tables is not None:
        return Table(path, drives.tables)
    return Bag(path)


def require_motors(dynamics: Dynamics) -> None:
    """Refuse a robot whose recordings cannot be read. Raises RecordingError."""
    if dynamics.unactuated_joint_names:
        raise RecordingError(
            f"{dynamics.robot.name!r}: no motor drives {', '.join(dynamics.unactuated_joint_names)}: recordings are "
            "read for robots whose independent joints are all actuated; passive joints of closed loops need no motor"
        )


def moving_base_link(dynamics: Dynamics) -> str | None:
    """The argument `base` of `open_recording` for a robot: name of its base link where it moves, else None."""
    return dynamics.robot.base_link if dynamics.robot.moving_base else None
