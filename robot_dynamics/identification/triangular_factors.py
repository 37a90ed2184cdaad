"""Least squares over any number of samples: one triangular factor for each joint is kept, samples never.

The factor R of [X y] of a joint has all that least squares need (RᵀR are the normal equations, of which it keeps twice
the digits). Factors of other samples are put below and factored again (TSQR), whoever computed them.
"""

from dataclasses import dataclass

import numpy as np

MIN_COLUMN_NORM = 1e-9  # of a column, as part of the longest one: shorter, the motion does not show its parameter


@dataclass(frozen=True, eq=False)
class TriangularFactors:
    """triangles: (n, P + 1, P + 1), R of [X y] of each joint; samples: how many rows each of them has."""

    triangles: np.ndarray
    samples: int

    @classmethod
    def from_samples(cls, X, y, weights=None):
        """Of columns X (N, n, P) and efforts y (N, n); weights: (N, n) of the squares."""
        both = np.concatenate([X, y[..., None]], axis=-1)
        if weights is not None:
            both = both * np.sqrt(weights)[..., None]
        return cls(np.stack([_triangle(rows) for rows in np.moveaxis(both, 1, 0)]), len(X))

    def __add__(self, other):
        both = np.concatenate([self.triangles, other.triangles], axis=1)
        return TriangularFactors(np.stack([_triangle(rows) for rows in both]), self.samples + other.samples)

    def residual_sum_of_squares(self, values):
        """(n,) sums of squares of the residuals y - X values."""
        residuals = self.triangles[..., :-1] @ values - self.triangles[..., -1]
        return np.einsum("ij,ij->i", residuals, residuals)

    def weighted_system(self, weights):
        """(A, b) of the least squares |A values - b|² of all joints, their squares weighted by (n,) weights."""
        scaled = self.triangles * np.sqrt(weights)[:, None, None]
        triangle = _triangle(scaled.reshape(-1, scaled.shape[-1]))
        return triangle[:, :-1], triangle[:, -1]


@dataclass(frozen=True, eq=False)
class LeastSquaresSolution:
    """values (P,), zero of those that are not seen; covariance (P, P) for residuals of variance 1; condition: number of
    the columns that are seen, each of length 1; seen: (P,) whether the motion shows it."""

    values: np.ndarray
    covariance: np.ndarray
    condition: float
    excited: np.ndarray


def solve_least_squares(A, b, selected=None):
    """The Solution of least squares |A values - b|²; wanted: (P,) which columns take part."""
    lengths = np.linalg.norm(A, axis=0)
    excited = lengths > MIN_COLUMN_NORM * lengths.max()
    if selected is not None:
        excited &= selected
    scaled = A[:, excited] / lengths[excited]
    U, s, Vt = np.linalg.svd(scaled, full_matrices=False)
    inverse = np.where(s > 1e-12 * s[0], 1 / np.maximum(s, 1e-300), 0)
    values, covariance = np.zeros(A.shape[1]), np.zeros((A.shape[1],) * 2)
    values[excited] = (Vt.T @ (inverse * (U.T @ b))) / lengths[excited]
    half = (Vt.T * inverse) / lengths[excited][:, None]
    covariance[np.ix_(excited, excited)] = half @ half.T
    return LeastSquaresSolution(values, covariance, float(s[0] / s[-1]), excited)


def _triangle(rows):
    """R (k, k) of rows (N, k), with zeros below where there are fewer rows than columns."""
    R = np.linalg.qr(rows, mode="r")
    missing = rows.shape[1] - len(R)
    return np.concatenate([R, np.zeros((missing, rows.shape[1]))]) if missing > 0 else R
