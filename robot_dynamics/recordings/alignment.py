"""From messages to signal segments: joints of all topics on one uniform grid, in pieces that fit the memory.

Stamps may jump, repeat or run back, joints may be spread over messages and topics in any order, values may be missing.
SampleStatistics counts all of these cases, and nothing is filled in across a gap.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.clock import Clock
from robot_dynamics.recordings.message_layouts import MessageLayouts
from robot_dynamics.recordings.sample_bands import (
    OVERLAP_SAMPLES,
    SampleRow,
    StepHistory,
    collect_bands,
    drop_close_samples,
    intersect_intervals,
    measure_step,
)
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.sample_streams import SampleStream
from robot_dynamics.recordings.signals import MIN_SPLINE_SAMPLES, interpolate_on_grid

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.message_layouts import JointNumbers
    from robot_dynamics.recordings.position_jumps import PositionJump
    from robot_dynamics.recordings.recording_parts import RecordingPart
    from robot_dynamics.recordings.sample_bands import (
        Band,
        Interval,
    )

MESSAGES_PER_CHUNK = 20_000  # messages that are resampled at once


@dataclass(frozen=True, eq=False)
class SignalSegment:
    """Samples without a gap on a uniform grid.

    Attributes
    ----------
    time : of the first sample [s] after the beginning of the recording.
    rate : samples per second.
    position, velocity, effort : (N, k); columns of velocity and effort are nan where they were not measured.
    is_continuation : whether the segment begins where the segment before it ended.
    jump : jump of the positions before the first sample; None where there is none.
    recorded : (N,) number of samples that were recorded in each step of the grid; None where it is not known.
    """

    time: float
    rate: float
    position: Array
    velocity: Array
    effort: Array
    is_continuation: bool
    jump: PositionJump | None = None
    recorded: Array | None = None

    def __len__(self) -> int:
        return len(self.position)


class Resampler:
    """Resamples joint samples: `feed` takes them one by one, `drain` returns the segments that are complete.

    Parameters
    ----------
    names : names of the k joints, in the order of the columns of the segments.
    statistics : counts of skipped samples, updated while reading.
    rate : samples per second of the grid; None: as recorded.
    part : the part of a recording whose samples are given, with the step, the grid and the clock of the recording.

    Attributes
    ----------
    step : step of the grid [s]; None until it is measured.
    finished : segments that a clock jump ended; the caller takes and clears them.
    """

    def __init__(
        self,
        names: Sequence[str],
        statistics: SampleStatistics,
        rate: float | None = None,
        part: RecordingPart | None = None,
    ) -> None:
        self.names = tuple(names)
        self.statistics = statistics
        self.step = None if rate is None else 1 / rate
        self._anchor: float | None = None  # a point of the grid [s], for the first segment
        if part is not None:
            self.step, self._anchor = part.step, part.anchor
        self.finished: list[SignalSegment] = []
        self._layouts = MessageLayouts(self.names, statistics, () if part is None else part.sources)
        self._clock = Clock(statistics, None if part is None else part.offset)
        self._streams: dict[JointNumbers, SampleStream] = {}  # by the joints of a message
        self._rows: dict[JointNumbers, list[SampleRow]] = {}  # with known times
        self._new_rows = 0  # since the last `drain`
        self._end: float | None = None  # time of the last sample on the grid
        self._short_end = -np.inf  # end of the last piece that was skipped
        self._gaps_counted_to: dict[JointNumbers, float] = {}  # by the joints of a band
        self._step_histories: dict[JointNumbers, StepHistory] = {}  # by the joints of a band

    def feed(self, sample: JointSample) -> None:
        """Add one sample; segments that a clock jump ends are appended to `finished`.

        Raises RecordingError where a joint is twice in the message, or joints are missing at a clock jump.
        """
        self.statistics.messages += 1
        joints, columns = self._layouts.layout(sample)
        if not joints:
            self.statistics.counts["no_known_joint"] += 1
            return
        size = len(sample.names)
        if len(sample.position) != size:
            self.statistics.counts["length_mismatch"] += 1
            return
        time = self._clock.time(sample)
        if self._clock.jumped:
            self.finished += self.drain(final=True)
        missing = np.full(len(joints), np.nan)
        velocity = sample.velocity[columns] if len(sample.velocity) == size else missing
        effort = sample.effort[columns] if len(sample.effort) == size else missing
        if joints not in self._streams:
            self._streams[joints] = SampleStream(sample.source, self.statistics)
        self._streams[joints].add(SampleRow(time, sample.position[columns], velocity, effort))
        self._new_rows += 1

    @property
    def is_full(self) -> bool:
        """Whether a chunk of messages is complete, so that `drain` should be called."""
        return self._new_rows >= MESSAGES_PER_CHUNK

    @property
    def pending_rows(self) -> int:
        """Rows that are not on the grid yet, or wait for their times or for joints without messages."""
        return sum(map(len, self._rows.values())) + sum(map(len, self._streams.values()))

    @property
    def sources(self) -> dict[int, str]:
        """{number of a joint: the topic that it is read from}."""
        return self._layouts.sources

    @property
    def offset(self) -> int | None:
        """Added to stamps [ns] to get times, at the current state of the clock; None before the first sample."""
        return self._clock.offset

    def drain(self, final: bool = False) -> list[SignalSegment]:
        """Return the segments that are complete.

        Parameters
        ----------
        final : return all, and start anew: later samples do not continue the last segment.

        Raises
        ------
        RecordingError
            With `final`, where joints are missing or the samples are too few to measure their rate.
        """
        for joints, stream in self._streams.items():
            released = stream.release(final)
            if released:
                self._rows.setdefault(joints, []).extend(released)
        recorded = {joint for joints in self._rows for joint in joints}
        missing = [name for joint, name in enumerate(self.names) if joint not in recorded]
        if missing and not (final and self.statistics.messages):
            return []
        if missing:
            self._clear()
            names = ", ".join(self.names[joint] for joint in sorted(recorded)) or "none of them"
            raise RecordingError(
                f"joints missing: {', '.join(missing)}. Positions of all joints are needed, recorded are: {names}"
            )
        try:
            bands = collect_bands(self._rows, len(self.names), self.statistics)
            segments, bands, limit = self._resample_bands(bands, final)
        except Exception:
            self._clear()  # else the same rows would raise the error again in each call
            raise
        self.statistics.samples += sum(map(len, segments))
        if final:
            self._clear()
        else:
            self._keep_overlap(bands, limit)
        return segments

    def _resample_bands(self, bands: list[Band], final: bool) -> tuple[list[SignalSegment], list[Band], float]:
        """Returns the segments of bands; the bands; the time [s] up to which they are on the grid or skipped."""
        has_empty_band = not final and any(len(band.times) == 0 for band in bands)
        if has_empty_band:
            return [], bands, -np.inf
        if self.step is None:
            self.step = measure_step(bands, final, self.statistics)
        if self.step is None:
            return [], bands, -np.inf
        bands = [self._drop_close_samples(band) for band in bands]
        limit = np.inf if final else min(band.times[-1] for band in bands)
        segments, pending_start = self._segments(bands, limit, self.step)
        return segments, bands, min(limit, pending_start)

    def _drop_close_samples(self, band: Band) -> Band:
        history = self._step_histories.setdefault(band.joints, StepHistory())
        history.add(band.times)
        return drop_close_samples(band, history.typical, self.statistics)

    def _segments(self, bands: list[Band], limit: float, step: float) -> tuple[list[SignalSegment], float]:
        """Segments up to a time [s], and the start of a piece that has too few samples so far (inf: none).

        A piece between two gaps with too few samples for a spline is skipped and counted.
        """
        segments = []
        pending_start = np.inf
        gaps = {band.joints: self._step_histories[band.joints].gap(step) for band in bands}
        for start, end in intersect_intervals([self._intervals(band, gaps[band.joints]) for band in bands]):
            done = self._short_end if self._end is None else max(self._short_end, self._end + 0.5 * step)
            if start > limit or end <= done:
                continue
            ranges = [band.spline_range(start, min(end, limit), gaps[band.joints]) for band in bands]
            if all(rows.stop - rows.start >= MIN_SPLINE_SAMPLES for rows in ranges):
                segment = self._segment(bands, gaps, start, min(end, limit), step)
                if segment is not None:
                    segments.append(segment)
            elif end >= limit:
                pending_start = start
            else:
                self.statistics.counts["too_short"] += _grid_size(start, end, step)
                self._short_end = end
        return segments, pending_start

    def _intervals(self, band: Band, gap: float) -> list[Interval]:
        """(start, end) of the pieces of a band between gaps; gaps that are new are counted."""
        intervals = band.intervals(gap)
        if len(band.times) > 1:
            counted_to = self._gaps_counted_to.get(band.joints, -np.inf)
            self.statistics.counts["gaps"] += sum(bool(start > counted_to) for start, _ in intervals[1:])
            self._gaps_counted_to[band.joints] = band.times[-1]
        return intervals

    def _segment(
        self, bands: list[Band], gaps: dict[JointNumbers, float], start: float, end: float, step: float
    ) -> SignalSegment | None:
        """The segment from start to end [s]; None where the grid has no new point there."""
        is_continuation = self._end is not None and start <= self._end + 1e-6 * step
        first = self._end + step if self._end is not None and is_continuation else start
        if self._anchor is not None:
            first = self._anchor + step * np.ceil((start - self._anchor) / step - 1e-3)
            self._anchor = None
        size = _grid_size(first, end, step)
        if size < 1:
            return None
        grid = first + step * np.arange(size, dtype=np.float64)
        signals = np.full((3, size, len(self.names)), np.nan)
        for band in bands:
            rows = band.spline_range(grid[0], grid[-1], gaps[band.joints])
            for columns, values in zip(signals, band.signals, strict=True):
                columns[:, band.joints] = interpolate_on_grid(band.times[rows], values[rows], grid)
        self._end = grid[-1]
        position, velocity, effort = signals
        densest = max(bands, key=lambda band: len(band.times))
        edges = np.r_[grid - 0.5 * step, grid[-1] + 0.5 * step]
        recorded = np.diff(np.searchsorted(densest.times, edges)).astype(float)
        return SignalSegment(float(first), 1 / step, position, velocity, effort, is_continuation, recorded=recorded)

    def _keep_overlap(self, bands: list[Band], limit: float) -> None:
        """Keep only the rows that the interpolation of the next samples needs."""
        self._rows = {}
        for band in bands:
            first = max(0, int(np.searchsorted(band.times, limit)) - OVERLAP_SAMPLES)
            if first < len(band.times):
                self._rows[band.joints] = band.select(slice(first, None)).rows()
        self._new_rows = 0

    def _clear(self) -> None:
        """Drop all rows; the next segment continues none."""
        self._streams = {}
        self._rows = {}
        self._new_rows = 0
        self._end = None


def _grid_size(first: float, end: float, step: float) -> int:
    """Points of a grid from its first time to another [s]."""
    return int(np.floor((end - first) / step + 1e-3)) + 1


def resample_samples(
    samples: Iterable[JointSample],
    names: Sequence[str],
    statistics: SampleStatistics | None = None,
    rate: float | None = None,
) -> Iterator[SignalSegment]:
    """Yield the segments of joint samples: positions, velocities and efforts of the joints `names`, in this order.

    rate: samples per second of the grid; None: as recorded. Raises RecordingError.
    """
    resampler = Resampler(names, SampleStatistics() if statistics is None else statistics, rate)
    for sample in samples:
        resampler.feed(sample)
        yield from resampler.finished
        resampler.finished = []
        if resampler.is_full:
            yield from resampler.drain()
    yield from resampler.drain(final=True)
