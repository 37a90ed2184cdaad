"""Linear systems over generic scalars and batches, symmetric positive definite: no pivoting, no branch on values."""

import numpy as np


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
