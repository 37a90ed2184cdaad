"""Three ways to the same angular motion: of vectors, from the column of the joint axis, and in permuted axes."""

from itertools import permutations, product

import numpy as np
import pytest

from robot_dynamics.newton_euler.angular_motion import (
    angular_motion,
    angular_motion_from_axis,
    permuted_angular_motion,
)

SAMPLES = 5
PERMUTED_AXES = [
    R
    for order in permutations(range(3))
    for signs in product((1, -1), repeat=3)
    if np.linalg.det(R := np.eye(3)[:, order] * signs) > 0
]


def skew(vector):
    x, y, z = vector
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])


def assert_same(motion, expected):
    for name in ("omega", "angular_acceleration", "xy", "xz", "yz"):
        assert np.allclose(getattr(motion, name), getattr(expected, name), atol=1e-13), name
    assert np.allclose(motion.differences, expected.differences, atol=1e-13)
    assert np.allclose(np.array(motion.B), np.array(expected.B), atol=1e-13)


def random_vectors():
    return np.random.default_rng(1).uniform(-2, 2, (2, SAMPLES, 3))


def test_B_is_the_derivative_of_the_velocities_of_points():
    omega, acceleration = random_vectors()
    motion = angular_motion(omega, acceleration)
    for sample in range(SAMPLES):
        expected = skew(acceleration[sample]) + skew(omega[sample]) @ skew(omega[sample])
        assert np.allclose(np.array(motion.B)[..., sample], expected)


@pytest.mark.parametrize("reads_difference", [True, False])
def test_the_column_of_the_axis_gives_the_whole_motion(reads_difference):
    omega, acceleration = random_vectors()
    expected = angular_motion(omega, acceleration)
    column = expected.times(np.array([0, 0, 1]))
    motion = angular_motion_from_axis(omega, column, acceleration[:, 2], reads_difference)
    assert_same(motion, expected)


@pytest.mark.parametrize("R", PERMUTED_AXES)
def test_motion_in_permuted_axes(R):
    omega, acceleration = random_vectors()
    permuted = permuted_angular_motion(R, angular_motion(omega, acceleration))
    assert_same(permuted, angular_motion(omega @ R, acceleration @ R))
