"""Measured against predicted efforts, joint by joint, over a recording of any length: sums, not samples, are kept."""

from dataclasses import dataclass

import numpy as np

WINDOW = 1.0  # [s] the time over which a verdict on a segment is made
MAX_PLOT_SAMPLES = 4000  # samples kept for pictures


@dataclass(frozen=True)
class JointComparison:
    """How measured efforts of a joint stand to predicted ones [N m or N].

    rms, largest, bias: of the residual, measured less predicted; at: when it is largest [s]; rms_unfiltered: of what
    was measured, unfiltered; normalised: rms / spread, the standard deviation of what was measured; correlation; scale:
    the factor of the prediction, beside an offset, that fits best. nan where nothing moves.
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


class Comparison:
    """Sums over all that is `add`-ed."""

    def __init__(self, joint_names, window=WINDOW):
        n = len(joint_names)
        self.joint_names, self.window = tuple(joint_names), window
        self.samples, self.has_efforts = 0, np.ones(n, dtype=bool)
        self.sums = np.zeros((6, n))  # of m, p, m², p², m p, and squares of what is left unfiltered
        self.shift = None  # taken off measured efforts, so that squares keep their digits
        self.residual_sums = np.zeros((2, n))  # sums of residuals and of their squares
        self.largest, self.at, self.peaks = np.zeros(n), np.zeros(n), np.zeros(n)
        self.windows = {}  # {number of the window: [samples, sums of squares of residuals]}
        self.kept, self._stride, self._phase = [], 1, 0

    def add(self, motion, predicted):
        """Count a Motion and the efforts (N, n) that were predicted for it."""
        m, p = motion.efforts, predicted
        if self.shift is None:
            self.shift = m.mean(axis=0)
        r, times = m - p, motion.times
        m0, p0 = m - self.shift, p - self.shift
        self.samples += len(motion)
        self.has_efforts = self.has_efforts & motion.has_efforts
        unfiltered = np.einsum("ij,ij->j", motion.unfiltered_efforts - p, motion.unfiltered_efforts - p)
        self.sums += [m0.sum(0), p0.sum(0), *(np.einsum("ij,ij->j", a, b) for a, b in ((m0, m0), (p0, p0), (m0, p0))),
                      unfiltered]  # fmt: skip
        self.residual_sums += [r.sum(0), np.einsum("ij,ij->j", r, r)]
        rows = np.abs(r).argmax(axis=0)
        peaks = np.abs(r)[rows, np.arange(r.shape[1])]
        self.at = np.where(peaks > self.largest, times[rows], self.at)
        self.largest = np.maximum(self.largest, peaks)
        self.peaks = np.maximum(self.peaks, np.abs(m).max(axis=0))  # of what was measured
        self._add_windows(times, r)
        self._keep(motion, predicted)

    def _add_windows(self, times, r):
        numbers = np.floor(times / self.window + 1e-9).astype(int)
        starts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1))
        sums = np.add.reduceat(r * r, starts, axis=0)
        for number, count, squares in zip(numbers[starts], np.diff([*starts, len(r)]), sums, strict=True):
            window = self.windows.setdefault(int(number), [0, np.zeros(r.shape[1])])
            window[0] += int(count)
            window[1] = window[1] + squares

    def _keep(self, motion, predicted):
        """Every so many samples, for pictures; ever fewer of them as the recording goes on."""
        picked = slice((-self._phase) % self._stride, None, self._stride)
        self._phase += len(motion)
        times = np.broadcast_to(motion.times[:, None], motion.q.shape)
        self.kept.append(np.stack([each[picked] for each in (times, motion.efforts, predicted, motion.qd)]))
        while sum(part.shape[1] for part in self.kept) > 2 * MAX_PLOT_SAMPLES:
            everything = np.concatenate(self.kept, axis=1)
            self.kept, self._stride = [everything[:, ::2].copy()], 2 * self._stride
            self._phase = self._stride * self.kept[0].shape[1]

    @property
    def plot_samples(self):
        """times (K,), measured, predicted efforts and velocities (K, n): some samples, at equal distances."""
        everything = np.concatenate(self.kept, axis=1)
        return everything[0, :, 0], *everything[1:]

    @property
    def joint_comparisons(self):
        """The JointComparisons."""
        N = self.samples
        mean_m, mean_p = self.sums[:2] / N
        with np.errstate(all="ignore"):
            var_m, var_p = self.sums[2] / N - mean_m**2, self.sums[3] / N - mean_p**2
            covariance = self.sums[4] / N - mean_m * mean_p
            moves = np.minimum(var_m, var_p) > 1e-12 * (np.maximum(var_m, var_p) + self.shift**2)
            correlation = np.where(moves, covariance / np.sqrt(var_m * var_p), np.nan)
            scale = np.where(moves, covariance / var_p, np.nan)
            spread = np.sqrt(np.maximum(var_m, 0))
            rms = np.sqrt(self.residual_sums[1] / N)
            normalised = np.where(var_m > 0, rms / spread, np.nan)
            columns = (rms, np.sqrt(self.sums[5] / N), normalised, self.largest, self.at, self.residual_sums[0] / N,
                       correlation, scale, spread)  # fmt: skip
        return [JointComparison(name, N, *map(float, values))
                for name, *values in zip(self.joint_names, *columns, strict=True)]  # fmt: skip

    @property
    def window_rms(self):
        """(starts (W,) [s], rms of residuals (W, n)) of the windows, in their order."""
        numbers = sorted(self.windows)
        rms = [np.sqrt(self.windows[number][1] / self.windows[number][0]) for number in numbers]
        return np.array(numbers) * self.window, np.array(rms).reshape(len(numbers), -1)
