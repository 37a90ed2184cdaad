"""Signals: interpolated on a uniform grid, low-pass filtered without delay, and differentiated."""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline
from scipy.ndimage import convolve1d, maximum_filter1d, minimum_filter1d
from scipy.signal import butter, sosfiltfilt

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

FILTER_ORDER = 4  # of the Butterworth filter, which runs forward and backward
DEFAULT_CUTOFF = 8.0  # [Hz] above the motion of collaborative arms
MAX_CUTOFF_RATIO = 0.2  # of the rate: cut-off where the rate is too low for the default
SETTLING_PERIODS = 6.0  # periods of the cut-off after which the transient of the filter has decayed to 1e-6
GRID_TOLERANCE = 0.02  # steps between a stamp and the grid point that it counts as
MIN_SPLINE_SAMPLES = 4  # samples that define a cubic spline
MAX_STEP_RATIO = 4.0  # of nearby steps, beyond which a cubic spline amplifies the noise of samples
UNEVEN_REACH = 4  # steps on both sides of an interval that are compared
EXTENSION_PERIODS = 2.0  # periods of the cut-off by which the filter extends a signal at both ends
FITTED_PERIODS = 1.5  # periods of the cut-off at an end, to which the parabola of the extension is fitted
DIFFERENCE_REACH = 10  # samples on each side that a derivative uses


def interpolate_on_grid(times: Array, values: Array, grid: Array) -> Array:
    """Interpolate samples on a uniform grid by cubic splines.

    Samples that lie on the grid are copied. Near steps of very different size the splines are Akima's, whose slopes
    depend on neighbouring samples only. A column with nan in it becomes nan.

    Parameters
    ----------
    times : (M,) times [s], ascending.
    values : (M, k)
    grid : (N,) times [s], in equal steps.

    Returns
    -------
    (N, k)

    Raises
    ------
    ValueError
        Where M < `MIN_SPLINE_SAMPLES` and the samples are not on the grid.
    """
    if len(times) >= len(grid) and len(grid):
        first = np.searchsorted(times, grid[0] - 0.5 * (grid[1] - grid[0] if len(grid) > 1 else 0))
        candidates = times[first : first + len(grid)]
        tolerance = GRID_TOLERANCE * (grid[-1] - grid[0]) / max(1, len(grid))
        if len(candidates) == len(grid) and np.abs(candidates - grid).max() <= tolerance:
            return values[first : first + len(grid)]
    if len(times) < MIN_SPLINE_SAMPLES:
        raise ValueError(f"{len(times)} samples: a cubic spline needs at least {MIN_SPLINE_SAMPLES}")
    interpolated = np.full((len(grid), values.shape[1]), np.nan)
    is_complete = np.isfinite(values).all(axis=0)
    if is_complete.any():
        columns = values[:, is_complete]
        # rounding may put the ends of the grid beyond the samples
        result = CubicSpline(times, columns)(grid, extrapolate=True)
        intervals = np.clip(np.searchsorted(times, grid, side="right") - 1, 0, len(times) - 2)
        uneven = _uneven_intervals(np.diff(times))[intervals]
        if uneven.any():
            result[uneven] = Akima1DInterpolator(times, columns)(grid[uneven], extrapolate=True)
        interpolated[:, is_complete] = result
    return interpolated


def _uneven_intervals(steps: Array) -> BoolArray:
    """Intervals (M,) near which steps [s] differ by more than `MAX_STEP_RATIO`."""
    size = 2 * UNEVEN_REACH + 1
    uneven: BoolArray = maximum_filter1d(steps, size) > MAX_STEP_RATIO * minimum_filter1d(steps, size)
    return uneven


def choose_cutoff(rate: float, cutoff: float | None = None) -> float:
    """Choose the cut-off frequency of the low-pass filter.

    Parameters
    ----------
    rate : samples per second.
    cutoff : requested cut-off [Hz]; None: `DEFAULT_CUTOFF`, or a fifth of the rate where that is lower.

    Raises
    ------
    RecordingError
        Where the requested cut-off is not below half of the rate.
    """
    if cutoff is None:
        return min(DEFAULT_CUTOFF, MAX_CUTOFF_RATIO * rate)
    if not 0 < cutoff < 0.5 * rate:
        raise RecordingError(
            f"cut-off {cutoff:g} Hz for samples at {rate:.4g} Hz: between 0 and {rate / 2:.4g} is needed"
        )
    return cutoff


def filter_margin(rate: float, cutoff: float) -> int:
    """Samples at each end of a piece in which the transient of the filter has not decayed."""
    return int(np.ceil(SETTLING_PERIODS * rate / cutoff))


def lowpass(values: Array, rate: float, cutoff: float) -> Array:
    """Low-pass filter signals without delay.

    A Butterworth filter of order 4, forward and backward, so that half of the amplitude is left at the cut-off. Both
    ends are extended by parabolas that are fitted to the samples nearby: an extension by reflection about the last
    sample, as is usual, has twice the noise of that sample.

    Parameters
    ----------
    values : (N, k), N > 2.
    rate : samples per second.
    cutoff : cut-off frequency [Hz].
    """
    sections = butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    size = round(EXTENSION_PERIODS * rate / cutoff)
    fitted = min(len(values), max(3, round(FITTED_PERIODS * rate / cutoff)))
    before = _extrapolate_parabola(values[:fitted][::-1], size)[::-1]
    after = _extrapolate_parabola(values[-fitted:], size)
    extended = np.concatenate([before, values, after])
    filtered: Array = sosfiltfilt(sections, extended, axis=0, padlen=0)[size : size + len(values)]
    return filtered


def _extrapolate_parabola(values: Array, size: int) -> Array:
    """The next values (size, k) of parabolas through values (N, k), by least squares."""
    numbers = np.arange(len(values) + size) / len(values)
    powers = np.vander(numbers, 3)
    extrapolation = powers[len(values) :] @ np.linalg.pinv(powers[: len(values)])
    extrapolated: Array = extrapolation @ values
    return extrapolated


def differentiate(values: Array, rate: float) -> Array:
    """Compute the time derivatives of filtered signals.

    The derivative is that of the polynomial through 21 samples, in their middle. It is exact to 1e-5 up to a fifth of
    the rate, where central differences lose a quarter of the amplitude. Noise above is not amplified more than by an
    exact derivative: filter the signals.

    Parameters
    ----------
    values : (N, k)
    rate : samples per second.

    Returns
    -------
    (N, k)
        At both ends the signal is extended by its reflection about the last sample.
    """
    if len(values) < 2:
        return np.zeros_like(values)
    reach = DIFFERENCE_REACH
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    derivatives: Array = convolve1d(padded, rate * _difference_weights(), axis=0)[reach:-reach]
    return derivatives


def _difference_weights() -> Array:
    """Weights (21,) of a convolution: the derivative of the polynomial through samples at −10 … 10, at 0.

    Fornberg, Generation of finite difference formulas on arbitrarily spaced grids (1988).
    """
    p = DIFFERENCE_REACH
    later = [(-1) ** (k + 1) * factorial(p) ** 2 / (k * factorial(p - k) * factorial(p + k)) for k in range(1, p + 1)]
    # a convolution reverses its weights
    return np.array([*reversed(later), 0.0, *(-weight for weight in later)])
