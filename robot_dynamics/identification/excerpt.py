"""Regression rows of one recording: filtered, decimated, and summed for least squares.

Efforts and regressor pass the same low-pass filter (parallel filtering), so that the filter has the same effect on both
sides of the equations. The rows are then decimated. The remaining noise lies within the band of the filter, so that
neighbouring samples are correlated; variances count the independent samples that the band allows.

A joint at rest holds any effort within its static friction. Its samples at rest, and those that the filter mixes with
rest, do not count in its equations, nor in the residuals. They count in the equations of the joints that move.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import minimum_filter1d

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.motion_blocks import MOTION_BLOCK_DURATION, MotionBlocks
from robot_dynamics.identification.sample_sums import FactorSums, QualitySums
from robot_dynamics.identification.triangular_factors import TriangularFactors
from robot_dynamics.recordings.position_limits import note_limit_violations
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import filter_margin, lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.identification_model import EffortModel
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.recording import Recording

MAX_BAND = 10.0  # [Hz] default band of the parallel filter if the cut-off of the motion is higher
SAMPLES_PER_PERIOD = 4  # after decimation, of the highest frequency in the band
NOISE_BANDWIDTH = 0.875 * (np.pi / 8) / np.sin(np.pi / 8)  # ∫ (1 + x⁸)⁻² dx: forward-backward filter of cut-off 1
HUBER_THRESHOLD = 1.345  # [standard deviations] beyond which the robust method weights residuals linearly
REST_REACH_PERIODS = 0.5  # of the band, within which the parallel filter spreads a rest (main lobe of its response)
MIN_PIECE_SAMPLES = 100  # shorter pieces of motion are left out
MAX_PIECE_SAMPLES = 20_000  # samples whose regressor is in memory at once


@dataclass(frozen=True, eq=False)
class ExcerptSettings:
    """Filter and time range of the samples of recordings.

    cutoff: [Hz] of the low-pass filter of the motions, None: its default; band: [Hz] of the parallel filter, None: the
    cut-off, at most MAX_BAND; start_fraction, end_fraction: range of samples as fractions of the duration, 0 to 1.
    """

    cutoff: float | None = None
    band: float | None = None
    start_fraction: float = 0.0
    end_fraction: float = 1.0


@dataclass(frozen=True, eq=False)
class RegressionRows:
    """Filtered, decimated columns X (N, n, P) and efforts y (N, n) at times (N,) [s].

    q, qd: (N, n) positions and velocities; moving: (N, n) whether a joint moves, also within the reach of the filter;
    effective_samples: number of independent samples per row, at most 1.
    """

    times: Array
    q: Array
    qd: Array
    moving: BoolArray
    X: Array
    y: Array
    effective_samples: float

    def within(self, start: float, stop: float) -> RegressionRows:
        """The rows at times [s] from start on, before stop."""
        first, last = np.searchsorted(self.times, [start, stop])
        rows = slice(int(first), int(last))
        return RegressionRows(
            self.times[rows],
            self.q[rows],
            self.qd[rows],
            self.moving[rows],
            self.X[rows],
            self.y[rows],
            self.effective_samples,
        )


class Excerpt:
    """The regression rows of a time range of one recording.

    Iteration computes the rows, and keeps them for the next iteration if they need less than cache_bytes. In another
    process they are computed again. notes: sentences on damage of the files; statistics: counts of samples that were
    left out; both are complete after an iteration. Of a part of a recording, rows and samples of its context are left
    out.
    """

    def __init__(self, recording: Recording, model: EffortModel, settings: ExcerptSettings, cache_bytes: int) -> None:
        self.recording = recording
        self.model = model.for_recording(recording)
        self.settings = settings
        self.cache_bytes = cache_bytes
        self.notes: tuple[str, ...] = ()
        self.statistics = SampleStatistics()
        self._cached_rows: list[RegressionRows] | None = None
        self._cached_duration: float | None = None

    def __getstate__(self) -> dict[str, object]:
        return {**vars(self), "_cached_rows": None, "cache_bytes": 0}

    def __iter__(self) -> Iterator[RegressionRows]:
        if self._cached_rows is not None:
            yield from self._cached_rows
            return
        cached: list[RegressionRows] = []
        size = 0
        for motion, core in self._pieces():
            rows = self._regression_rows(motion, core).within(*self.recording.time_range)
            if not len(rows.times):
                continue
            size += rows.X.nbytes
            if size < self.cache_bytes:
                cached.append(rows)
            yield rows
        if size < self.cache_bytes:
            self._cached_rows = cached

    def accumulate_factors(self, values: Array | None = None, standard_deviations: Array | None = None) -> FactorSums:
        """Sum the triangular factors; with values (P,) and standard deviations (n,): with Huber weights."""
        total = FactorSums(None, np.zeros(len(self.model.dynamics.joint_names)))
        for rows in self:
            weights = rows.moving.astype(float)
            if values is not None and standard_deviations is not None:
                deviation = np.abs(rows.y - rows.X @ values) / (HUBER_THRESHOLD * standard_deviations)
                weights = weights / np.maximum(1, deviation)
            number = np.floor(rows.times / MOTION_BLOCK_DURATION).astype(int)
            for block in np.split(np.arange(len(number)), np.flatnonzero(np.diff(number)) + 1):
                factors = TriangularFactors.from_samples(rows.X[block], rows.y[block], weights[block])
                if not factors.samples.any():
                    continue
                blocks = MotionBlocks.of_samples(self.recording.name, rows.q[block], rows.qd[block], factors)
                total = total + FactorSums(blocks, rows.effective_samples * factors.samples.astype(float))
        return total

    def quality_sums(self, values: Array) -> QualitySums:
        """Sum the residuals of K sets of values (K, P)."""
        n = len(self.model.dynamics.joint_names)
        K = len(values)
        total = QualitySums(np.zeros((K, n)), np.zeros((2, n)), np.zeros(n, int), np.zeros((K, n)), np.zeros(n, int), 0)
        for rows in self:
            residuals = _sum_of_squares(rows.X, rows.y, rows.moving, values)
            y = rows.y * rows.moving
            sums = QualitySums(
                residuals, np.stack([(y * y).sum(0), y.sum(0)]), rows.moving.sum(0), 0 * residuals, np.zeros(n, int), 0
            )
            total = total + sums
        for piece, core in self._pieces():
            motion = self._own_samples(piece.slice_samples(core.start, core.stop))
            if not len(motion):
                continue
            unfiltered = _sum_of_squares(
                self.model.motion_regressor(motion), self.model.efforts(motion), motion.moving, values
            )
            total = total + QualitySums(
                np.zeros((K, n)), np.zeros((2, n)), np.zeros(n, int), unfiltered, motion.moving.sum(0), len(motion)
            )
        return total

    def _pieces(self) -> Iterator[tuple[Motion, slice]]:
        """Yield pieces of motion that fit into memory, and the slice of samples without the margins of the filter."""
        pending: Motion | None = None
        first = 0
        for motion in self._motions():
            if pending is not None and abs(motion.time - pending.end) * motion.rate < 0.5:
                pending = pending.concatenate(motion)
            else:
                if pending is not None and len(pending) > MIN_PIECE_SAMPLES:
                    yield pending, slice(first, len(pending))
                pending = motion
                first = 0
            margin = filter_margin(motion.rate, self._band(motion))
            if len(pending) > MAX_PIECE_SAMPLES + first + margin:
                yield pending, slice(first, len(pending) - margin)
                pending = pending.slice_samples(len(pending) - 2 * margin, len(pending))
                first = margin
        if pending is not None and len(pending) > MIN_PIECE_SAMPLES:
            yield pending, slice(first, len(pending))

    def _motions(self) -> Iterator[Motion]:
        """Yield the motions of the recording within the time range."""
        settings = self.settings
        statistics = SampleStatistics()
        start = settings.start_fraction * self._duration()
        end = settings.end_fraction * self._duration()
        for motion in self.recording.motions(statistics, cutoff=settings.cutoff):
            own = self._own_samples(motion)
            if len(own):
                note_limit_violations(self.model.dynamics, own, statistics)
            self._require_efforts(motion)
            first, last = np.searchsorted(motion.times, [start - 1e-9, end - 1e-9])
            last = len(motion) if settings.end_fraction >= 1 else last
            if last > first:
                yield motion.slice_samples(first, last)
        self.notes = self.recording.notes
        self.statistics = statistics

    def _own_samples(self, motion: Motion) -> Motion:
        """The samples of a motion that belong to the recording, or to the part of it."""
        first, last = np.searchsorted(motion.times, self.recording.time_range)
        return motion.slice_samples(int(first), int(last))

    def _require_efforts(self, motion: Motion) -> None:
        """Raise RecordingError if a joint has no measured efforts: the zeros in their place would be fitted."""
        if motion.has_efforts.all():
            return
        joints = np.array(self.model.dynamics.joint_names)[~motion.has_efforts]
        notes = "".join(f"; {note}" for note in self.recording.notes)
        raise RecordingError(
            f"{self.recording.name}: no measured efforts of {', '.join(joints)}: identification needs the efforts of "
            f"all joints{notes}"
        )

    def _duration(self) -> float:
        """Duration [s] of the recording, read only if the time range depends on it."""
        if self.settings.start_fraction <= 0 and self.settings.end_fraction >= 1:
            return 0.0
        if self.recording.part is not None:
            return self.recording.part.duration
        if self._cached_duration is None:
            segments = self.recording.signal_segments()
            self._cached_duration = max((s.time + len(s) / s.rate for s in segments), default=0.0)
        return self._cached_duration

    def _band(self, motion: Motion) -> float:
        band = min(MAX_BAND, motion.cutoff) if self.settings.band is None else self.settings.band
        if not 0 < band < motion.rate / 2:
            raise RecordingError(f"band of {band:g} Hz: a frequency between 0 and {motion.rate / 2:.4g} Hz is needed")
        return band

    def _regression_rows(self, motion: Motion, core: slice) -> RegressionRows:
        """Filter and decimate the samples `core` of a motion."""
        band = self._band(motion)
        stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * band)))
        decimated = slice(core.start, core.stop, stride)
        X = self.model.motion_regressor(motion)
        columns = lowpass(X.reshape(len(X), -1), motion.rate, band)[decimated]
        y = lowpass(self.model.efforts(motion), motion.rate, band)[decimated]
        reach = int(np.ceil(REST_REACH_PERIODS * motion.rate / band))
        moving = minimum_filter1d(motion.moving.astype(np.int8), 2 * reach + 1, axis=0)[decimated] > 0
        effective_samples = min(1.0, 2 * NOISE_BANDWIDTH * band * stride / motion.rate)
        return RegressionRows(
            motion.times[decimated],
            motion.q[decimated],
            motion.qd[decimated],
            moving,
            columns.reshape(len(y), *X.shape[1:]),
            y,
            effective_samples,
        )


def _sum_of_squares(X: Array, y: Array, moving: BoolArray, values: Array) -> Array:
    """Sums (K, n) of squared residuals y (N, n) - X (N, n, P) values (K, P) of joints that move."""
    return np.stack([np.square((X @ parameters - y) * moving).sum(0) for parameters in values])
