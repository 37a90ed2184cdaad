"""Signals that faults are found in: residuals on a grid, their predictors, and the samples that count."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import maximum_filter1d

from robot_dynamics.checking.whitening import WhiteningFilter
from robot_dynamics.recordings.signals import lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

SMOOTHING_RATIO = 0.5  # of the cut-off: smooths predictions, as the friction of real robots reverses smoothly
MAX_SMOOTHING_BAND = 0.4  # of the rate; with a higher band samples are means over more than the filter smooths
EDGE_DURATION = 0.5  # [s] at ends and gaps that do not count, as filters have data on one side only
QUIET_FRACTION = 0.3  # part of the seconds that is taken as free of faults for the first estimate of noise
MIN_NOISE_RATIO = 1e-3  # of the spread of a joint's efforts
RESPONSE_DURATION = 0.4  # [s] before and after a prediction over which joints may respond to it
RESPONSE_SAMPLES = 6  # samples of the response on each side
RIDGE = 1e-3  # regularisation of the response, as a part of the squares of its columns


@dataclass(frozen=True, eq=False)
class FaultSignals:
    """Signals of n joints at N times.

    Attributes
    ----------
    times : (N,) [s].
    step : typical step between them [s].
    residuals : (N, n) measured less predicted efforts [N m or N].
    predicted : (N, n) predicted efforts [N m or N].
    velocity_signs, velocities : (N, n) [rad/s or m/s].
    payload_efforts : (N, n, 4) efforts for a payload of 1 kg, and for first moments of 1 kg m along x, y, z.
    valid : (N,) samples that count.
    """

    times: Array
    step: float
    residuals: Array
    predicted: Array
    velocity_signs: Array
    velocities: Array
    payload_efforts: Array
    valid: BoolArray

    @classmethod
    def from_rows(cls, rows: Array, cutoff: float) -> FaultSignals:
        """Make the signals from stacked samples.

        Parameters
        ----------
        rows : (9, N, n) times, measured efforts, predicted efforts, signs of velocities, velocities, four payload
            efforts. Measured efforts are not filtered: that would blur the onset of a fault.
        cutoff : cut-off frequency of the motion [Hz].
        """
        times = rows[0, :, 0]
        measured = rows[1]
        predictors = rows[2:]
        step = float(np.median(np.diff(times)))
        band = SMOOTHING_RATIO * cutoff
        if band * step < MAX_SMOOTHING_BAND:
            columns = predictors.transpose(1, 0, 2).reshape(len(times), -1)
            columns = lowpass(columns, 1 / step, band)
            predictors = columns.reshape(len(times), len(predictors), -1).transpose(1, 0, 2)
        predicted, velocity_signs, velocities = predictors[:3]
        return cls(
            times=times,
            step=step,
            residuals=measured - predicted,
            predicted=predicted,
            velocity_signs=velocity_signs,
            velocities=velocities,
            payload_efforts=np.stack(list(predictors[3:]), axis=-1),
            valid=_far_from_gaps(times, step),
        )

    @property
    def min_noise(self) -> Array:
        """Least standard deviation (n,) of noise."""
        minimum: Array = MIN_NOISE_RATIO * self.predicted.std(axis=0) + 1e-9
        return minimum

    def delay_effect(self, shift: float) -> Array:
        """Change of the predicted efforts (N, n) where they come `shift` [s] later."""
        delayed: Array = CubicSpline(self.times, self.predicted)(self.times - shift)
        return delayed - self.predicted

    def initial_whitening(self) -> WhiteningFilter:
        """Weights without filters: by the RMS in the quietest seconds of each joint."""
        seconds = np.floor(self.times).astype(int)
        starts = np.flatnonzero(np.diff(seconds, prepend=seconds[0] - 1))
        counts = np.diff([*starts, len(seconds)])
        rms = np.sqrt(np.add.reduceat(self.residuals**2, starts, axis=0) / counts[:, None])
        quiet = np.sort(rms, axis=0)[: max(1, int(np.ceil(QUIET_FRACTION * len(rms))))]
        noise = np.maximum(np.sqrt((quiet**2).mean(axis=0)), self.min_noise)
        return WhiteningFilter(np.ones((len(noise), 1)), self.valid[:, None] / noise)

    def with_fitted_response(self, unexplained: Array) -> FaultSignals:
        """The signals with the response of the joints to their predictions, fitted to unexplained residuals (N, n).

        The predicted efforts some time before and after a sample have the same coefficient, so that the response
        contains no delay. Friction has separate ones: it is late where joints are elastic.
        """
        whitening = WhiteningFilter.fit(unexplained, self.valid, self.min_noise)
        responses = np.zeros_like(unexplained)
        for joint in range(unexplained.shape[1]):
            columns = self._response_columns(joint)
            white = whitening(columns[:, None], [joint])[:, 0]
            target = whitening(unexplained[:, [joint]], [joint])[:, 0]
            scale = np.sqrt((white**2).sum(axis=0)) + 1e-9
            squares = (white / scale).T @ (white / scale) + RIDGE * np.eye(len(scale))
            responses[:, joint] = columns @ (np.linalg.solve(squares, (white / scale).T @ target) / scale)
        return replace(self, residuals=self.residuals - responses, predicted=self.predicted + responses)

    def _response_columns(self, joint: int) -> Array:
        """Columns (N, a) of zero mean, of which the response of a joint is a linear combination."""
        earlier, now, later = self._neighbours(self.predicted[:, joint])
        earlier_signs, signs, later_signs = self._neighbours(self.velocity_signs[:, joint])
        columns = np.stack([now, *(earlier + later), *earlier_signs, signs, *later_signs], axis=-1)
        columns -= columns.mean(axis=0)
        return columns

    def _neighbours(self, values: Array) -> tuple[Array, Array, Array]:
        """Values (N,) some samples earlier (K, N), now (N,), and as many later (K, N)."""
        spacing = max(1, round(RESPONSE_DURATION / self.step / RESPONSE_SAMPLES))
        count = min(RESPONSE_SAMPLES, int(RESPONSE_DURATION / self.step))
        rows = np.arange(len(values))
        lags = spacing * np.arange(1, count + 1)[:, None]
        return values[np.maximum(rows - lags, 0)], values, values[np.minimum(rows + lags, len(values) - 1)]


def _far_from_gaps(times: Array, step: float) -> BoolArray:
    """Samples (N,) that are farther than EDGE_DURATION from both ends and all gaps."""
    # before each sample, and after the last
    is_gap = np.diff(times, prepend=-np.inf, append=np.inf) > 1.5 * step
    is_edge = is_gap[:-1] | is_gap[1:]
    width = 2 * max(2, int(EDGE_DURATION / step)) + 1
    valid: BoolArray = maximum_filter1d(is_edge.astype(int), width) == 0
    return valid
