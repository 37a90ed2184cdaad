"""Linear systems in batches. Those over generic scalars are symmetric positive definite: no pivoting, no branch on
values."""

import numpy as np

MIN_INERTIA_RATIO = 1e-14
"""Pivot of an inertia matrix, as a part of its entry of the diagonal, below which it is rounding."""


def factor(matrix):
    """L and D of matrix = L diag(D) Lᵀ, for a symmetric matrix (..., m, m): L as rows of columns, D as a list.

    The matrix is positive definite where, and only where, every entry of D is positive.
    """
    size = matrix.shape[-1]
    L = [[None] * size for _ in range(size)]
    D = []
    for j in range(size):
        scaled = [L[j][k] * D[k] for k in range(j)]
        D.append(matrix[..., j, j] - sum(L[j][k] * scaled[k] for k in range(j)))
        for i in range(j + 1, size):
            L[i][j] = (matrix[..., i, j] - sum(L[i][k] * scaled[k] for k in range(j))) / D[j]
    return L, D


def solve(factors, right_side):
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


def solve_each(matrix: np.ndarray, right_side: np.ndarray) -> np.ndarray:
    """Solve one square system of numbers per sample; the same on NumPy 1.26 and 2.

    `np.linalg.solve` itself reads a right side of shape (m, 1) beside matrices of shape (N, m, m) as m vectors of
    length 1 on NumPy 1, and as one column on NumPy 2.

    Parameters
    ----------
    matrix : (..., m, m)
    right_side : (..., m); its batch axes broadcast with those of `matrix`.

    Returns
    -------
    x : (..., m), such that matrix @ x = right_side.

    Raises
    ------
    numpy.linalg.LinAlgError
        Where a matrix is singular.
    """
    batch = np.broadcast_shapes(matrix.shape[:-2], right_side.shape[:-1])
    columns = np.broadcast_to(right_side, (*batch, right_side.shape[-1]))[..., None]
    return np.linalg.solve(matrix, columns)[..., 0]
