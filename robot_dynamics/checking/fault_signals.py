"""What faults are told from: residuals on a grid, what predicts them, and which of them count."""

from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from robot_dynamics.checking.whitening import WhiteningFilter
from robot_dynamics.recordings.signals import lowpass

SMOOTHING_RATIO = 0.5  # of the cut-off: predictions, whose friction steps where that of robots turns over smoothly
EDGE_DURATION = 0.5  # [s] at ends and gaps that do not count: filters guess there
QUIET_FRACTION = 0.3  # the part of seconds that are taken as free of faults, to tell the noise at first
MIN_NOISE_RATIO = 1e-3  # of the spread of a joint's efforts
RESPONSE_DURATION = 0.4  # [s] over which joints may answer to what is predicted, before it and behind
RESPONSE_SAMPLES = 6  # samples of it to each side
RIDGE = 1e-3  # of the squares of what is answered to


@dataclass(frozen=True, eq=False)
class FaultSignals:
    """Rows at times (N,): measured less predicted efforts, predicted ones, signs of velocities, velocities (N, n), what
    1 kg and 1 kg m along x, y, z add (N, n, 4); step [s] of them; sound: (N,) rows that count."""

    times: np.ndarray
    step: float
    residuals: np.ndarray
    predicted: np.ndarray
    velocity_signs: np.ndarray
    velocities: np.ndarray
    payload_efforts: np.ndarray
    valid: np.ndarray

    @classmethod
    def from_rows(cls, rows, cutoff):
        """Those of rows (9, N, n): times, efforts, and the others, predictions first; cutoff [Hz]: of the motion.

        Efforts are not filtered: that would smear the beginning of a fault.
        """
        times, measured, others = rows[0, :, 0], rows[1], rows[2:]
        step = float(np.median(np.diff(times)))
        if SMOOTHING_RATIO * cutoff * step < 0.4:  # else rows are means over more than that
            flat = others.transpose(1, 0, 2).reshape(len(times), -1)
            flat = lowpass(flat, 1 / step, SMOOTHING_RATIO * cutoff)
            others = flat.reshape(len(times), len(others), -1).transpose(1, 0, 2)
        predicted, velocity_signs, velocities, *payload_efforts = others
        ends = np.diff(times, prepend=-np.inf, append=np.inf) > 1.5 * step  # before each row, and behind the last
        marks = ends[:-1] | ends[1:]
        valid = maximum_filter1d(marks.astype(int), 2 * max(2, int(EDGE_DURATION / step)) + 1) == 0
        payload_efforts = np.stack(payload_efforts, axis=-1)
        return cls(times, step, measured - predicted, predicted, velocity_signs, velocities, payload_efforts, valid)

    @property
    def min_noise(self):
        """(n,) noise that there is at least."""
        return MIN_NOISE_RATIO * self.predicted.std(axis=0) + 1e-9

    def delay_effect(self, shift):
        """(N, n) what efforts that come `shift` [s] late add to the predicted ones."""
        return CubicSpline(self.times, self.predicted)(self.times - shift) - self.predicted

    def initial_whitening(self):
        """A Whitening that takes no colour off: by standard deviations in the quietest seconds of each joint."""
        seconds = np.floor(self.times).astype(int)
        starts = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1))
        counts = np.diff([*starts, len(seconds)])
        rms = np.sqrt(np.add.reduceat(self.residuals**2, starts, axis=0) / counts[:, None])
        quiet = np.sort(rms, axis=0)[: max(1, int(np.ceil(QUIET_FRACTION * len(rms))))]
        noise = np.maximum(np.sqrt((quiet**2).mean(axis=0)), self.min_noise)
        return WhiteningFilter(np.ones((len(noise), 1)), self.valid[:, None] / noise)

    def with_fitted_response(self, left):
        """The Signals with what joints answer to predictions, as residuals `left` (N, n) by a fault tell it.

        Efforts around a prediction count alike before and behind it, so that no delay is hidden here; those around a
        friction that turns over do not: it comes late where joints are elastic.
        """
        noise = WhiteningFilter.fit(left, self.valid, self.min_noise)
        answers = np.zeros_like(left)
        for joint in range(left.shape[1]):
            early, now, late = self._around(self.predicted[:, joint])
            columns = np.stack([now, *(early + late), *(each for part in self._around(self.velocity_signs[:, joint])
                                                       for each in np.atleast_2d(part))], axis=-1)  # fmt: skip
            columns -= columns.mean(axis=0)
            white = noise(columns[:, None], [joint])[:, 0]
            target = noise(left[:, [joint]], [joint])[:, 0]
            scale = np.sqrt((white**2).sum(axis=0)) + 1e-9
            squares = (white / scale).T @ (white / scale) + RIDGE * np.eye(len(scale))
            answers[:, joint] = columns @ (np.linalg.solve(squares, (white / scale).T @ target) / scale)
        return replace(self, residuals=self.residuals - answers, predicted=self.predicted + answers)

    def _around(self, values):
        """Values (N,) some samples before (K, N), now (N,), and as many behind (K, N)."""
        apart = max(1, round(RESPONSE_DURATION / self.step / RESPONSE_SAMPLES))
        count = min(RESPONSE_SAMPLES, int(RESPONSE_DURATION / self.step))
        rows, last = np.arange(len(values)), len(values) - 1
        lags = apart * np.arange(1, count + 1)[:, None]
        return values[np.maximum(rows - lags, 0)], values, values[np.minimum(rows + lags, last)]
