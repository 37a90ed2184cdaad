"""Least squares over generic scalars and batches, no branch on values: a matrix as reflections and a triangle.

Where blocks of rows have columns of their own, as loops have joints that no other loop has, each block is reflected by
itself, and of the columns that blocks share only what is normal to these columns goes on: so the legs of a parallel
robot are eliminated one by one, and what is left for the platform is small.

Right sides are matrices (..., m, k) or (..., n, k), solved column by column.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.friction import signs
from robot_dynamics.newton_euler.screw import concatenate_vectors, dot, stack_matrices, stack_vectors

_recorded_root = np.frompyfunc(lambda scalar: scalar.sqrt() if hasattr(scalar, "sqrt") else np.sqrt(scalar), 1, 1)


class HouseholderFactors(NamedTuple):
    """A matrix (..., m, n), m not less than n, as H_1 ... H_n [R; 0], R a triangle (Householder).

    H_j is 1 - share v vᵀ on the rows from j on. normals: list of v (..., m - j), of which the first entry is 1; shares:
    list of (..., 1); triangle: list of the rows of R (..., n - j), the diagonal first.
    """

    vectors: list
    scales: list
    triangle: list


def factor_householder(matrix):
    """The Reflections of a matrix (..., m, n)."""
    vectors, shares, triangle = [], [], []
    for _ in range(matrix.shape[-1]):
        normal, share, diagonal = _reflection(matrix[..., 0])
        others = _reflected(normal, share, matrix[..., 1:])
        vectors.append(normal)
        shares.append(share)
        triangle.append(np.concatenate([diagonal, others[..., 0, :]], axis=-1))
        matrix = others[..., 1:, :]
    return HouseholderFactors(vectors, shares, triangle)


def _reflection(x):
    """(v, share, entry (..., 1)): of the reflection that leaves of x (..., r) its first entry alone."""
    first = x[..., :1]
    if x.shape[-1] == 1:
        return np.ones(1, dtype=int), np.zeros(1, dtype=int), first
    # away from x, so that nothing cancels; of 0 the sign is 1
    entry = -signs(signs(first) + 0.5) * _root(dot(x, x))
    tail = x[..., 1:] * (1 / (first - entry))
    return np.concatenate([np.ones_like(first), tail], axis=-1), 1 - first * (1 / entry), entry


def _reflected(normal, share, matrix):
    """H matrix (..., r, k)."""
    row = share[..., None] * (normal[..., None, :] @ matrix)
    return matrix - normal[..., None] * row


def _turned(factors, matrix):
    """H_n ... H_1 matrix (..., m, k): the first n of its rows, a list of (..., k)."""
    rows = []
    for normal, share in zip(factors.vectors, factors.scales, strict=True):
        matrix = _reflected(normal, share, matrix)
        rows.append(matrix[..., 0, :])
        matrix = matrix[..., 1:, :]
    return rows


def _turned_back(factors, rows, rest):
    """H_1 ... H_n [rows; rest] (..., m, k), for a list of n rows (..., k) and (..., m - n, k)."""
    for normal, share, row in zip(*map(reversed, (factors.vectors, factors.scales, rows)), strict=True):
        rest = _reflected(normal, share, stack_matrices([row[..., None, :], rest]))
    return rest


def _solved(factors, right_side):
    """x (..., n, k) with the least |matrix x - right_side|."""
    x = _turned(factors, right_side)
    for j in reversed(range(len(x))):
        row = factors.triangle[j]
        known = sum(row[..., i - j, None] * x[i] for i in range(j + 1, len(x)))
        x[j] = (x[j] - known) * (1 / row[..., :1])
    return stack_vectors(x) if x else np.zeros((0, right_side.shape[-1]), dtype=int)


def _solved_transposed(factors, right_side, size):
    """y (..., m, k) of least length with matrixᵀ y = right_side (..., n, k), m the size."""
    y = []
    for j in range(len(factors.triangle)):
        known = sum(factors.triangle[i][..., j - i, None] * y[i] for i in range(j))
        y.append((right_side[..., j, :] - known) * (1 / factors.triangle[j][..., :1]))
    return _turned_back(factors, y, np.zeros((size - len(y), right_side.shape[-1]), dtype=int))


def _complement(factors, size):
    """(..., m, m - n): columns of length 1 that are normal to those of the matrix and to each other, m the size."""
    normal = size - len(factors.vectors)
    return _turned_back(factors, [np.zeros(normal, dtype=int)] * len(factors.vectors), np.eye(normal, dtype=int))


class Partition(NamedTuple):
    """Blocks of rows of a matrix (..., m, n), one after the other, as `partition` makes it.

    rows: the slice of each block; columns: of each, numbers of the columns that are zero in all other rows; border:
    numbers of the columns that blocks share; order: where each column stands among the former, block by block, and the
    border after them.
    """

    rows: list
    columns: list
    border: np.ndarray
    order: np.ndarray


def partition(rows, columns, size):
    """The Partition of matrices of so many columns."""
    own = np.concatenate(columns)
    border = np.setdiff1d(np.arange(size), own)
    return Partition(rows, columns, border, np.argsort(np.concatenate([own, border])))


class Block(NamedTuple):
    """own: the Reflections of a block's own columns; normal: (..., rows, rows - columns) what is normal to them, none
    where there is no border; shared: (..., rows, border) its part of the border."""

    own: HouseholderFactors
    normal: np.ndarray
    shared: np.ndarray

    def in_complement(self, part):
        """What is normal to the block's own columns, of rows (..., rows, k)."""
        return np.swapaxes(self.normal, -1, -2) @ part


class BorderedFactors(NamedTuple):
    """A matrix (..., m, n) with a Partition.

    blocks: list of Block; inner: the Reflections of what the border has that is normal to the blocks' own columns.
    pivots, lengths: (..., n), the square of what each column has besides those of its block before it, one of the
    border besides those of all blocks and of the border before it; and of its own length: the columns depend on each
    other where a pivot is rounding beside its length.
    """

    partition: Partition
    blocks: list
    inner: HouseholderFactors
    pivots: np.ndarray
    squared_norms: np.ndarray


def factor_bordered(matrix, partition):
    """The Bordered form of a matrix (..., m, n) that has this Partition."""
    blocks = []
    for rows, columns in zip(partition.rows, partition.columns, strict=True):
        part = matrix[..., rows, :]
        own, size = factor_householder(part[..., columns]), part.shape[-2]
        normal = _complement(own, size) if len(partition.border) else np.zeros((size, 0), dtype=int)
        blocks.append(Block(own, normal, part[..., partition.border]))
    inner = factor_householder(stack_matrices([block.in_complement(block.shared) for block in blocks]))
    triangles = [*(block.own.triangle for block in blocks), inner.triangle]
    pivots = concatenate_vectors([row[..., :1] * row[..., :1] for triangle in triangles for row in triangle])
    return BorderedFactors(partition, blocks, inner, pivots[..., partition.order], (matrix * matrix).sum(axis=-2))


def least_squares(factors, right_side):
    """x (..., n, k) with the least |matrix x - right_side|, for a Bordered matrix and (..., m, k)."""
    partition, blocks, inner, _, _ = factors
    parts = [right_side[..., rows, :] for rows in partition.rows]
    z = _solved(inner, stack_matrices([block.in_complement(part) for block, part in zip(blocks, parts, strict=True)]))
    own = [_solved(block.own, part - block.shared @ z) for block, part in zip(blocks, parts, strict=True)]
    return stack_matrices([*own, z])[..., partition.order, :]


def least_norm(factors, right_side):
    """y (..., m, k) of least length with matrixᵀ y = right_side (..., n, k), for a Bordered matrix."""
    partition, blocks, inner, _, _ = factors
    own, left = [], right_side[..., partition.border, :]
    for block, columns in zip(blocks, partition.columns, strict=True):
        own.append(_solved_transposed(block.own, right_side[..., columns, :], block.normal.shape[-2]))
        left = left - np.swapaxes(block.shared, -1, -2) @ own[-1]
    ends = np.cumsum([block.normal.shape[-1] for block in blocks])
    shares = np.split(_solved_transposed(inner, left, ends[-1]), ends[:-1], axis=-2)
    return stack_matrices([y + block.normal @ share for y, block, share in zip(own, blocks, shares, strict=True)])


def _root(squares):
    return np.sqrt(squares) if np.asarray(squares).dtype != object else _recorded_root(squares)
