"""Signals: put on a uniform grid, low-pass filtered without delay, differentiated, and compared in time."""

import numpy as np
from scipy.interpolate import Akima1DInterpolator, CubicSpline
from scipy.signal import butter, correlate, correlation_lags, sosfiltfilt

from robot_dynamics.errors import RecordingError

FILTER_ORDER = 4  # of the Butterworth filter, which runs forth and back
DEFAULT_CUTOFF = 8.0  # [Hz] what arms that people stand beside do
MAX_CUTOFF_RATIO = 0.2  # of the rate: cut-off where the default would be above what the rate can tell
SETTLING_PERIODS = 6.0  # periods of the cut-off after which the filter has forgotten its beginning to 1e-6
GRID_TOLERANCE = 0.02  # steps that a stamp may be from the grid to be on it
MIN_SPLINE_SAMPLES = 4  # samples that tell a cubic spline
MAX_STEP_RATIO = 4.0  # longest step over the shortest, beyond which a cubic spline makes much of the noise of samples


def interpolate_on_grid(times, values, grid):
    """Values (N, k) at the times of a grid (N,), by cubic splines of values (M, k) at times (M,), ascending.

    Where the samples are on the grid they are taken as they are. Where their steps are uneven the splines are Akima's,
    whose slopes depend on neighbouring samples alone. A column with nan in it is nan. Raises ValueError
    where there are fewer samples than a cubic spline needs, LEAST_OF_SPLINE: leave such pieces out.
    """
    if len(times) >= len(grid) and len(grid):
        first = np.searchsorted(times, grid[0] - 0.5 * (grid[1] - grid[0] if len(grid) > 1 else 0))
        same = times[first : first + len(grid)]
        if len(same) == len(grid) and np.abs(same - grid).max() <= GRID_TOLERANCE * (grid[-1] - grid[0]) / max(
            1, len(grid)
        ):
            return values[first : first + len(grid)]
    found = np.full((len(grid), values.shape[1]), np.nan)
    whole = np.isfinite(values).all(axis=0)
    if len(times) < MIN_SPLINE_SAMPLES:
        raise ValueError(f"{len(times)} samples: a cubic spline needs {MIN_SPLINE_SAMPLES} at least")
    if whole.any():
        steps = np.diff(times)
        spline = CubicSpline if steps.max() <= MAX_STEP_RATIO * steps.min() else Akima1DInterpolator
        found[:, whole] = spline(times, values[:, whole])(grid, extrapolate=True)  # by rounding, at the ends
    return found


def choose_cutoff(rate, cutoff=None):
    """The cut-off [Hz] to filter with: the one that is asked for, else the default or what the rate [1/s] allows.

    Raises RecordingError where the rate does not allow the one that is asked for.
    """
    if cutoff is None:
        return min(DEFAULT_CUTOFF, MAX_CUTOFF_RATIO * rate)
    if not 0 < cutoff < 0.5 * rate:
        raise RecordingError(
            f"cut-off {cutoff:g} Hz of samples at {rate:.4g} Hz: between 0 and {rate / 2:.4g} is needed"
        )
    return cutoff


def filter_margin(rate, cutoff):
    """Samples at each end of a piece that the filter is not yet settled in."""
    return int(np.ceil(SETTLING_PERIODS * rate / cutoff))


def lowpass(values, rate, cutoff):
    """Values (N, k) at a rate [1/s] without what is above the cut-off [Hz], without delay.

    A Butterworth filter of order 4, forth and back: half of the amplitude is left at the cut-off. N > 15.
    """
    sections = butter(FILTER_ORDER, cutoff, fs=rate, output="sos")
    return sosfiltfilt(sections, values, axis=0)


def differentiate(values, rate):
    """Time derivatives (N, k) of values (N, k), by central differences."""
    return np.gradient(values, 1 / rate, axis=0)


def estimate_delay(later, earlier, rate, longest=0.2):
    """By how much [s] `later` (N,) runs behind `earlier` (N,): the peak of their correlation, between samples too.

    longest [s]: what is looked for, to both sides. nan where one of them does not move.
    """
    a, b = later - later.mean(), earlier - earlier.mean()
    if not a.any() or not b.any():
        return np.nan
    product, lags = correlate(a, b, mode="full"), correlation_lags(len(a), len(b))
    near = np.abs(lags) <= max(1, round(longest * rate))
    product, lags = product[near] / (len(a) - np.abs(lags[near])), lags[near]
    peak = int(np.argmax(product))
    shift = 0.0
    if 0 < peak < len(product) - 1:
        left, top, right = product[peak - 1 : peak + 2]
        shift = 0.5 * (left - right) / (left - 2 * top + right)
    return float((lags[peak] + shift) / rate)
