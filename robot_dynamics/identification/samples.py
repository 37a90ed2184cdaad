"""Samples of recordings for least squares: filtered, decimated rows, and the sums of them that a fit needs.

Efforts and regressor pass the same low-pass filter (parallel filtering), so that what it takes off one it takes off the
other; then only every so many samples are kept. The noise left is that of the filter's band, so that neighbouring
samples are not independent: variances count what the band can tell.

Each recording is gathered by itself, here or in another process: what comes back are sums, never samples.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.triangular_factors import TriangularFactors
from robot_dynamics.recordings.position_limits import note_limit_violations
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics.recordings.signals import filter_margin, lowpass

MAX_BAND = 10.0  # [Hz] of the parallel filter, where the cut-off of the motion is higher
SAMPLES_PER_PERIOD = 4  # of the highest frequency that is left, after decimation
NOISE_BANDWIDTH = 0.875 * (np.pi / 8) / np.sin(np.pi / 8)  # ∫ (1 + x⁸)⁻² dx: of the filter forth and back, cut-off 1
HUBER_THRESHOLD = 1.345  # standard deviations from which on the robust method counts linearly
MIN_PIECE_SAMPLES = 100  # samples of a piece of motion: fewer have no band
MAX_PIECE_SAMPLES = 20_000  # samples whose regressor is held at once
CACHE_BYTES = 256 * 1024 * 1024  # bytes of rows that are kept rather than read again
NO_SAMPLES = "no sample is left to fit, or to validate with"


@dataclass(frozen=True, eq=False)
class RegressionRows:
    """Filtered, decimated columns X (N, n, P) and efforts y (N, n) at times (N,); independent: how many independent
    samples one of them is worth, at most 1."""

    times: np.ndarray
    X: np.ndarray
    y: np.ndarray
    effective_samples: float


@dataclass(frozen=True, eq=False)
class FitQuality:
    """How values fit some samples: rms (n,) in the band of the filter, rms_unfiltered (n,), spread (n,): standard
    deviation of the efforts in the band; samples: before decimation."""

    rms: np.ndarray
    rms_unfiltered: np.ndarray
    spread: np.ndarray
    samples: int


@dataclass(frozen=True, eq=False)
class FactorSums:
    """factors: of `rows` rows, None where there is none; independent: how many independent samples they are worth."""

    factors: TriangularFactors | None
    effective_samples: float = 0.0
    rows: int = 0

    def __add__(self, other):
        if self.factors is None or other.factors is None:
            return self if other.factors is None else other
        return FactorSums(
            self.factors + other.factors, self.effective_samples + other.effective_samples, self.rows + other.rows
        )


@dataclass(frozen=True, eq=False)
class QualitySums:
    """Sums that make a Quality. in_band: (3, n) squares of residuals, squares of efforts, and efforts of `rows` rows;
    squares: (n,) of unfiltered residuals of `samples` samples."""

    in_band: np.ndarray
    rows: int
    squares: np.ndarray
    samples: int

    def __add__(self, other):
        return QualitySums(*(getattr(self, name) + getattr(other, name) for name in vars(self)))

    @property
    def quality(self):
        """The Quality. Raises RecordingError where there is no sample."""
        if not self.rows:
            raise RecordingError(NO_SAMPLES)
        residuals, efforts, mean = self.in_band / self.rows
        spread = np.sqrt(np.maximum(efforts - mean**2, 0))
        return FitQuality(np.sqrt(residuals), np.sqrt(self.squares / self.samples), spread, self.samples)


class Samples:
    """Samples of recordings that are fitted together, each gathered by itself.

    after, until: parts of the duration of each recording, of 0 to 1, between which samples count; executor: a
    concurrent.futures.Executor whose processes gather, None: this one; watch: takes and gives an iterator that is as
    long as recordings are many, to show progress.
    """

    def __init__(
        self,
        recordings,
        columns,
        *,
        cutoff=None,
        band=None,
        start_fraction=0.0,
        end_fraction=1.0,
        executor=None,
        progress=None,
    ):
        self.model, self._map, self._watch = columns, map if executor is None else executor.map, progress or iter
        settings = {"cutoff": cutoff, "band": band, "start_fraction": start_fraction, "end_fraction": end_fraction}
        share = CACHE_BYTES // max(1, len(recordings))
        self._excerpts = [Excerpt(recording, columns, cache_bytes=share, **settings) for recording in recordings]
        self._notes = {excerpt.recording.name: () for excerpt in self._excerpts}

    @property
    def notes(self):
        """Sentences on what was left out; complete when all has been gathered."""
        return [f"{name}: {sentence}" for name, told in self._notes.items() for sentence in told]

    def accumulate_factors(self, values=None, standard_deviations=None):
        """The Gathered of all; with values (P,) and deviations (n,) of the residuals: weighted by residuals (Huber)."""
        return self._sum(partial(Excerpt.accumulate_factors, values=values, standard_deviations=standard_deviations))

    def quality(self, values):
        """The Quality of values (P,) on these samples. Raises RecordingError where there is none."""
        return self._sum(partial(Excerpt.quality_sums, values=values)).quality

    def _sum(self, task):
        """The sum of what a task makes of the excerpts, always in their order, so that rounding is the same."""
        total, results = None, self._watch(self._map(partial(_with_notes, task), self._excerpts))
        for excerpt, (found, notes) in zip(self._excerpts, results, strict=True):
            total = found if total is None else total + found
            self._notes[excerpt.recording.name] = notes
        return total


def _with_notes(task, excerpt):
    """What a task makes of an Excerpt, and its notes, of which another process must tell."""
    return task(excerpt), tuple(excerpt.notes)


class Excerpt:
    """Rows of a part of one recording, as often as they are asked for; kept where they are fewer than `remembered`
    bytes. In another process they are read anew."""

    def __init__(self, recording, columns, *, cutoff, band, start_fraction, end_fraction, cache_bytes):
        self.recording, self.model = recording, columns.for_recording(recording)
        self.cutoff, self.band = cutoff, band
        self.start_fraction, self.end_fraction, self.cache_bytes = start_fraction, end_fraction, cache_bytes
        self.notes = []
        self._kept, self._duration_known = None, None

    def __getstate__(self):
        return {**vars(self), "_kept": None, "cache_bytes": 0}

    def __iter__(self):
        if self._kept is not None:
            yield from self._kept
            return
        kept, size = [], 0
        for motion, told in self._pieces():
            rows = self._rows(motion, told)
            size += rows.X.nbytes
            if size < self.cache_bytes:
                kept.append(rows)
            yield rows
        if size < self.cache_bytes:
            self._kept = kept

    def _pieces(self):
        """(Motion, slice): pieces that the memory holds, with what the filter must see around what is told of them."""
        pending, skipped = None, 0
        for motion in self._motions():
            if pending is not None and abs(motion.time - pending.end) * motion.rate < 0.5:
                pending = pending.concatenate(motion)
            else:
                if pending is not None and len(pending) > MIN_PIECE_SAMPLES:
                    yield pending, slice(skipped, len(pending))
                pending, skipped = motion, 0
            around = filter_margin(motion.rate, self._band(motion))
            if len(pending) > MAX_PIECE_SAMPLES + skipped + around:
                yield pending, slice(skipped, len(pending) - around)
                pending, skipped = pending.slice_samples(len(pending) - 2 * around, len(pending)), around
        if pending is not None and len(pending) > MIN_PIECE_SAMPLES:
            yield pending, slice(skipped, len(pending))

    def _motions(self):
        """The Motions of the recording, cut to the time that counts."""
        statistics = SampleStatistics()
        start, end = (part * self._duration() for part in (self.start_fraction, self.end_fraction))
        for motion in self.recording.motions(statistics, cutoff=self.cutoff):
            note_limit_violations(self.model.dynamics, motion, statistics)
            if not motion.has_efforts.all():  # zeros in their place would be fitted
                silent = np.array(self.model.dynamics.joint_names)[~motion.has_efforts]
                told = "".join(f"; {note}" for note in self.recording.notes)
                raise RecordingError(f"{self.recording.name}: efforts were not measured of {', '.join(silent)}: those "
                                     f"of all joints are needed{told}")  # fmt: skip
            first, last = np.searchsorted(motion.times, [start - 1e-9, end - 1e-9])
            last = len(motion) if self.end_fraction >= 1 else last
            if last > first:
                yield motion.slice_samples(first, last)
        self.notes += [told for told in (*self.recording.notes, *statistics.sentences) if told not in self.notes]

    def _duration(self):
        if self.start_fraction <= 0 and self.end_fraction >= 1:
            return 0.0  # all of it, however long it is
        if self._duration_known is None:
            ends = [stretch.time + len(stretch) / stretch.rate for stretch in self.recording.signal_segments()]
            self._duration_known = max(ends, default=0.0)
        return self._duration_known

    def _band(self, motion):
        band = min(MAX_BAND, motion.cutoff) if self.band is None else self.band
        if not 0 < band < motion.rate / 2:
            raise RecordingError(f"band of {band:g} Hz: between 0 and {motion.rate / 2:.4g} is needed")
        return band

    def _rows(self, motion, told):
        band = self._band(motion)
        stride = max(1, int(motion.rate / (SAMPLES_PER_PERIOD * band)))
        told = slice(told.start, told.stop, stride)
        X = self.model.motion_regressor(motion)
        flat = lowpass(X.reshape(len(X), -1), motion.rate, band)[told]
        y = lowpass(self.model.efforts(motion), motion.rate, band)[told]
        effective_samples = min(1.0, 2 * NOISE_BANDWIDTH * band * stride / motion.rate)
        return RegressionRows(motion.times[told], flat.reshape(len(y), *X.shape[1:]), y, effective_samples)

    def accumulate_factors(self, values=None, standard_deviations=None):
        """As Samples.gathered, of this recording."""
        total = FactorSums(None)
        for rows in self:
            weights = None
            if values is not None:
                far = np.abs(rows.y - rows.X @ values) / (HUBER_THRESHOLD * standard_deviations)
                weights = 1 / np.maximum(1, far)
            count = len(rows.y)
            total = total + FactorSums(
                TriangularFactors.from_samples(rows.X, rows.y, weights), rows.effective_samples * count, count
            )
        return total

    def quality_sums(self, values):
        """The QualitySums of values (P,) on this recording."""
        n = len(self.model.dynamics.joint_names)
        total = QualitySums(np.zeros((3, n)), 0, np.zeros(n), 0)
        for rows in self:
            r = rows.X @ values - rows.y
            sums = np.stack([(r * r).sum(0), (rows.y**2).sum(0), rows.y.sum(0)])
            total = total + QualitySums(sums, len(rows.y), np.zeros(n), 0)
        for piece, told in self._pieces():
            motion = piece.slice_samples(told.start, told.stop)
            r = self.model.motion_regressor(motion) @ values - self.model.efforts(motion)
            total = total + QualitySums(np.zeros((3, n)), 0, (r * r).sum(0), len(motion))
        return total
