"""References: splines compared with SciPy, single points, and invalid trajectories."""

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
def test_trajectory_segments_match_the_derivatives_at_their_ends(order):
    times = np.cumsum(RNG.uniform(0.05, 2.0, 12)) + 1e3
    points = RNG.normal(size=(3, 12, 4))
    points[1:, -1] = 0
    trajectory = Trajectory(times, *points[:order])
    peer = BPoly.from_derivatives(times, np.swapaxes(points[:order], 0, 1))
    for time in [*RNG.uniform(times[0], times[-1], 200), *times[:-1]]:
        expected = [peer(time, nu=derivative) for derivative in range(3)]
        np.testing.assert_allclose(sampled(trajectory, time, 4), expected, rtol=1e-7, atol=1e-7)


def test_trajectory_segments_use_the_derivatives_that_both_ends_specify():
    times, points = np.array([0.0, 1.0, 2.0, 4.0]), RNG.normal(size=(3, 4, 2))
    points[1:, 0], points[2, 1], points[1:, -1] = np.nan, np.nan, 0
    trajectory = Trajectory(times, *points)
    straight, cubic = sampled(trajectory, 0.25, 2), sampled(trajectory, 1.5, 2)
    np.testing.assert_allclose(straight[0], 0.75 * points[0, 0] + 0.25 * points[0, 1])
    np.testing.assert_allclose(straight[2], 0)
    peer = BPoly.from_derivatives(times[1:3], np.swapaxes(points[:2, 1:3], 0, 1))
    np.testing.assert_allclose(cubic[0], peer(1.5), rtol=1e-12)
    peer = BPoly.from_derivatives(times[2:], np.swapaxes(points[:, 2:], 0, 1))
    np.testing.assert_allclose(sampled(trajectory, 3.0, 2)[2], peer(3.0, nu=2), rtol=1e-10)


def test_trajectory_rests_at_both_ends_and_can_be_sampled_backwards():
    trajectory = Trajectory([1.0, 2.0, 3.0], [[0.0], [1.0], [3.0]])
    np.testing.assert_array_equal(sampled(trajectory, 0.0, 1), [[0], [0], [0]])
    np.testing.assert_array_equal(sampled(trajectory, 9.0, 1), [[3], [0], [0]])
    np.testing.assert_allclose(sampled(trajectory, 2.5, 1), [[2], [2], [0]])
    np.testing.assert_allclose(sampled(trajectory, 1.5, 1), [[0.5], [1], [0]])
    single = Trajectory([1.0], [[4.0]])
    np.testing.assert_array_equal(sampled(single, 1.0, 1), [[4], [0], [0]])


def test_reference_point_continues_with_its_derivatives():
    point = ReferencePoint(10.0, [[1.0], [2.0], [3.0]], lifetime=0.5)
    np.testing.assert_allclose(sampled(point, 10.2, 1), [[1 + 0.4 + 0.06], [2.6], [3]])
    assert point.end == 10.5


@pytest.mark.parametrize(
    ("times", "positions", "velocities", "message"),
    [
        ([], np.zeros((0, 2)), None, "no points"),
        ([0.0, 1.0, 1.0], np.zeros((3, 2)), None, r"points\[2\].time_from_start is not after"),
        ([0.0, 1.0], [[0, 0], [0, np.nan]], None, r"points\[1\]: finite"),
        ([0.0, 1.0], np.zeros((2, 2)), [[0, 0], [0, 0.3]], r"points\[1\].velocities\[1\] is 0.3: a trajectory ends"),
    ],
)
def test_invalid_trajectories_are_refused(times, positions, velocities, message):
    with pytest.raises(InvalidInputError, match=message):
        Trajectory(times, positions, velocities)
