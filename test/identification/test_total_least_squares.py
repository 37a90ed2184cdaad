"""Total least squares with exact columns: against the closed form of the line with errors in both coordinates (Deming,
1943), and against a solution by minimisation."""

import numpy as np
import pytest
from scipy.optimize import minimize

from robot_dynamics.identification.total_least_squares import solve_total_least_squares


def test_a_line_with_errors_in_both_coordinates_is_that_of_deming():
    """y = a + b x; the errors of y are three times those of x, and the column of ones is exact."""
    rng = np.random.default_rng(1)
    truth = rng.uniform(0, 5, 200)
    x, y = truth + 0.4 * rng.normal(size=200), 2 + 0.7 * truth + 1.2 * rng.normal(size=200)
    relation = solve_total_least_squares(np.column_stack([x, y]), np.ones((200, 1)), np.array([0.4, 1.2]))
    b, a = -relation.noisy[0] / relation.noisy[1], -relation.known[0] / relation.noisy[1]
    (sxx, sxy), (_, syy) = np.cov(x, y)
    ratio = 1.2**2 / 0.4**2
    slope = (syy - ratio * sxx + np.sqrt((syy - ratio * sxx) ** 2 + 4 * ratio * sxy**2)) / (2 * sxy)
    assert b == pytest.approx(slope, rel=1e-10)
    assert a == pytest.approx(y.mean() - slope * x.mean(), rel=1e-9)


def test_the_ratio_of_squares_is_smallest_at_the_solution():
    rng = np.random.default_rng(2)
    noisy, known, noise = rng.normal(size=(50, 3)), rng.normal(size=(50, 4)), np.array([1.0, 0.2, 3.0])

    def ratio(z):
        return np.square(noisy @ z[:3] + known @ z[3:]).sum() / np.square(noise * z[:3]).sum()

    relation = solve_total_least_squares(noisy, known, noise)
    smallest = min(minimize(ratio, rng.normal(size=7)).fun for _ in range(5))
    assert ratio(np.concatenate(relation)) == pytest.approx(smallest, rel=1e-6)
    assert np.linalg.norm(noise * relation.noisy) == pytest.approx(1)


def test_relations_without_errors_are_exact():
    rng = np.random.default_rng(3)
    known = rng.normal(size=(40, 3))
    noisy = rng.normal(size=(40, 2))
    noisy[:, 1] = (known @ [1.0, -2.0, 0.5] - 3 * noisy[:, 0]) / 4  # 3 a + 4 b = known @ (1, -2, 0.5)
    relation = solve_total_least_squares(noisy, known, np.ones(2))
    assert np.concatenate(relation) / relation.noisy[0] * 3 == pytest.approx([3, 4, -1, 2, -0.5], abs=1e-9)
