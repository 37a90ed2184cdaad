"""Whitening of residuals, and the part of them that a change from some sample on explains.

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
VARIANCE_FLOOR = 1e-3  # part of the variance of residuals that is taken as white at least


class WhiteningFilter:
    """Filters of n joints that make their residuals white, of unit variance.

    Parameters
    ----------
    filters : (n, m + 1) coefficients of each joint, the first of them 1.
    weights : (N, n) 1 / standard deviation of the white residual; 0 for samples that do not count.
    """

    def __init__(self, filters: Array, weights: Array) -> None:
        self.filters = filters
        self.weights = weights

    @classmethod
    def fit(cls, residuals: Array, valid: BoolArray, min_noise: Array) -> WhiteningFilter:
        """Fit filters to residuals (N, n) on valid samples (N,); min_noise: (n,) least standard deviation."""
        count = int(valid.sum())
        fits = [_fit_autoregression(np.where(valid, column, 0), count) for column in residuals.T]
        filters = np.array([coefficients for coefficients, _ in fits])
        noise = np.array([deviation for _, deviation in fits])
        return cls(filters, valid[:, None] / np.maximum(noise, min_noise))

    def __call__(self, values: Array, joints: slice | Sequence[int] = slice(None)) -> Array:
        """Apply the filters of some joints to values (N, k, ...) of these joints."""
        filters = self.filters[joints]
        weights = self.weights[:, joints]
        white = [lfilter(each, 1, values[:, column], axis=0) for column, each in enumerate(filters)]
        whitened: Array = np.stack(white, axis=1) * weights.reshape(*weights.shape, *[1] * (values.ndim - 2))
        return whitened

    def correlation_sums(self, columns: Array, residuals: Array, joints: Sequence[int]) -> tuple[Array, Array]:
        """Normal equations of a change that begins at each sample.

        The filter must not use columns before the change begins: the step at its beginning dates a change best.

        Parameters
        ----------
        columns : (N, k, a) effects of the change on k joints for unit values of its a sizes.
        residuals : (N, n) white residuals.
        joints : numbers of the k joints.

        Returns
        -------
        squares : (N, a, a) and products : (N, a)
            Sums over the samples from each sample on, of white columns with themselves and with residuals.
        """
        r = residuals[:, joints]
        w = self(columns, joints)
        order = self.filters.shape[1] - 1
        squares = _shift_back(_sums_to_end(np.einsum("tja,tjb->tab", w, w)), order)
        products = _shift_back(_sums_to_end(np.einsum("tja,tj->ta", w, r)), order)
        for row in range(order):  # after the beginning, where only `row` columns before this one count
            begun = sum(self.filters[joints, lag][:, None] * _shift_back(columns, row - lag) for lag in range(row + 1))
            begun = begun * _shift_back(self.weights[:, joints], row)[..., None]
            squares += np.einsum("tja,tjb->tab", begun, begun)
            products += np.einsum("tja,tj->ta", begun, _shift_back(r, row))
        return squares, products


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


def _sums_to_end(values: Array) -> Array:
    """Sums of the rows from each row to the end."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _shift_back(values: Array, rows: int) -> Array:
    """Values some rows later, 0 beyond the end."""
    shifted = np.zeros_like(values)
    shifted[: len(values) - rows] = values[rows:]
    return shifted
