"""Least squares over generic scalars and batches, without branches on values: Householder reflections and triangles.

Where blocks of rows have columns of their own, as loops have joints that no other loop has, each block is factorized by
itself. Of the columns that blocks share only the part normal to these columns remains: so the legs of a parallel robot
are eliminated one by one, and the system that remains for the platform is small.

Right sides are matrices (..., m, k) or (..., n, k), solved column by column.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.friction import signs
from robot_dynamics.newton_euler.screw import concatenate_vectors, dot, stack_matrices, stack_vectors

if TYPE_CHECKING:
    from robot_dynamics.array_types import IntArray, ScalarArray

_symbolic_root = np.frompyfunc(lambda scalar: scalar.sqrt() if hasattr(scalar, "sqrt") else np.sqrt(scalar), 1, 1)


class HouseholderFactors(NamedTuple):
    """A matrix (..., m, n), m not less than n, as H_1 ... H_n [R; 0] with a triangle R.

    H_j is 1 - scale v vᵀ on the rows from j on.

    Attributes
    ----------
    vectors : list of ndarray
        v (..., m - j), of which the first entry is 1.
    scales : list of ndarray
        (..., 1), as LAPACK's tau.
    triangle : list of ndarray
        Rows of R (..., n - j), the diagonal first.
    """

    vectors: list[ScalarArray]
    scales: list[ScalarArray]
    triangle: list[ScalarArray]


def factor_householder(matrix: ScalarArray) -> HouseholderFactors:
    """HouseholderFactors of a matrix (..., m, n)."""
    factors = HouseholderFactors([], [], [])
    for _ in range(matrix.shape[-1]):
        vector, scale, diagonal = _reflection(matrix[..., 0])
        reflected = _reflect(vector, scale, matrix[..., 1:])
        factors.vectors.append(vector)
        factors.scales.append(scale)
        factors.triangle.append(np.concatenate([diagonal, reflected[..., 0, :]], axis=-1))
        matrix = reflected[..., 1:, :]
    return factors


def _reflection(x: ScalarArray) -> tuple[ScalarArray, ScalarArray, ScalarArray]:
    """(v, scale, entry (..., 1)) of the reflection that maps x (..., r) to a vector with the first entry alone."""
    first = x[..., :1]
    if x.shape[-1] == 1:
        return np.ones(1, dtype=int), np.zeros(1, dtype=int), first
    # the sign opposite to that of x avoids cancellation; the sign of 0 is 1
    entry = -signs(signs(first) + 0.5) * _square_root(dot(x, x))
    tail = x[..., 1:] * (1 / (first - entry))
    return np.concatenate([np.ones_like(first), tail], axis=-1), 1 - first * (1 / entry), entry


def _reflect(vector: ScalarArray, scale: ScalarArray, matrix: ScalarArray) -> ScalarArray:
    """H matrix (..., r, k)."""
    row = scale[..., None] * (vector[..., None, :] @ matrix)
    reflected: ScalarArray = matrix - vector[..., None] * row
    return reflected


def _apply_reflections(factors: HouseholderFactors, matrix: ScalarArray) -> list[ScalarArray]:
    """H_n ... H_1 matrix (..., m, k): the first n of its rows, a list of (..., k)."""
    rows: list[ScalarArray] = []
    for vector, scale in zip(factors.vectors, factors.scales, strict=True):
        matrix = _reflect(vector, scale, matrix)
        rows.append(matrix[..., 0, :])
        matrix = matrix[..., 1:, :]
    return rows


def _apply_reflections_transposed(
    factors: HouseholderFactors, rows: Sequence[ScalarArray], rest: ScalarArray
) -> ScalarArray:
    """H_1 ... H_n [rows; rest] (..., m, k), for a list of n rows (..., k) and rest (..., m - n, k)."""
    for vector, scale, row in zip(*map(reversed, (factors.vectors, factors.scales, rows)), strict=True):
        rest = _reflect(vector, scale, stack_matrices([row[..., None, :], rest]))
    return rest


def _solve_triangle(factors: HouseholderFactors, right_side: ScalarArray) -> ScalarArray:
    """x (..., n, k) with the least |matrix x - right_side|."""
    x = _apply_reflections(factors, right_side)
    for j in reversed(range(len(x))):
        row = factors.triangle[j]
        known = sum(row[..., i - j, None] * x[i] for i in range(j + 1, len(x)))
        x[j] = (x[j] - known) * (1 / row[..., :1])
    return stack_vectors(x) if x else np.zeros((0, right_side.shape[-1]), dtype=int)


def _solve_triangle_transposed(factors: HouseholderFactors, right_side: ScalarArray, size: int) -> ScalarArray:
    """y (..., m, k) of least length with matrixᵀ y = right_side (..., n, k), m the size."""
    y: list[ScalarArray] = []
    for j in range(len(factors.triangle)):
        known = sum(factors.triangle[i][..., j - i, None] * y[i] for i in range(j))
        y.append((right_side[..., j, :] - known) * (1 / factors.triangle[j][..., :1]))
    zeros = np.zeros((size - len(y), right_side.shape[-1]), dtype=int)
    return _apply_reflections_transposed(factors, y, zeros)


def _complement(factors: HouseholderFactors, size: int) -> ScalarArray:
    """(..., m, m - n) orthonormal columns that are normal to those of the matrix, m the size."""
    count = size - len(factors.vectors)
    zeros = [np.zeros(count, dtype=int)] * len(factors.vectors)
    return _apply_reflections_transposed(factors, zeros, np.eye(count, dtype=int))


class Partition(NamedTuple):
    """Blocks of rows of a matrix (..., m, n), one below the other.

    Attributes
    ----------
    rows : sequence of slice
        Rows of each block.
    columns : sequence of ndarray of int
        Columns of each block that are zero in all other rows.
    border : ndarray of int
        Columns that blocks share.
    order : ndarray of int
        Index of each column in the list of `columns`, block by block, followed by `border`.
    """

    rows: Sequence[slice]
    columns: Sequence[IntArray]
    border: IntArray
    order: IntArray


def partition(rows: Sequence[slice], columns: Sequence[IntArray], size: int) -> Partition:
    """The Partition of matrices with `size` columns."""
    own = np.concatenate(columns)
    border = np.setdiff1d(np.arange(size), own)
    return Partition(rows, columns, border, np.argsort(np.concatenate([own, border])))


class Block(NamedTuple):
    """Factors of one block of rows.

    Attributes
    ----------
    own : HouseholderFactors
        Of the block's own columns.
    normal : ndarray, shape (..., rows, rows - columns)
        Orthonormal complement of these columns, empty without a border.
    shared : ndarray, shape (..., rows, border)
        Columns of the border.
    """

    own: HouseholderFactors
    normal: ScalarArray
    shared: ScalarArray

    def project_onto_complement(self, part: ScalarArray) -> ScalarArray:
        """Part of rows (..., rows, k) that is normal to the block's own columns."""
        projected: ScalarArray = np.swapaxes(self.normal, -1, -2) @ part
        return projected


class BorderedFactors(NamedTuple):
    """Factors of a matrix (..., m, n) with a Partition.

    Attributes
    ----------
    partition : Partition
    blocks : list of Block
    inner : HouseholderFactors
        Of the part of the border that is normal to the blocks' own columns.
    pivots : ndarray, shape (..., n)
        Squared length of each column's part that is normal to the columns before it: those of its block, or for the
        border those of all blocks and of the border.
    squared_norms : ndarray, shape (..., n)
        Squared length of each column. Columns depend on each other where a pivot is rounding beside it.
    """

    partition: Partition
    blocks: list[Block]
    inner: HouseholderFactors
    pivots: ScalarArray
    squared_norms: ScalarArray


def factor_bordered(matrix: ScalarArray, partition: Partition) -> BorderedFactors:
    """BorderedFactors of a matrix (..., m, n) that has this Partition."""
    blocks: list[Block] = []
    for rows, columns in zip(partition.rows, partition.columns, strict=True):
        part = matrix[..., rows, :]
        own = factor_householder(part[..., columns])
        size = part.shape[-2]
        normal = _complement(own, size) if len(partition.border) else np.zeros((size, 0), dtype=int)
        blocks.append(Block(own, normal, part[..., partition.border]))
    inner = factor_householder(stack_matrices([block.project_onto_complement(block.shared) for block in blocks]))
    triangles = [*(block.own.triangle for block in blocks), inner.triangle]
    pivots = concatenate_vectors([row[..., :1] * row[..., :1] for triangle in triangles for row in triangle])
    squared_norms: ScalarArray = (matrix * matrix).sum(axis=-2)
    return BorderedFactors(partition, blocks, inner, pivots[..., partition.order], squared_norms)


def least_squares(factors: BorderedFactors, right_side: ScalarArray) -> ScalarArray:
    """x (..., n, k) with the least |matrix x - right_side|, for right_side (..., m, k)."""
    partition, blocks, inner, _, _ = factors
    parts = [right_side[..., rows, :] for rows in partition.rows]
    complements = [block.project_onto_complement(part) for block, part in zip(blocks, parts, strict=True)]
    z = _solve_triangle(inner, stack_matrices(complements))
    own = [_solve_triangle(block.own, part - block.shared @ z) for block, part in zip(blocks, parts, strict=True)]
    return stack_matrices([*own, z])[..., partition.order, :]


def least_norm(factors: BorderedFactors, right_side: ScalarArray) -> ScalarArray:
    """y (..., m, k) of least length with matrixᵀ y = right_side (..., n, k)."""
    partition, blocks, inner, _, _ = factors
    own: list[ScalarArray] = []
    remainder = right_side[..., partition.border, :]
    for block, columns in zip(blocks, partition.columns, strict=True):
        y = _solve_triangle_transposed(block.own, right_side[..., columns, :], block.normal.shape[-2])
        own.append(y)
        remainder = remainder - np.swapaxes(block.shared, -1, -2) @ y
    ends = np.cumsum([block.normal.shape[-1] for block in blocks])
    inner_parts = np.split(_solve_triangle_transposed(inner, remainder, ends[-1]), ends[:-1], axis=-2)
    return stack_matrices([y + block.normal @ part for y, block, part in zip(own, blocks, inner_parts, strict=True)])


def _square_root(squares: ScalarArray) -> ScalarArray:
    """Square roots of numbers or symbols."""
    roots: ScalarArray = np.sqrt(squares) if np.asarray(squares).dtype != object else _symbolic_root(squares)
    return roots
