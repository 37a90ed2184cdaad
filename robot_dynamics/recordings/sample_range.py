"""A part of a recording, by time or by the number of messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import islice
from typing import TYPE_CHECKING

from robot_dynamics.recordings.stray_start import skip_stray_start

if TYPE_CHECKING:
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.sample_statistics import SampleStatistics


@dataclass(frozen=True)
class SampleRange:
    """The messages of a recording (rows of a table) that are used; the others are not read into any result.

    Times of results count from the first message that is used.

    Attributes
    ----------
    start, end : times [s] after the first message that `skip_stray_start` does not skip, by stamps; `end` is not
        included. None: no limit.
    first, last : numbers of messages, the first one being 0; `last` is not included. None: no limit.
    """

    start: float | None = None
    end: float | None = None
    first: int | None = None
    last: int | None = None

    def select(self, samples: Iterable[JointSample], statistics: SampleStatistics) -> Iterator[JointSample]:
        """Yield the samples in the range; `statistics` counts those that are skipped for their stamps."""
        origin: int | None = None
        for number, sample in skip_stray_start(islice(samples, self.last), statistics):
            stamp = sample.stamp or sample.receive_time
            origin = stamp if origin is None else origin
            time = (stamp - origin) / 1e9
            is_in_time = (self.start is None or time >= self.start) and (self.end is None or time < self.end)
            if is_in_time and number >= (self.first or 0):
                yield sample

    def __str__(self) -> str:
        parts = []
        if self.start is not None:
            parts.append(f"from {self.start:g} s")
        if self.end is not None:
            parts.append(f"to {self.end:g} s")
        if self.first is not None or self.last is not None:
            first = 0 if self.first is None else self.first
            parts.append(f"messages {first}:{'' if self.last is None else self.last}")
        return " ".join(parts)


WHOLE = SampleRange()
