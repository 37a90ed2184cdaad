"""Measured against predicted efforts, joint by joint, over a recording of any length: sums, not samples, are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.checking.plot_samples import PlotSampler
from robot_dynamics.checking.scale_sums import DIRECTION, MEASURED, ONE, ScaleSums

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.checking.plot_samples import PlotSamples
    from robot_dynamics.checking.prediction_filter import PredictedMotion

WINDOW = 1.0  # [s] duration of the windows whose residuals are checked by themselves
MIN_WINDOWS = 4  # for a standard deviation of the RMS
MIN_WINDOW_PART = 0.25  # a window with fewer samples than this part of the largest counts as this part
MIN_RELATIVE_VARIANCE = 1e-12  # of the squares of efforts; below it an effort is constant to rounding
ONE_WAY_DIRECTION = 0.9  # mean of the sign of the velocity beyond which a joint moves one way
MAX_NOISE_BAND = 0.5  # part of the band that is below the cut-off: above it the noise cannot be extrapolated


@dataclass(frozen=True)
class JointComparison:
    """Measured against predicted efforts of a joint [N m or N]; the residual is measured less predicted.

    Samples at which the joint rests do not count: there friction has any value within its limits.

    Attributes
    ----------
    joint : name.
    samples : number of samples that count.
    resting : part of the samples, 0 to 1, at which the joint rests; they do not count.
    rms : RMS of the residual.
    rms_deviation : standard deviation of the RMS, from the scatter between windows; nan for less than `MIN_WINDOWS`.
    rms_unfiltered : RMS of the residual of unfiltered efforts, measured and predicted.
    normalised : rms / spread.
    largest : largest absolute residual.
    at : time of the largest residual [s].
    bias : mean of the residual.
    correlation : of measured and predicted efforts; nan where one of them is constant.
    scale : factor from predicted to measured effort, beside an offset and a change of friction; nan where one of them
        is constant.
    scale_deviation : standard deviation of the scale; nan for less than `MIN_BLOCKS` seconds.
    spread : standard deviation of the measured effort.
    effort_rms : RMS of the measured effort, mean included.
    noise : RMS of the noise of the measured effort below the cut-off, if its density is that above the cut-off.
    direction : mean of the sign of the velocity, -1 to 1.
    """

    joint: str
    samples: int
    resting: float
    rms: float
    rms_deviation: float
    rms_unfiltered: float
    normalised: float
    largest: float
    at: float
    bias: float
    correlation: float
    scale: float
    scale_deviation: float
    spread: float
    effort_rms: float
    noise: float
    direction: float

    @property
    def moves_one_way(self) -> bool:
        """Whether the joint moves in one direction only, so that friction is a part of the mean, not of the spread."""
        return abs(self.direction) > ONE_WAY_DIRECTION


class WindowSums(NamedTuple):
    """Samples of a window that count, (n,), and sums (n,) of squares of their residuals."""

    counts: IntArray
    squares: Array


class Comparison:
    """Sums over motions and their predicted efforts, from which the statistics of n joints follow.

    Parameters
    ----------
    joint_names : names of the n joints.
    window : duration of the windows [s].

    Attributes
    ----------
    samples : number of samples.
    counts : (n,) number of samples at which a joint moves: only these are in the sums.
    has_efforts : (n,) whether the efforts of a joint were measured throughout.
    residual_sums : (2, n) sums of residuals and of their squares.
    largest, at : (n,) largest absolute residual [N m or N] and its time [s].
    peaks : (n,) largest absolute measured effort [N m or N], at rest too.
    """

    def __init__(self, joint_names: Sequence[str], window: float = WINDOW) -> None:
        n = len(joint_names)
        self.joint_names = tuple(joint_names)
        self.window = window
        self.samples = 0
        self.counts = np.zeros(n, dtype=int)
        self.has_efforts = np.ones(n, dtype=bool)
        self.residual_sums = np.zeros((2, n))
        self.largest = np.zeros(n)
        self.at = np.zeros(n)
        self.peaks = np.zeros(n)
        self._unfiltered_squares = np.zeros(n)  # of residuals
        self._noise_squares = np.zeros(n)  # of unfiltered less filtered measured efforts
        self._noise_band = 0.0  # part of the band below the cut-off
        self._shift: Array | None = None  # (n,) subtracted from efforts, so that squares keep their digits
        self._scale_sums = ScaleSums(n)
        self._windows: dict[int, WindowSums] = {}  # by their number
        self._plot_sampler = PlotSampler()

    def add(self, part: PredictedMotion) -> None:
        """Add a motion and its predicted efforts."""
        motion = part.motion
        m = motion.efforts
        counted = motion.moving
        if self._shift is None:
            self._shift = m.mean(axis=0)
        residuals = np.where(counted, m - part.filtered, 0.0)
        unfiltered = np.where(counted, motion.unfiltered_efforts - part.predicted, 0.0)
        removed = np.where(counted, motion.unfiltered_efforts - m, 0.0)
        self.samples += len(motion)
        self.counts = self.counts + counted.sum(axis=0)
        self.has_efforts = self.has_efforts & motion.has_efforts
        self.residual_sums += [residuals.sum(0), _column_products(residuals, residuals)]
        self._unfiltered_squares += _column_products(unfiltered, unfiltered)
        self._noise_squares += _column_products(removed, removed)
        self._noise_band = min(MAX_NOISE_BAND, 2 * motion.cutoff / motion.rate)
        times = motion.times
        rows = np.abs(residuals).argmax(axis=0)
        peaks = np.abs(residuals)[rows, np.arange(residuals.shape[1])]
        self.at = np.where(peaks > self.largest, times[rows], self.at)
        self.largest = np.maximum(self.largest, peaks)
        self.peaks = np.maximum(self.peaks, np.abs(m).max(axis=0))
        columns = np.stack([part.filtered - self._shift, np.ones_like(m), part.directions, motion.qd, m - self._shift])
        self._add_windows(times, residuals, columns, counted)
        self._plot_sampler.add(part)

    def _add_windows(self, times: Array, residuals: Array, columns: Array, counted: BoolArray) -> None:
        numbers = np.floor(times / self.window + 1e-9).astype(int)
        cuts = [0, *(np.flatnonzero(np.diff(numbers)) + 1), len(numbers)]
        for begin, end in pairwise(cuts):
            number = int(numbers[begin])
            rows = slice(begin, end)
            counts = counted[rows].sum(axis=0)
            squares = _column_products(residuals[rows], residuals[rows])
            self._add_window(number, WindowSums(counts, squares))
            self._scale_sums.add(number, columns[:, rows], counted[rows])

    def _add_window(self, number: int, sums: WindowSums) -> None:
        if number in self._windows:
            window = self._windows[number]
            sums = WindowSums(window.counts + sums.counts, window.squares + sums.squares)
        self._windows[number] = sums

    def append(self, later: Comparison) -> None:
        """Add the sums of a later part of the same recording."""
        if later._shift is None:
            return
        shift = np.zeros(len(self.joint_names))
        if self._shift is None:
            self._shift = later._shift
        else:
            shift = later._shift - self._shift
        self.samples += later.samples
        self.counts = self.counts + later.counts
        self.has_efforts = self.has_efforts & later.has_efforts
        self.residual_sums += later.residual_sums
        self._unfiltered_squares += later._unfiltered_squares
        self._noise_squares += later._noise_squares
        self._noise_band = later._noise_band
        self.at = np.where(later.largest > self.largest, later.at, self.at)
        self.largest = np.maximum(self.largest, later.largest)
        self.peaks = np.maximum(self.peaks, later.peaks)
        for number, window in later._windows.items():
            self._add_window(number, window)
        self._scale_sums.append(later._scale_sums, shift)
        self._plot_sampler.append(later._plot_sampler)

    def drop_windows_before(self, number: int) -> None:
        """Drop the sums of the windows with lower numbers: those that begin before `number` times `window` [s]."""
        for old in [each for each in self._windows if each < number]:
            del self._windows[old]

    @property
    def plot_samples(self) -> PlotSamples:
        """Samples at equal distances, for figures."""
        return self._plot_sampler.samples

    @property
    def joint_comparisons(self) -> list[JointComparison]:
        """The statistics of each joint; nan where it never moves."""
        shift = np.zeros(len(self.joint_names)) if self._shift is None else self._shift
        sums = self._scale_sums.total
        with np.errstate(all="ignore"):
            N = np.where(self.counts > 0, self.counts, np.nan)
            mean_p = sums[:, 0, ONE] / N
            mean_m = sums[:, MEASURED, ONE] / N
            var_p = sums[:, 0, 0] / N - mean_p**2
            var_m = sums[:, MEASURED, MEASURED] / N - mean_m**2
            covariance = sums[:, 0, MEASURED] / N - mean_m * mean_p
            threshold = MIN_RELATIVE_VARIANCE * (np.maximum(var_m, var_p) + shift**2)
            varies = np.minimum(var_m, var_p) > threshold
            correlation = np.where(varies, covariance / np.sqrt(var_m * var_p), np.nan)
            spread = np.sqrt(np.maximum(var_m, 0))
            rms = np.sqrt(self.residual_sums[1] / N)
            noise_ratio = self._noise_band / (1 - self._noise_band)
            values = {
                "resting": 1 - self.counts / max(1, self.samples),
                "rms": rms,
                "rms_deviation": self._rms_deviations(rms),
                "rms_unfiltered": np.sqrt(self._unfiltered_squares / N),
                "normalised": np.where(var_m > 0, rms / spread, np.nan),
                "largest": self.largest,
                "at": self.at,
                "bias": self.residual_sums[0] / N,
                "correlation": correlation,
                "spread": spread,
                "effort_rms": np.sqrt(spread**2 + (mean_m + shift) ** 2),
                "noise": np.sqrt(self._noise_squares / N * noise_ratio),
                "direction": sums[:, DIRECTION, ONE] / N,
            }
        return [
            JointComparison(
                joint=name,
                samples=int(self.counts[joint]),
                scale=scale.value if varies[joint] else np.nan,
                scale_deviation=scale.deviation if varies[joint] else np.nan,
                **{key: float(value[joint]) for key, value in values.items()},
            )
            for joint, (name, scale) in enumerate(zip(self.joint_names, self._scale_sums.scales(), strict=True))
        ]

    def _rms_deviations(self, rms: Array) -> Array:
        """Standard deviations (n,) of the RMS (n,) of residuals: those of a ratio of sums over windows."""
        count = len(self._windows)
        if count < MIN_WINDOWS:
            return np.full(len(rms), np.nan)
        counts = np.array([window.counts for window in self._windows.values()])
        squares = np.array([window.squares for window in self._windows.values()])
        scatter = np.sqrt(((squares - rms**2 * counts) ** 2).sum(axis=0) * count / (count - 1))
        deviations: Array = scatter / counts.sum(axis=0) / (2 * rms)
        return deviations

    @property
    def window_rms(self) -> tuple[Array, Array]:
        """starts (W,) [s] and RMS of residuals (W, n) of the windows, in the order of time.

        0 where no sample of a window counts. Where only a few samples count they are taken as `MIN_WINDOW_PART` of a
        window: single samples are no evidence.
        """
        numbers = sorted(self._windows)
        counts = np.array([self._windows[number].counts for number in numbers]).reshape(len(numbers), -1)
        squares = np.array([self._windows[number].squares for number in numbers]).reshape(len(numbers), -1)
        least = max(1.0, MIN_WINDOW_PART * counts.max(initial=0))
        return np.array(numbers) * self.window, np.sqrt(squares / np.maximum(counts, least))


def _column_products(a: Array, b: Array) -> Array:
    """Σ_i a_ij b_ij, (n,)."""
    products: Array = np.einsum("ij,ij->j", a, b)
    return products
