"""Measured against predicted efforts, joint by joint, over a recording of any length: sums, not samples, are kept."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.joint_motions import Motion

WINDOW = 1.0  # [s] duration of the windows whose residuals are checked by themselves
MAX_PLOT_SAMPLES = 4000  # samples kept for figures
MIN_RELATIVE_VARIANCE = 1e-12  # of the squares of efforts; below it an effort is constant to rounding


@dataclass(frozen=True)
class JointComparison:
    """Measured against predicted efforts of a joint [N m or N]; the residual is measured less predicted.

    Attributes
    ----------
    joint : name.
    samples : number of samples.
    rms : RMS of the residual.
    rms_unfiltered : RMS of the unfiltered measured effort less the predicted one.
    normalised : rms / spread.
    largest : largest absolute residual.
    at : time of the largest residual [s].
    bias : mean of the residual.
    correlation : of measured and predicted efforts; nan where one of them is constant.
    scale : factor of the prediction that fits best, beside an offset; nan where one of them is constant.
    spread : standard deviation of the measured effort.
    """

    joint: str
    samples: int
    rms: float
    rms_unfiltered: float
    normalised: float
    largest: float
    at: float
    bias: float
    correlation: float
    scale: float
    spread: float


@dataclass
class WindowSums:
    """Samples of a window, and sums (n,) of squares of their residuals."""

    samples: int
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
    has_efforts : (n,) whether the efforts of a joint were measured throughout.
    residual_sums : (2, n) sums of residuals and of their squares.
    largest, at : (n,) largest absolute residual [N m or N] and its time [s].
    peaks : (n,) largest absolute measured effort [N m or N].
    """

    def __init__(self, joint_names: Sequence[str], window: float = WINDOW) -> None:
        n = len(joint_names)
        self.joint_names = tuple(joint_names)
        self.window = window
        self.samples = 0
        self.has_efforts = np.ones(n, dtype=bool)
        self.residual_sums = np.zeros((2, n))
        self.largest = np.zeros(n)
        self.at = np.zeros(n)
        self.peaks = np.zeros(n)
        self._sums = np.zeros((6, n))  # of m, p, m², p², m p, and squares of unfiltered residuals
        self._shift: Array | None = None  # (n,) subtracted from efforts, so that squares keep their digits
        self._windows: dict[int, WindowSums] = {}  # by their number
        self._plot_parts: list[Array] = []  # (4, N, n) times, measured, predicted, velocities
        self._plot_stride = 1
        self._plot_phase = 0

    def add(self, motion: Motion, predicted: Array) -> None:
        """Add a motion and its predicted efforts (N, n)."""
        m = motion.efforts
        p = predicted
        if self._shift is None:
            self._shift = m.mean(axis=0)
        residuals = m - p
        unfiltered = motion.unfiltered_efforts - p
        m0 = m - self._shift
        p0 = p - self._shift
        self.samples += len(motion)
        self.has_efforts = self.has_efforts & motion.has_efforts
        self._sums += [
            m0.sum(0),
            p0.sum(0),
            _column_products(m0, m0),
            _column_products(p0, p0),
            _column_products(m0, p0),
            _column_products(unfiltered, unfiltered),
        ]
        self.residual_sums += [residuals.sum(0), _column_products(residuals, residuals)]
        times = motion.times
        rows = np.abs(residuals).argmax(axis=0)
        peaks = np.abs(residuals)[rows, np.arange(residuals.shape[1])]
        self.at = np.where(peaks > self.largest, times[rows], self.at)
        self.largest = np.maximum(self.largest, peaks)
        self.peaks = np.maximum(self.peaks, np.abs(m).max(axis=0))
        self._add_windows(times, residuals)
        self._add_plot_samples(motion, predicted)

    def _add_windows(self, times: Array, residuals: Array) -> None:
        numbers = np.floor(times / self.window + 1e-9).astype(int)
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        counts = np.diff([*starts, len(residuals)])
        sums = np.add.reduceat(residuals * residuals, starts, axis=0)
        for number, count, squares in zip(numbers[starts], counts, sums, strict=True):
            window = self._windows.setdefault(int(number), WindowSums(0, np.zeros(residuals.shape[1])))
            window.samples += int(count)
            window.squares = window.squares + squares

    def drop_windows_before(self, number: int) -> None:
        """Drop the sums of the windows with lower numbers: those that begin before `number` times `window` [s]."""
        for old in [each for each in self._windows if each < number]:
            del self._windows[old]

    def _add_plot_samples(self, motion: Motion, predicted: Array) -> None:
        """Keep every k-th sample for figures; k doubles whenever too many are kept."""
        picked = slice((-self._plot_phase) % self._plot_stride, None, self._plot_stride)
        self._plot_phase += len(motion)
        times = np.broadcast_to(motion.times[:, None], motion.q.shape)
        self._plot_parts.append(np.stack([each[picked] for each in (times, motion.efforts, predicted, motion.qd)]))
        while sum(part.shape[1] for part in self._plot_parts) > 2 * MAX_PLOT_SAMPLES:
            samples = np.concatenate(self._plot_parts, axis=1)[:, ::2].copy()
            self._plot_parts = [samples]
            self._plot_stride = 2 * self._plot_stride
            self._plot_phase = self._plot_stride * samples.shape[1]

    @property
    def plot_samples(self) -> tuple[Array, Array, Array, Array]:
        """times (K,), measured and predicted efforts, velocities (K, n) of samples at equal distances."""
        times, measured, predicted, velocities = np.concatenate(self._plot_parts, axis=1)
        return times[:, 0], measured, predicted, velocities

    @property
    def joint_comparisons(self) -> list[JointComparison]:
        """The statistics of each joint."""
        N = self.samples
        shift = np.zeros(len(self.joint_names)) if self._shift is None else self._shift
        mean_m, mean_p = self._sums[:2] / N
        with np.errstate(all="ignore"):
            var_m = self._sums[2] / N - mean_m**2
            var_p = self._sums[3] / N - mean_p**2
            covariance = self._sums[4] / N - mean_m * mean_p
            threshold = MIN_RELATIVE_VARIANCE * (np.maximum(var_m, var_p) + shift**2)
            varies = np.minimum(var_m, var_p) > threshold
            correlation = np.where(varies, covariance / np.sqrt(var_m * var_p), np.nan)
            scale = np.where(varies, covariance / var_p, np.nan)
            spread = np.sqrt(np.maximum(var_m, 0))
            rms = np.sqrt(self.residual_sums[1] / N)
            normalised = np.where(var_m > 0, rms / spread, np.nan)
            rms_unfiltered = np.sqrt(self._sums[5] / N)
            bias = self.residual_sums[0] / N
        return [
            JointComparison(
                joint=name,
                samples=N,
                rms=float(rms[joint]),
                rms_unfiltered=float(rms_unfiltered[joint]),
                normalised=float(normalised[joint]),
                largest=float(self.largest[joint]),
                at=float(self.at[joint]),
                bias=float(bias[joint]),
                correlation=float(correlation[joint]),
                scale=float(scale[joint]),
                spread=float(spread[joint]),
            )
            for joint, name in enumerate(self.joint_names)
        ]

    @property
    def window_rms(self) -> tuple[Array, Array]:
        """starts (W,) [s] and RMS of residuals (W, n) of the windows, in the order of time."""
        numbers = sorted(self._windows)
        rms = [np.sqrt(self._windows[number].squares / self._windows[number].samples) for number in numbers]
        return np.array(numbers) * self.window, np.array(rms).reshape(len(numbers), -1)


def _column_products(a: Array, b: Array) -> Array:
    """Σ_i a_ij b_ij, (n,)."""
    products: Array = np.einsum("ij,ij->j", a, b)
    return products
