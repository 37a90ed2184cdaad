"""Least squares over any number of samples with constant memory: one triangular factor per joint.

The factor R of [X y] of a joint contains all that least squares need: RᵀR are the normal equations, but R keeps twice
as many digits. Factors of further samples are stacked below and factored again (TSQR), in any process.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray

MIN_COLUMN_NORM = 1e-9  # relative to the longest column: the motion does not excite parameters of shorter columns


@dataclass(frozen=True, eq=False)
class TriangularFactors:
    """Triangular factors of the samples of n joints.

    triangles: (n, P + 1, P + 1) factor R of [X y] of each joint; samples: (n,) number of rows of each joint.
    """

    triangles: Array
    samples: IntArray

    @classmethod
    def from_samples(cls, X: Array, y: Array, weights: Array | None = None) -> TriangularFactors:
        """Factor columns X (N, n, P) and efforts y (N, n).

        weights: (N, n), of the squared residuals; rows of weight 0 do not count.
        """
        stacked = np.concatenate([X, y[..., None]], axis=-1)
        samples = np.full(y.shape[1], len(y))
        if weights is not None:
            stacked = stacked * np.sqrt(weights)[..., None]
            samples = np.count_nonzero(weights, axis=0)
        return cls(np.stack([_triangle(rows) for rows in np.moveaxis(stacked, 1, 0)]), samples)

    @classmethod
    def sum(cls, parts: Sequence[TriangularFactors]) -> TriangularFactors:
        """Factor the rows of several factors together."""
        stacked = np.concatenate([part.triangles for part in parts], axis=1)
        samples = np.sum([part.samples for part in parts], axis=0)
        return cls(np.stack([_triangle(rows) for rows in stacked]), samples)

    def __add__(self, other: TriangularFactors) -> TriangularFactors:
        return TriangularFactors.sum([self, other])

    def residual_sum_of_squares(self, values: Array) -> Array:
        """Compute the sums of squares (n,) of the residuals y - X values."""
        residuals = self.triangles[..., :-1] @ values - self.triangles[..., -1]
        squares: Array = np.einsum("ij,ij->i", residuals, residuals)
        return squares

    @property
    def effort_rms(self) -> Array:
        """RMS (n,) of the efforts."""
        rms: Array = np.linalg.norm(self.triangles[:, :, -1], axis=1) / np.sqrt(np.maximum(self.samples, 1))
        return rms

    def weighted_system(self, weights: Array) -> tuple[Array, Array]:
        """Return (A, b) of the least squares |A values - b|² of all joints, with weights (n,) of their squares."""
        scaled = self.triangles * np.sqrt(weights)[:, None, None]
        triangle = _triangle(scaled.reshape(-1, scaled.shape[-1]))
        return triangle[:, :-1], triangle[:, -1]


@dataclass(frozen=True, eq=False)
class LeastSquaresSolution:
    """Solution of a linear least-squares problem.

    values: (P,), zero for parameters that are not excited; covariance: (P, P), for residuals of variance 1; condition:
    condition number of the excited columns, each scaled to length 1; excited: (P,) whether the motion excites a
    parameter.
    """

    values: Array
    covariance: Array
    condition: float
    excited: BoolArray


def solve_least_squares(A: Array, b: Array, selected: BoolArray | None = None) -> LeastSquaresSolution:
    """Minimise |A values - b|². selected: (P,) columns that take part; None: all."""
    lengths = np.linalg.norm(A, axis=0)
    excited = lengths > MIN_COLUMN_NORM * lengths.max()
    if selected is not None:
        excited &= selected
    scaled = A[:, excited] / lengths[excited]
    U, s, Vt = np.linalg.svd(scaled, full_matrices=False)
    inverse = np.where(s > 1e-12 * s[0], 1 / np.maximum(s, 1e-300), 0)
    values = np.zeros(A.shape[1])
    values[excited] = (Vt.T @ (inverse * (U.T @ b))) / lengths[excited]
    covariance = np.zeros((A.shape[1], A.shape[1]))
    root = (Vt.T * inverse) / lengths[excited][:, None]
    covariance[np.ix_(excited, excited)] = root @ root.T
    return LeastSquaresSolution(values, covariance, float(s[0] / s[-1]), excited)


def _triangle(rows: Array) -> Array:
    """Compute the factor R (k, k) of rows (N, k), padded with zeros if there are fewer rows than columns."""
    R: Array = np.asarray(np.linalg.qr(rows, mode="r"))
    missing = rows.shape[1] - len(R)
    return np.concatenate([R, np.zeros((missing, rows.shape[1]))]) if missing > 0 else R
