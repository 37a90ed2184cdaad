"""The time that the messages of a recording cover, to compare with the time that could be used."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

MAX_STEP = 1.0  # [s] between two messages; during a longer one the recording was paused, or the clock jumped


class RecordedDuration:
    """Sums the steps of the latest stamp; older stamps, as of another topic, and pauses do not count.

    Attributes
    ----------
    latest_stamp : [ns] the latest since the last jump of the clock; None before the first message.
    """

    def __init__(self) -> None:
        self.latest_stamp: int | None = None
        self._nanoseconds = 0

    def feed(self, sample: JointSample) -> None:
        """Add a message."""
        stamp = sample.stamp or sample.receive_time
        if self.latest_stamp is None or abs(stamp - self.latest_stamp) > MAX_STEP * 1e9:
            self.latest_stamp = stamp
        elif stamp > self.latest_stamp:
            self._nanoseconds += stamp - self.latest_stamp
            self.latest_stamp = stamp

    @property
    def seconds(self) -> float:
        """The sum [s]."""
        return self._nanoseconds / 1e9


def count_duration(samples: Iterable[JointSample], statistics: SampleStatistics) -> Iterator[JointSample]:
    """Yield the samples; `statistics.recorded_duration` has their duration."""
    duration = RecordedDuration()
    for sample in samples:
        duration.feed(sample)
        statistics.recorded_duration = duration.seconds
        yield sample
