"""Noise of residuals of joints without its colour, and what a change from some row on takes off it.

What a model does not know of a robot comes and goes slowly, and the residuals of one sample say what those of the next
will be. An autoregression takes off what is foretold: what is left is white, and its squares can be counted.
"""

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.signal import lfilter

AUTOREGRESSION_ORDER = 4  # of the autoregression
VARIANCE_FLOOR = 1e-3  # of the variance of residuals that is white at least


class WhiteningFilter:
    """filters: (n, m + 1) of the joints, each with 1 first; weights: (N, n), 1 / noise, or 0 where nothing counts."""

    def __init__(self, filters, weights):
        self.filters, self.weights = filters, weights

    @classmethod
    def fit(cls, residuals, valid, min_noise):
        """That of residuals (N, n) on sound rows (N,); least: (n,) noise that there is at least."""
        filters, noise = zip(*(_autoregression(np.where(valid, column, 0), valid.sum()) for column in residuals.T),
                             strict=True)  # fmt: skip
        return cls(np.array(filters), valid[:, None] / np.maximum(noise, min_noise))

    def __call__(self, values, joints=slice(None)):
        """Values (N, k, ...) of some joints, white."""
        filters, weights = self.filters[joints], self.weights[:, joints]
        white = [lfilter(each, 1, values[:, column], axis=0) for column, each in enumerate(filters)]
        return np.stack(white, axis=1) * weights.reshape(*weights.shape, *[1] * (values.ndim - 2))

    def correlation_sums(self, columns, residuals, joints):
        """(squares (N, a, a), products (N, a)) of columns (N, k, a) of some joints that begin at each row, with white
        residuals (N, n).

        The filter must not see what columns were before they begin: a step is what dates a change best.
        """
        r, w, m = residuals[:, joints], self(columns, joints), self.filters.shape[1] - 1
        squares = _ahead(_suffix(np.einsum("tja,tjb->tab", w, w)), m)
        products = _ahead(_suffix(np.einsum("tja,tj->ta", w, r)), m)
        for row in range(m):  # after the beginning: only `row` columns before it are there
            begun = sum(self.filters[joints, lag][:, None] * _ahead(columns, row - lag) for lag in range(row + 1))
            begun = begun * _ahead(self.weights[:, joints], row)[..., None]
            squares += np.einsum("tja,tjb->tab", begun, begun)
            products += np.einsum("tja,tj->ta", begun, _ahead(r, row))
        return squares, products


def _autoregression(values, count):
    """(filter (m + 1,), noise) of values (N,), of which `count` are not 0: Yule and Walker."""
    covariance = np.array(
        [values[: len(values) - lag] @ values[lag:] for lag in range(AUTOREGRESSION_ORDER + 1)]
    ) / max(1, count)
    covariance[0] = covariance[0] * (1 + VARIANCE_FLOOR) + 1e-30
    foretold = solve_toeplitz(covariance[:AUTOREGRESSION_ORDER], covariance[1:])
    return np.r_[1, -foretold], np.sqrt(max(covariance[0] - foretold @ covariance[1:], 0))


def _suffix(values):
    """Sums of all rows from each row on."""
    return np.cumsum(values[::-1], axis=0)[::-1]


def _ahead(values, rows):
    """What stands so many rows later; 0 beyond the end."""
    found = np.zeros_like(values)
    found[: len(values) - rows] = values[rows:]
    return found
