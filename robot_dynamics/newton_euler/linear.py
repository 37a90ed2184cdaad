"""Linear systems over generic scalars and batches, symmetric positive definite or of least squares: no pivoting, no
branch on values."""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.screw import dot, join


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


class Orthogonal(NamedTuple):
    """A matrix (..., m, n) as orthogonal columns (..., m), a list of n, times a triangle with ones on its diagonal, of
    which the rows beside it are told as lists of (..., 1).

    pivots, lengths: (..., n), the square of what each column has besides those before it, and of its own length: the
    columns depend on each other where a pivot is rounding beside its length.
    """

    columns: list
    triangle: list
    pivots: np.ndarray
    lengths: np.ndarray


def orthogonal(matrix):
    """The Orthogonal of a matrix (..., m, n), by Gram and Schmidt's modified method, without square roots."""
    columns = [matrix[..., k] for k in range(matrix.shape[-1])]
    lengths = [dot(column, column) for column in columns]
    pivots, triangle = [], []
    for j, column in enumerate(columns):
        pivot = dot(column, column)
        unit = column * (1 / pivot)
        row = [dot(unit, other) for other in columns[j + 1 :]]
        columns[j + 1 :] = [other - part * column for other, part in zip(columns[j + 1 :], row, strict=True)]
        pivots.append(pivot)
        triangle.append(row)
    return Orthogonal(columns, triangle, join(pivots), join(lengths))


def least_squares(factors, right_side):
    """x (..., n) with the least |matrix x - right_side|, for the Orthogonal of a matrix and (..., m)."""
    shares = []
    for k, column in enumerate(factors.columns):
        share = dot(column, right_side) * (1 / factors.pivots[..., k : k + 1])
        right_side = right_side - share * column
        shares.append(share)
    x = [None] * len(shares)
    for j in reversed(range(len(shares))):
        later = zip(factors.triangle[j], x[j + 1 :], strict=True)
        x[j] = shares[j] - sum(part * value for part, value in later)
    return join(x)


def least_norm(factors, right_side):
    """y (..., m) of least length with matrixᵀ y = right_side (..., n), for the Orthogonal of a matrix (..., m, n)."""
    shares = []
    for k in range(len(factors.columns)):
        known = sum(
            row[k - j - 1] * share for j, (row, share) in enumerate(zip(factors.triangle, shares, strict=False))
        )
        shares.append(right_side[..., k : k + 1] - known)
    return sum(column * (share / factors.pivots[..., k : k + 1])
               for k, (column, share) in enumerate(zip(factors.columns, shares, strict=True)))  # fmt: skip
