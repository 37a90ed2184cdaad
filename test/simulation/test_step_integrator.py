"""Order of the Runge-Kutta method, and charts of SO(3)."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robot_dynamics.simulation.rotation import SERIES_SQUARED_ANGLE, exponential, orthonormalize, rotation_vector_rate
from robot_dynamics.simulation.runge_kutta import increment


def test_runge_kutta_method_is_of_order_six():
    errors = []
    for steps in (20, 40):
        y, h = np.array([1.0, 0.0]), 2.0 / steps
        for k in range(steps):  # ẏ = y cos t, and a clock
            y = y + increment(lambda t, y: np.array([y[0] * np.cos(y[1]), 1.0]), k * h, y, h)[0]
        errors.append(abs(y[0] - np.exp(np.sin(2.0))))
    assert 5.7 < np.log2(errors[0] / errors[1]) < 6.6


def test_error_estimate_is_that_of_an_embedded_method_of_order_four():
    estimates = []
    for h in (0.1, 0.05):
        _, error = increment(lambda t, y: np.array([y[1], -9.0 * np.sin(y[0]), 1.0]), 0.0, np.array([1.0, 0.3, 0.0]), h)
        estimates.append(np.abs(error[:2]).max())
        assert error[2] == pytest.approx(0, abs=1e-16)  # a clock is exact
    assert 4.5 < np.log2(estimates[0] / estimates[1]) < 5.6  # the error of one step is of order h⁵


def test_rotation_vectors_that_are_too_large_give_nan():
    for phi in ([np.inf, 0, 0], [np.nan, 0, 0], [1e200, 0, 0]):
        assert np.isnan(exponential(np.array(phi))).all()
        assert np.isnan(rotation_vector_rate(np.array(phi), np.ones(3))).all()


def test_derivative_gets_the_time_of_each_stage():
    change, _ = increment(lambda t, y: np.array([6 * t**5]), 1.0, np.zeros(1), 0.5)
    assert change[0] == pytest.approx(1.5**6 - 1, rel=1e-14)


@pytest.mark.parametrize(
    "angle", [0.0, 1e-9, 0.01, np.sqrt(SERIES_SQUARED_ANGLE) * 0.999, np.sqrt(SERIES_SQUARED_ANGLE) * 1.001, 1.0, 3.0]
)
def test_rotation_vectors_are_those_of_scipy(angle):
    rng = np.random.default_rng(3)
    phi = rng.normal(size=3)
    phi *= angle / np.linalg.norm(phi)
    R = exponential(phi)
    np.testing.assert_allclose(R, Rotation.from_rotvec(phi).as_matrix(), atol=2e-15)
    omega, h = rng.normal(size=3), 1e-4
    before, after = ((Rotation.from_matrix(R) * Rotation.from_rotvec(sign * h * omega)).as_rotvec() for sign in (-1, 1))
    np.testing.assert_allclose(rotation_vector_rate(phi, omega), (after - before) / (2 * h), atol=3e-7)


def test_series_and_closed_forms_of_rotations_agree():
    phi = np.array([0.1, -0.15, np.sqrt(SERIES_SQUARED_ANGLE - 0.0325)])
    omega = np.array([1.0, -2.0, 0.5])
    below, above = (rotation_vector_rate(phi * share, omega) for share in (1 - 1e-12, 1 + 1e-12))
    np.testing.assert_allclose(below, above, atol=1e-11, rtol=0)
    np.testing.assert_allclose(exponential(phi * (1 - 1e-12)), exponential(phi * (1 + 1e-12)), atol=1e-12)


def test_orthonormalize_removes_rounding():
    R = Rotation.from_rotvec([0.3, -1.0, 2.0]).as_matrix()
    rounded = R + 1e-8 * np.random.default_rng(0).normal(size=(3, 3))
    orthonormal = orthonormalize(rounded)
    assert np.abs(orthonormal @ orthonormal.T - np.eye(3)).max() < 1e-15
    assert np.abs(orthonormal - R).max() < 5e-8
