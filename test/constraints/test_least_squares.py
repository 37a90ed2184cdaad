"""Least squares by Householder reflections of blocks agree with the pseudoinverse, for single matrices and batches."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robot_dynamics.codegen.jit.python_functions import python_function
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Trace
from robot_dynamics.constraints.least_squares import factor_bordered, least_norm, least_squares, partition


def blocks_of_random_sizes(rng):
    """(a Partition, rows, columns) with at least as many rows as columns, columns in random order."""
    count = rng.integers(1, 4)
    rows = rng.integers(1, 5, count)
    own = [int(rng.integers(0, size + 1)) for size in rows]
    border = int(rng.integers(0, rows.sum() - sum(own) + 1))
    order, ends = rng.permutation(sum(own) + border), np.cumsum([0, *rows])
    parts = np.split(order, np.cumsum(own))
    slices, columns = [slice(*ends[k : k + 2]) for k in range(count)], [np.sort(part) for part in parts[:-1]]
    return partition(slices, columns, len(order)), int(rows.sum()), len(order)


def matrices(seed, batch=(5,)):
    rng = np.random.default_rng(seed)
    blocks, rows, columns = blocks_of_random_sizes(rng)
    matrix = np.zeros((*batch, rows, columns))
    for block, own in zip(blocks.rows, blocks.columns, strict=True):
        for k in (*own, *blocks.border):
            matrix[..., block, k] = rng.normal(size=matrix[..., block, k].shape)
    if rows > 1:
        matrix[..., 0, :] *= rng.integers(0, 2)  # vectors whose first entry is zero
    return matrix, blocks, rng


@given(st.integers(0, 2**32 - 1))
def test_solutions_agree_with_the_pseudoinverse(seed):
    matrix, blocks, rng = matrices(seed)
    if matrix.shape[-1] == 0 or np.linalg.cond(matrix).max() > 1e5:
        return
    factors, inverse = factor_bordered(matrix, blocks), np.linalg.pinv(matrix)
    right, left = rng.normal(size=(5, matrix.shape[-2], 3)), rng.normal(size=(5, matrix.shape[-1], 3))
    scale = np.abs(inverse).max()
    np.testing.assert_allclose(least_squares(factors, right), inverse @ right, atol=1e-9 * scale)
    computed = least_norm(factors, left)
    np.testing.assert_allclose(computed, np.swapaxes(inverse, -1, -2) @ left, atol=1e-9 * scale)
    single = factor_bordered(matrix[2], blocks)
    np.testing.assert_allclose(least_squares(single, right[2]), least_squares(factors, right)[2], atol=1e-12 * scale)
    np.testing.assert_allclose(least_norm(single, left[2]), computed[2], atol=1e-12 * scale)


@given(st.integers(0, 2**32 - 1))
def test_pivots_are_squared_distances_of_columns_to_those_before_them(seed):
    matrix, blocks, _ = matrices(seed, batch=())
    factors = factor_bordered(matrix, blocks)
    preceding = [[*own[:k]] for own in blocks.columns for k in range(len(own))]
    columns = [k for own in blocks.columns for k in own]
    preceding += [[*columns, *blocks.border[:k]] for k in range(len(blocks.border))]
    for column, preceding_columns in zip([*columns, *blocks.border], preceding, strict=True):
        a, A = matrix[:, column], matrix[:, preceding_columns]
        rest = a - A @ (np.linalg.pinv(A) @ a) if preceding_columns else a
        assert factors.pivots[column] == pytest.approx(rest @ rest, rel=1e-6, abs=1e-9)
        assert factors.squared_norms[column] == pytest.approx(a @ a)


def test_traced_solution_agrees_and_folds_zero_blocks():
    """Two blocks of three rows with two columns each and a border of two, and one matrix of the same size, dense."""
    rng, counts = np.random.default_rng(0), []
    for rows, columns in (([3, 3], [[0, 1], [2, 3]]), ([6], [[0, 1, 2, 3, 4, 5]])):
        slices = [slice(3 * k, 3 * k + size) for k, size in enumerate(rows)]
        blocks = partition(slices, [np.array(own) for own in columns], 6)
        matrix, right = rng.normal(size=(6, 6)), rng.normal(size=6)
        for block, own in zip(slices, columns, strict=True):
            matrix[np.ix_(np.setdiff1d(np.arange(6), np.arange(6)[block]), own)] = 0
        trace = Trace()
        A, b = trace.input("A", 36).reshape(6, 6), trace.input("b", 6)
        A = np.where(matrix == 0, 0, A)
        factors = factor_bordered(A, blocks)
        x, y = least_squares(factors, b[:, None])[:, 0], least_norm(factors, b[:, None])[:, 0]
        program = build_program(trace, "solution", {"A": 36, "b": 6}, {"x": x, "y": y})
        computed = python_function(program)(matrix.ravel(), right)
        np.testing.assert_allclose(computed[0], np.linalg.solve(matrix, right), rtol=1e-9)
        np.testing.assert_allclose(computed[1], np.linalg.solve(matrix.T, right), rtol=1e-9)
        counts.append(program.operations.multiplications)
    assert counts[0] < 0.6 * counts[1]
