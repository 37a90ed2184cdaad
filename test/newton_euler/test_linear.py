"""Factorization without pivoting agrees with LAPACK on positive definite systems and detects indefinite ones."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robot_dynamics.newton_euler import linear


@given(st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_solution_of_positive_definite_systems(size, seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(4, size, size))
    matrix = root @ np.swapaxes(root, -1, -2) + 0.1 * np.eye(size)
    right = rng.normal(size=(4, size))
    factors = linear.factor(matrix)
    assert all((pivot > 0).all() for pivot in factors[1])
    expected = np.linalg.solve(matrix, right[..., None])[..., 0]
    np.testing.assert_allclose(linear.solve(factors, right), expected, rtol=1e-8, atol=1e-8)


@given(st.integers(2, 6), st.integers(0, 2**32 - 1))
def test_indefinite_matrix_has_a_pivot_that_is_not_positive(size, seed):
    rng = np.random.default_rng(seed)
    turn = np.linalg.qr(rng.normal(size=(size, size)))[0]
    matrix = turn @ np.diag([-1.0, *rng.uniform(0.1, 2, size - 1)]) @ turn.T
    assert min(linear.factor(matrix)[1]) <= 0


@given(st.integers(1, 6), st.integers(0, 2**32 - 1))
def test_batches_of_general_systems(size, seed):
    """Also where the matrix has more batch axes than the right side, or fewer, and where a batch is as long as m."""
    rng = np.random.default_rng(seed)
    for of_matrix, of_right in (
        ((), ()),
        ((size,), ()),
        ((3,), ()),
        ((), (size,)),
        ((2, size), (size,)),
        ((3, 1), (4,)),
    ):
        matrix = rng.normal(size=(*of_matrix, size, size)) + 4 * size * np.eye(size)
        right = rng.normal(size=(*of_right, size))
        x = linear.solve_each(matrix, right)
        assert x.shape == (*np.broadcast_shapes(of_matrix, of_right), size)
        np.testing.assert_allclose(
            np.einsum("...ij,...j->...i", matrix, x), np.broadcast_to(right, x.shape), atol=1e-12
        )
