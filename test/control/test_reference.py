"""References: splines compared with SciPy, single points, and invalid trajectories."""

import numpy as np
import pytest
from scipy.interpolate import BPoly

from robot_dynamics import InvalidInputError
from robot_dynamics.control.reference import BLOCK, ReferencePoint, ScheduledTrajectory, Trajectory

RNG = np.random.default_rng(3)


def sampled(reference, time, size):
    out = np.full((3, size), np.nan)
    reference.sample(time, out)
    return out


@pytest.mark.parametrize("order", [1, 2, 3])
@pytest.mark.parametrize("count", [12, 2 * BLOCK + 2], ids=["one block", "three blocks"])
def test_trajectory_segments_match_the_derivatives_at_their_ends(order, count):
    times = np.cumsum(RNG.uniform(0.05, 2.0, count)) + 1e3
    points = RNG.normal(size=(3, count, 4))
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


@pytest.mark.parametrize("moving", [False, True])
def test_trajectory_that_starts_later_is_reached_as_one_with_a_point_before_it(moving):
    times, points = np.array([0.5, 1.0, 2.0]), RNG.normal(size=(3, 3, 2))
    points[1:, -1] = 0
    if not moving:
        points[1:, 0] = np.nan
    present = np.where(np.isnan(points[:, 0]), np.nan, RNG.normal(size=(3, 2)))
    now, start = 10.0, 11.0
    trajectory = Trajectory(times, *points)
    lead = Trajectory.between(np.array([now, start + 0.5]), np.stack([present, trajectory.first_point], axis=1))
    scheduled = ScheduledTrajectory(trajectory, start, lead)
    whole = Trajectory([now, *start + times], *np.concatenate([present[:, None], points], axis=1))
    for time in [9.0, now, *RNG.uniform(now, start + 2.0, 200), *start + times, 20.0]:
        np.testing.assert_allclose(sampled(scheduled, time, 2), sampled(whole, time, 2), rtol=1e-9, atol=1e-9)


def test_threads_are_let_go_on_while_a_long_trajectory_is_prepared():
    pauses = []
    Trajectory(np.arange(5 * BLOCK + 1.0), np.zeros((5 * BLOCK + 1, 1)), yield_thread=lambda: pauses.append(1))
    assert len(pauses) == 4


def test_reference_point_continues_with_its_derivatives():
    point = ReferencePoint(10.0, [[1.0], [2.0], [3.0]], end=10.5)
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
