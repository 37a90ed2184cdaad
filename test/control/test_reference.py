"""References: splines between points as SciPy makes them from the same derivatives, and what is refused."""

import numpy as np
import pytest
from scipy.interpolate import BPoly

from robot_dynamics import InvalidInputError
from robot_dynamics.control.reference import ReferencePoint, Trajectory

RNG = np.random.default_rng(3)


def sampled(reference, time, size):
    out = np.full((3, size), np.nan)
    reference.sample(time, out)
    return out


@pytest.mark.parametrize("order", [1, 2, 3])
def test_segments_are_the_polynomials_of_the_derivatives_at_their_ends(order):
    times = np.cumsum(RNG.uniform(0.05, 2.0, 12)) + 1e3
    points = RNG.normal(size=(3, 12, 4))
    points[1:, -1] = 0
    made = Trajectory(times, *points[:order])
    peer = BPoly.from_derivatives(times, np.swapaxes(points[:order], 0, 1))
    for time in [*RNG.uniform(times[0], times[-1], 200), *times[:-1]]:
        expected = [peer(time, nu=derivative) for derivative in range(3)]
        np.testing.assert_allclose(sampled(made, time, 4), expected, rtol=1e-7, atol=1e-7)


def test_each_segment_takes_the_derivatives_that_both_its_ends_tell():
    times, points = np.array([0.0, 1.0, 2.0, 4.0]), RNG.normal(size=(3, 4, 2))
    points[1:, 0], points[2, 1], points[1:, -1] = np.nan, np.nan, 0
    made = Trajectory(times, *points)
    straight, cubic = sampled(made, 0.25, 2), sampled(made, 1.5, 2)
    np.testing.assert_allclose(straight[0], 0.75 * points[0, 0] + 0.25 * points[0, 1])
    np.testing.assert_allclose(straight[2], 0)
    peer = BPoly.from_derivatives(times[1:3], np.swapaxes(points[:2, 1:3], 0, 1))
    np.testing.assert_allclose(cubic[0], peer(1.5), rtol=1e-12)
    peer = BPoly.from_derivatives(times[2:], np.swapaxes(points[:, 2:], 0, 1))
    np.testing.assert_allclose(sampled(made, 3.0, 2)[2], peer(3.0, nu=2), rtol=1e-10)


def test_it_stands_at_both_ends_and_may_be_sampled_backwards():
    made = Trajectory([1.0, 2.0, 3.0], [[0.0], [1.0], [3.0]])
    np.testing.assert_array_equal(sampled(made, 0.0, 1), [[0], [0], [0]])
    np.testing.assert_array_equal(sampled(made, 9.0, 1), [[3], [0], [0]])
    np.testing.assert_allclose(sampled(made, 2.5, 1), [[2], [2], [0]])
    np.testing.assert_allclose(sampled(made, 1.5, 1), [[0.5], [1], [0]])
    one = Trajectory([1.0], [[4.0]])
    np.testing.assert_array_equal(sampled(one, 1.0, 1), [[4], [0], [0]])


def test_a_point_goes_on_as_it_moves():
    point = ReferencePoint(10.0, [[1.0], [2.0], [3.0]], lifetime=0.5)
    np.testing.assert_allclose(sampled(point, 10.2, 1), [[1 + 0.4 + 0.06], [2.6], [3]])
    assert point.end == 10.5


@pytest.mark.parametrize(
    ("times", "positions", "velocities", "said"),
    [
        ([], np.zeros((0, 2)), None, "no points"),
        ([0.0, 1.0, 1.0], np.zeros((3, 2)), None, r"points\[2\].time_from_start is not after"),
        ([0.0, 1.0], [[0, 0], [0, np.nan]], None, r"points\[1\]: finite"),
        ([0.0, 1.0], np.zeros((2, 2)), [[0, 0], [0, 0.3]], r"points\[1\].velocities\[1\] is 0.3: a trajectory ends"),
    ],
)
def test_what_is_no_trajectory_is_refused(times, positions, velocities, said):
    with pytest.raises(InvalidInputError, match=said):
        Trajectory(times, positions, velocities)
