"""Parts of long recordings: ranges of messages that are read by themselves, in one process or in many.

A part is read with the messages before and after it, its context, so that filters and the models of stamps have settled
where the part begins. The grid of the first part goes on in all others. Each sample belongs to one part, by its time.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.recorded_duration import RecordedDuration

if TYPE_CHECKING:
    from robot_dynamics.recordings.alignment import Resampler, SignalSegment
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.sample_statistics import SampleStatistics


class IndivisibleRecordingError(RecordingError):
    """Parts of a recording depend on each other, as after a clock jump: it must be read as a whole."""


@dataclass(frozen=True)
class RecordingPart:
    """A part of a recording.

    Attributes
    ----------
    begin, end : times of recording [ns] of its messages, `end` not included; None: those of the recording.
    context : time [ns] before and after it that is read too.
    start, stop : times [s] of its samples after the beginning of the recording, `stop` not included.
    duration : of the recording [s].
    step : of the grid [s].
    anchor : time of a point of the grid [s].
    offset : added to stamps [ns] to get times.
    sources : topic of each joint, by its number.
    """

    begin: int | None
    end: int | None
    context: int
    start: float
    stop: float
    duration: float
    step: float
    anchor: float
    offset: int
    sources: tuple[tuple[int, str], ...]

    @property
    def read_range(self) -> tuple[int | None, int | None]:
        """Times of recording [ns] of the messages to read, with the context."""
        begin = None if self.begin is None else self.begin - self.context
        return begin, None if self.end is None else self.end + self.context

    def contains(self, receive_time: int) -> bool:
        """Whether a message with a time of recording [ns] belongs to the part, and not to its context."""
        return (self.begin is None or receive_time >= self.begin) and (self.end is None or receive_time < self.end)


class PartReader:
    """Resamples the messages of a part and its context; statistics are those of the part alone.

    Parameters
    ----------
    part : RecordingPart
    resampler : Resampler
        That begins with the part.
    statistics : SampleStatistics
        Counts of skipped samples, updated while reading.
    """

    def __init__(self, part: RecordingPart, resampler: Resampler, statistics: SampleStatistics) -> None:
        self._part = part
        self._resampler = resampler
        self._statistics = statistics
        self._kept: tuple[Counter[str], int, int] | None = None  # counts, messages and samples at the end of the part

    def segments(self, samples: Iterable[JointSample]) -> Iterator[SignalSegment]:
        """Yield the segments of the part and its context. Raises IndivisibleRecordingError."""
        part, resampler, statistics = self._part, self._resampler, self._statistics
        duration = RecordedDuration()
        earlier: float | None = None  # duration of the context before the part
        for sample in samples:
            if earlier is None and (part.begin is None or sample.receive_time >= part.begin):
                yield from resampler.drain()
                earlier = duration.seconds
                statistics.counts.clear()
                statistics.messages = statistics.samples = 0
            if self._kept is None and part.end is not None and sample.receive_time >= part.end:
                yield from resampler.drain()
                self._keep_counts()
            duration.feed(sample)
            if earlier is not None and self._kept is None:
                statistics.recorded_duration = duration.seconds - earlier
            resampler.feed(sample)
            if statistics.counts["clock_jumps"]:
                raise IndivisibleRecordingError("the clock jumps")
            if resampler.is_full:
                yield from resampler.drain()
        yield from resampler.drain(final=True)

    def _keep_counts(self) -> None:
        statistics = self._statistics
        self._kept = Counter(statistics.counts), statistics.messages, statistics.samples

    def restore_counts(self) -> None:
        """Remove what was counted after the part."""
        if self._kept is not None:
            counts, messages, samples = self._kept
            self._statistics.counts = Counter(counts)  # type: ignore[arg-type]
            self._statistics.messages, self._statistics.samples = messages, samples
