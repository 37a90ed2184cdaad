"""Signals that faults are found in: residuals on a grid, how faults change them, and the samples that count."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from robot_dynamics.recordings.signals import lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

SMOOTHING_RATIO = 0.5  # of the cut-off: smooths predictions, as the friction of real robots reverses smoothly
MAX_SMOOTHING_BAND = 0.4  # of the rate; with a higher band samples are means over more than the filter smooths
EDGE_DURATION = 0.5  # [s] at ends and gaps that do not count, as filters have data on one side only
MIN_NOISE_RATIO = 1e-3  # of the spread of a joint's efforts
RESPONSE_DURATION = 0.4  # [s] before and after a prediction over which joints may respond to it
RESPONSE_SAMPLES = 6  # samples of the response on each side
SLOW_RATIO = 0.3  # of the typical speed: below it friction may be another (Stribeck)
FIXED_ROWS = 11  # rows of samples before those of encoder offsets


@dataclass(frozen=True, eq=False)
class FaultSignals:
    """Signals of n joints at N times.

    Attributes
    ----------
    times : (N,) [s].
    step : typical step between them [s].
    band : cut-off of the filter of predictions [Hz].
    residuals : (N, n) measured less predicted efforts [N m or N].
    predicted : (N, n) predicted efforts [N m or N].
    velocity_signs, velocities : (N, n) [rad/s or m/s].
    payload_efforts : (N, n, 4) efforts for a payload of 1 kg, and for first moments of 1 kg m along x, y, z.
    offset_efforts : (N, n, n) change of the residuals of the joints (axis 1) where an encoder (axis 2) shows positions
        that are larger by 1 rad or 1 m.
    valid : (N, n) samples that count: far from ends and gaps, of a joint that moves.
    resting : (N, n) samples of a joint that rests, far from its motion, ends and gaps.
    recorded : (N,) mean number of rows that were recorded in each step of the recording.
    """

    times: Array
    step: float
    band: float
    residuals: Array
    predicted: Array
    velocity_signs: Array
    velocities: Array
    payload_efforts: Array
    offset_efforts: Array
    valid: BoolArray
    resting: BoolArray
    recorded: Array

    @classmethod
    def from_rows(cls, rows: Array, cutoff: float) -> FaultSignals:
        """Make the signals from stacked samples.

        Parameters
        ----------
        rows : (11 + n, N, n) times, whether joints move, rows recorded in each step, measured efforts, predicted
            efforts, signs of velocities, velocities, four payload efforts, and the n effects of encoder offsets.
            Measured efforts are not filtered: that would blur the onset of a fault.
        cutoff : cut-off frequency of the motion [Hz].
        """
        times = rows[0, :, 0]
        moves = rows[1] > 1 - 1e-9
        rests = rows[1] < 1e-9
        measured = rows[3]
        predictors = rows[4:]
        step = float(np.median(np.diff(times)))
        band = SMOOTHING_RATIO * cutoff
        if band * step < MAX_SMOOTHING_BAND:
            columns = predictors.transpose(1, 0, 2).reshape(len(times), -1)
            columns = lowpass(columns, 1 / step, band)
            predictors = columns.reshape(len(times), len(predictors), -1).transpose(1, 0, 2)
        predicted, velocity_signs, velocities = predictors[:3]
        inside = _far_from_gaps(times, step)[:, None]
        return cls(
            times=times,
            step=step,
            band=band,
            residuals=measured - predicted,
            predicted=predicted,
            velocity_signs=velocity_signs,
            velocities=velocities,
            payload_efforts=np.stack(list(predictors[3:7]), axis=-1),
            offset_efforts=np.stack(list(predictors[7:]), axis=-1),
            valid=inside & moves,
            resting=inside & _far_from_motion(rests, step),
            recorded=rows[2].max(axis=1),
        )

    @property
    def min_noise(self) -> Array:
        """Least standard deviation (n,) of noise."""
        minimum: Array = MIN_NOISE_RATIO * self.predicted.std(axis=0) + 1e-9
        return minimum

    @cached_property
    def effort_rates(self) -> Array:
        """Time derivatives (N, n) of the measured efforts, without noise: a delay changes efforts by its part of them.

        Those of predicted efforts are larger where Coulomb friction changes its sign.
        """
        efforts = self.residuals + self.predicted
        if self.band * self.step < MAX_SMOOTHING_BAND:
            efforts = lowpass(efforts, 1 / self.step, self.band)
        rates: Array = np.gradient(efforts, self.step, axis=0)
        return rates

    @cached_property
    def model_error_columns(self) -> list[tuple[Array, int]]:
        """For each joint: see `_model_error_columns`."""
        return [self._model_error_columns(joint) for joint in range(self.residuals.shape[1])]

    def _model_error_columns(self, joint: int) -> tuple[Array, int]:
        """Columns (N, K) of which the constant error of the model of a joint is a linear combination.

        Returns
        -------
        columns : (N, K)
            Friction that changes with time, as joints warm up; offset, friction as a curve over velocity, scale and
            delay; then the response of the joint to its prediction. Efforts some time before and after a sample have
            the same coefficient, so that the response contains no delay. Friction has separate ones: it is late where
            joints are elastic.
        free : int
            Number of columns before those of the response.
        """
        earlier, now, later = self._neighbours(self.predicted[:, joint])
        earlier_signs, signs, later_signs = self._neighbours(self.velocity_signs[:, joint])
        velocity = self.velocities[:, joint]
        speed = np.abs(velocity)
        typical_speed = (
            float(np.sqrt(np.mean(velocity[self.valid[:, joint]] ** 2))) if self.valid[:, joint].any() else 0.0
        )
        slow = signs / (1 + (speed / (SLOW_RATIO * typical_speed + 1e-9)) ** 2)
        age = (self.times - self.times[0]) / (self.times[-1] - self.times[0])
        free = [age * signs, age * velocity, np.ones(len(now)), velocity, signs, slow, speed, speed * velocity]
        free += [now, self.effort_rates[:, joint]]
        return np.stack([*free, *(earlier + later), *earlier_signs, *later_signs], axis=-1), len(free)

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


def _far_from_motion(rests: BoolArray, step: float) -> BoolArray:
    """Samples (N, n) of joints that have rested, and will rest, for EDGE_DURATION."""
    width = 2 * max(2, int(EDGE_DURATION / step)) + 1
    far: BoolArray = minimum_filter1d(rests.astype(int), width, axis=0) > 0
    return far
