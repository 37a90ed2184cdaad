"""Bands: samples of the joints that are recorded together, with the steps and gaps between them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple, TypeAlias

import numpy as np

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.recordings.message_layouts import JointNumbers
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

GAP_STEPS = 5.5  # steps of the grid, or of a slower topic, without a sample that are a gap
OVERLAP_SAMPLES = 8  # samples kept on each side for the interpolation of a segment
MIN_SAMPLES = 8  # samples that are needed to measure a step
MAX_STEPS_KEPT = 1000  # latest steps of a band, whose typical value is used
BURST_RATIO = 2.0  # mean step over median step, beyond which stamps come in bursts and the mean is the step
MIN_BURST_SAMPLES = 50  # samples that are needed to detect bursts
MAX_MAGNITUDE = 1e9  # of positions, velocities and efforts [SI units]; squares of their sums keep all digits
MIN_STEP_RATIO = 0.3  # of a step: the slope of a spline through two closer samples would be their noise

Interval: TypeAlias = tuple[float, float]


class SampleRow(NamedTuple):
    """Signals of the joints of one message: time [s]; position, velocity, effort (k,), nan where not measured."""

    time: float
    position: Array
    velocity: Array
    effort: Array


class Band(NamedTuple):
    """Samples (M,) of k joints that are recorded together, in the order of time.

    joints: their numbers; times: (M,) [s]; position, velocity, effort: (M, k).
    """

    joints: JointNumbers
    times: Array
    position: Array
    velocity: Array
    effort: Array

    @property
    def signals(self) -> tuple[Array, Array, Array]:
        """Positions, velocities and efforts."""
        return self.position, self.velocity, self.effort

    def select(self, rows: BoolArray | IntArray | slice) -> Band:
        """The band of some rows: a mask (M,), row numbers or a slice."""
        return Band(self.joints, self.times[rows], self.position[rows], self.velocity[rows], self.effort[rows])

    def rows(self) -> list[SampleRow]:
        """The samples one by one."""
        return list(map(SampleRow, self.times, *self.signals))

    def intervals(self, gap: float) -> list[Interval]:
        """(start, end) [s] of the pieces between gaps longer than `gap` [s]."""
        if len(self.times) == 0:
            return []
        cuts = np.flatnonzero(np.diff(self.times) > gap)
        return list(zip(self.times[[0, *(cuts + 1)]], self.times[[*cuts, -1]], strict=True))

    def spline_range(self, start: float, end: float, gap: float) -> slice:
        """Rows that a spline from start to end [s] uses: some beyond both ends, none beyond a gap."""
        first = max(0, int(np.searchsorted(self.times, start)) - OVERLAP_SAMPLES)
        stop = min(len(self.times), int(np.searchsorted(self.times, end, side="right")) + OVERLAP_SAMPLES)
        cuts = 1 + first + np.flatnonzero(np.diff(self.times[first:stop]) > gap)
        before = cuts[self.times[cuts] <= start]
        after = cuts[self.times[cuts] > end]
        return slice(int(before[-1]) if len(before) else first, int(after[0]) if len(after) else stop)


class StepHistory:
    """The latest steps between samples of a band, over chunks that overlap."""

    def __init__(self) -> None:
        self._steps = np.zeros(0)
        self._latest = -np.inf

    def add(self, times: Array) -> None:
        """Append the steps [s] between times (M,) that are later than all before."""
        if len(times) and times[-1] > self._latest:
            new = times[max(0, int(np.searchsorted(times, self._latest, side="right")) - 1) :]
            self._steps = np.concatenate([self._steps, np.diff(new)])[-MAX_STEPS_KEPT:]
            self._latest = times[-1]

    @property
    def typical(self) -> float:
        """Typical step [s]; 0 where too few steps are known."""
        return typical_step(self._steps) if len(self._steps) >= MIN_SAMPLES - 1 else 0.0

    def gap(self, step: float) -> float:
        """Time without a sample [s] that is a gap, on a grid of this step [s]."""
        if len(self._steps) < MIN_SAMPLES - 1:
            return GAP_STEPS * step
        typical = typical_step(self._steps)
        mean = float(np.mean(self._steps[self._steps <= GAP_STEPS * typical]))
        return GAP_STEPS * max(step, typical, mean)


def typical_step(steps: Array) -> float:
    """Typical step [s] between samples, of steps (M,).

    The median; the mean without gaps where that is much longer, as where stamps come in bursts.
    """
    median = np.median(steps)
    mean = np.mean(steps)
    while mean > BURST_RATIO * median and len(steps) >= MIN_BURST_SAMPLES:
        without_gaps = steps[steps <= GAP_STEPS * mean]
        if len(without_gaps) == len(steps):
            return float(mean)
        steps = without_gaps
        mean = np.mean(steps)
    return float(median)


def measure_step(bands: Sequence[Band], final: bool, statistics: SampleStatistics) -> float | None:
    """Step [s] of the band with the highest rate; None where more samples are needed.

    final: no more samples come; then too few of them raise RecordingError.
    """
    steps = [np.diff(band.times) for band in bands if len(band.times) >= MIN_SAMPLES]
    if not final and any(map(_needs_more_steps, steps)):
        return None
    shortest = min(map(typical_step, steps), default=None)
    if shortest is None and final:
        count = max((len(band.times) for band in bands), default=0)
        notes = "".join(f"; {sentence}" for sentence in statistics.sentences)
        raise RecordingError(f"{count} samples of the joints: at least {MIN_SAMPLES} are needed{notes}")
    return shortest


def _needs_more_steps(steps: Array) -> bool:
    """Whether steps (M,) are too few to distinguish gaps from bursts."""
    return len(steps) < MIN_BURST_SAMPLES and bool(np.mean(steps) > BURST_RATIO * np.median(steps))


def collect_bands(
    rows: Mapping[JointNumbers, Sequence[SampleRow]], joint_count: int, statistics: SampleStatistics
) -> list[Band]:
    """Group rows by the joints that are always recorded together; invalid rows are dropped and counted.

    rows: {numbers of the joints of a message: its samples}; a joint may be in several kinds of messages.
    """
    joints_by_keys: dict[tuple[JointNumbers, ...], list[int]] = {}
    for joint in range(joint_count):
        keys = tuple(key for key in rows if joint in key)
        if keys:
            joints_by_keys.setdefault(keys, []).append(joint)
    return [_valid_rows(_merge_rows(rows, keys, tuple(joints)), statistics) for keys, joints in joints_by_keys.items()]


def _merge_rows(
    rows: Mapping[JointNumbers, Sequence[SampleRow]], keys: tuple[JointNumbers, ...], joints: JointNumbers
) -> Band:
    """Samples of some joints from all messages that have them, sorted by time."""
    parts = []
    for key in keys:
        columns = [key.index(joint) for joint in joints]
        times, *signals = (np.array(values) for values in zip(*rows[key], strict=True))
        parts.append(Band(joints, times, *(values[:, columns] for values in signals)))
    if len(parts) == 1:
        return parts[0]
    _, *arrays = zip(*parts, strict=True)
    band = Band(joints, *map(np.concatenate, arrays))
    return band.select(np.argsort(band.times, kind="stable"))


def _valid_rows(band: Band, statistics: SampleStatistics) -> Band:
    """The rows that are finite, not too large to compute with, and later than all before them."""
    times = band.times
    late = np.zeros(len(times), dtype=bool)
    late[1:] = times[1:] <= np.maximum.accumulate(times)[:-1]
    repeated = late.copy()
    repeated[1:] &= np.diff(times) == 0
    measured = np.isfinite(band.effort).any(axis=0)
    finite = np.isfinite(band.position).all(axis=1) & np.isfinite(band.effort[:, measured]).all(axis=1)
    # nan, of values that were not measured, is not large
    unbounded = np.any([(np.abs(values) > MAX_MAGNITUDE).any(axis=1) for values in band.signals], axis=0) & finite
    statistics.counts["duplicates"] += int(repeated.sum())
    statistics.counts["out_of_order"] += int((late & ~repeated).sum())
    statistics.counts["not_finite"] += int((~finite & ~late).sum())
    statistics.counts["unbounded"] += int((unbounded & ~late).sum())
    return band.select(finite & ~unbounded & ~late)


def drop_close_samples(band: Band, typical: float, statistics: SampleStatistics) -> Band:
    """Drop samples that follow the one before in much less than the typical step [s]; they are counted."""
    shortest = MIN_STEP_RATIO * typical
    if len(band.times) < 2 or np.diff(band.times).min() >= shortest:
        return band
    kept = np.zeros(len(band.times), dtype=bool)
    latest = -np.inf
    for row, time in enumerate(band.times):
        if time - latest >= shortest:
            kept[row] = True
            latest = time
    statistics.counts["too_close"] += int((~kept).sum())
    return band.select(kept)


def intersect_intervals(lists: Sequence[list[Interval]]) -> list[Interval]:
    """The intervals that all lists of intervals have in common."""
    common = lists[0]
    for intervals in lists[1:]:
        pairs = ((max(a, c), min(b, d)) for a, b in common for c, d in intervals)
        common = [(start, end) for start, end in pairs if start <= end]
    return common
