"""Linear systems in batches.

`factor` and `solve` take generic scalars: symmetric positive definite matrices, no pivoting, no branch on values.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.array_types import ScalarArray

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

MIN_INERTIA_RATIO = 1e-14
"""Pivot of an inertia matrix, as a part of its entry of the diagonal, below which it is rounding."""

Factors: TypeAlias = tuple[list[list[ScalarArray]], list[ScalarArray]]
"""L and D of L diag(D) Lᵀ: of each row of L its entries (...) left of the diagonal, and the entries (...) of D."""


def factor(matrix: ScalarArray) -> Factors:
    """Factors of a symmetric matrix (..., m, m). It is positive definite if and only if all of D is positive."""
    size = matrix.shape[-1]
    L: list[list[ScalarArray]] = [[] for _ in range(size)]
    D: list[ScalarArray] = []
    for j in range(size):
        scaled = [L[j][k] * D[k] for k in range(j)]
        D.append(matrix[..., j, j] - sum(L[j][k] * scaled[k] for k in range(j)))
        for i in range(j + 1, size):
            L[i].append((matrix[..., i, j] - sum(L[i][k] * scaled[k] for k in range(j))) / D[j])
    return L, D


def solve(factors: Factors, right_side: ScalarArray) -> ScalarArray:
    """x (..., m) of L diag(D) Lᵀ x = right_side (..., m)."""
    L, D = factors
    size = len(D)
    x = [right_side[..., i] for i in range(size)]
    for i in range(size):
        x[i] = x[i] - sum(L[i][k] * x[k] for k in range(i))
    x = [x[i] / D[i] for i in range(size)]
    for i in reversed(range(size)):
        x[i] = x[i] - sum(L[k][i] * x[k] for k in range(i + 1, size))
    return np.stack(np.broadcast_arrays(*x), axis=-1)


def solve_columns(factors: Factors, right_sides: ScalarArray) -> ScalarArray:
    """X (..., m, k) of L diag(D) Lᵀ X = right_sides (..., m, k), with one division for each entry of D."""
    L, D = factors
    size = len(D)
    rows = [right_sides[..., i, :] for i in range(size)]
    for i in range(size):
        rows[i] = rows[i] - sum(np.asarray(L[i][k])[..., None] * rows[k] for k in range(i))
    rows = [rows[i] * np.asarray(1 / D[i])[..., None] for i in range(size)]
    for i in reversed(range(size)):
        rows[i] = rows[i] - sum(np.asarray(L[k][i])[..., None] * rows[k] for k in range(i + 1, size))
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def solve_each(matrix: Array, right_side: Array) -> Array:
    """Solve one square system of numbers per sample; the same on NumPy 1.26 and 2.

    `np.linalg.solve` itself reads a right side of shape (m, 1) beside matrices of shape (N, m, m) as m vectors of
    length 1 on NumPy 1, and as one column on NumPy 2.

    Parameters
    ----------
    matrix : ndarray, shape (..., m, m)
    right_side : ndarray, shape (..., m)
        Its batch axes broadcast with those of `matrix`.

    Returns
    -------
    ndarray, shape (..., m)
        x with matrix @ x = right_side.

    Raises
    ------
    numpy.linalg.LinAlgError
        A matrix is singular.
    """
    batch = np.broadcast_shapes(matrix.shape[:-2], right_side.shape[:-1])
    columns = np.broadcast_to(right_side, (*batch, right_side.shape[-1]))[..., None]
    return np.asarray(np.linalg.solve(matrix, columns)[..., 0])
