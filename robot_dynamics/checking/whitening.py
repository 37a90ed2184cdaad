"""Whitening of residuals: filters that make the residuals of neighbouring samples independent.

Errors of a model vary slowly, so that residuals of neighbouring samples are correlated. An autoregression predicts the
residual of a sample from those before it. Its prediction errors are white, so that their squares can be compared with
the variance of noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, cast

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

from robot_dynamics.array_types import Array

if TYPE_CHECKING:
    from robot_dynamics.array_types import BoolArray

AUTOREGRESSION_ORDER = 4
VARIANCE_FLOOR = 0.1  # part of the variance of residuals that is taken as white at least


class WhiteningFilter:
    """Filters of n joints that make their residuals white, of unit variance.

    Parameters
    ----------
    filters : (n, m + 1) coefficients of each joint, the first of them 1.
    deviations : (n,) standard deviations of the white residuals.
    valid : (N, n) samples that count.

    Attributes
    ----------
    weights : (N, n) 1 / standard deviation of the white residual; 0 for samples that do not count.
    """

    def __init__(self, filters: Array, deviations: Array, valid: BoolArray) -> None:
        self.filters = filters
        self.deviations = deviations
        self.weights: Array = valid / deviations
        self._counts = valid.sum(axis=0)

    @classmethod
    def fit(cls, residuals: Array, valid: BoolArray, min_noise: Array) -> WhiteningFilter:
        """Fit filters to residuals (N, n) on valid samples (N, n); min_noise: (n,) least standard deviation."""
        fits = [
            _fit_autoregression(np.where(counts, column, 0), int(counts.sum()))
            for column, counts in zip(residuals.T, valid.T, strict=True)
        ]
        filters = np.array([coefficients for coefficients, _ in fits])
        noise = np.array([deviation for _, deviation in fits])
        return cls(filters, np.maximum(noise, min_noise), valid)

    @property
    def order(self) -> int:
        """Number of earlier samples that the filters use."""
        return int(self.filters.shape[1]) - 1

    @property
    def log_likelihood(self) -> float:
        """Logarithm of the Gaussian likelihood of the residuals that the filters were fitted to, up to a constant."""
        return -float(self._counts @ np.log(self.deviations))

    def __call__(self, values: Array, joints: slice | Sequence[int] = slice(None)) -> Array:
        """Apply the filters of some joints to values (N, k, ...) of these joints."""
        filters = self.filters[joints]
        weights = self.weights[:, joints]
        white = [lfilter(each, 1, values[:, column], axis=0) for column, each in enumerate(filters)]
        whitened: Array = np.stack(white, axis=1) * weights.reshape(*weights.shape, *[1] * (values.ndim - 2))
        return whitened

    def first_samples(self, values: Array, lag: int, joints: Sequence[int]) -> Array:
        """The white value of the sample `lag` after each sample, where values (N, k, a) are 0 before that sample.

        The filter must not use columns before a change begins: the step at its beginning dates a change best.
        """
        filters = self.filters[list(joints)]
        begun = sum(filters[:, step][:, None] * shift_back(values, lag - step) for step in range(lag + 1))
        whitened: Array = begun * shift_back(self.weights[:, list(joints)], lag)[..., None]
        return whitened


def _fit_autoregression(values: Array, count: int) -> tuple[Array, float]:
    """Filter (m + 1,) and standard deviation of the prediction error, by the Yule-Walker equations.

    values: (N,), of which `count` are not 0.
    """
    products = [values[: len(values) - lag] @ values[lag:] for lag in range(AUTOREGRESSION_ORDER + 1)]
    covariance = np.array(products) / max(1, count)
    covariance[0] = covariance[0] * (1 + VARIANCE_FLOOR) + 1e-30
    coefficients = cast(Array, solve_toeplitz(covariance[:AUTOREGRESSION_ORDER], covariance[1:]))
    variance = covariance[0] - coefficients @ covariance[1:]
    return np.r_[1, -coefficients], float(np.sqrt(max(variance, 0)))


def sums_to_end(values: Array) -> Array:
    """Sums of the rows from each row to the end."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def shift_back(values: Array, rows: int) -> Array:
    """Values some rows later, 0 beyond the end."""
    shifted = np.zeros_like(values)
    shifted[: len(values) - rows] = values[rows:]
    return shifted
