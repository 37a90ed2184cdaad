"""Continuation from a previous sample and its velocities keeps the branch where assembly modes meet."""

import numpy as np
import pytest
from peers.four_bar import FourBar
from peers.planar_lagrange import PlanarBody

from robot_dynamics import Dynamics, InvalidInputError, load_robot
from robot_dynamics.errors import SingularModelError

PARALLEL = np.array([1.0, -1.0, 1.0, 1.0])  # crank, coupler, rocker, cut joint of a parallelogram


@pytest.fixture(scope="module")
def parallelogram():
    bar = PlanarBody(1.0, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3))
    return Dynamics(FourBar(0.2, 0.4, 0.2, 0.4, (bar,) * 3).robot(1.0))


def test_continuation_with_velocities_keeps_the_branch(parallelogram):
    seeded = continued = parallelogram.expand_positions([1.0])
    has_left_branch, step = False, 0.0222
    for k in range(1, 500):
        q = 1.0 + k * step
        continued = parallelogram.expand_positions([q], previous=continued, velocities=6.0 * PARALLEL)
        np.testing.assert_allclose(continued, q * PARALLEL, atol=1e-8)
        seed = seeded.copy()
        seed[0] = q
        seeded = parallelogram.expand_positions(seed)
        has_left_branch = has_left_branch or np.abs(seeded - q * PARALLEL).max() > 0.01
    assert has_left_branch  # closing each sample from the last one alone changes the mode


def test_continuation_of_batches_across_singular_positions(parallelogram):
    previous = parallelogram.expand_positions([3.0])
    q = np.array([[3.1], [3.2], [4.0]])
    continued_batch = parallelogram.expand_positions(
        q, previous=previous, velocities=-2.0 * PARALLEL
    )  # backwards is a direction too
    np.testing.assert_allclose(continued_batch, q * PARALLEL, atol=1e-8)
    continued_batch = parallelogram.expand_positions(q, previous=np.tile(previous, (3, 1)))
    np.testing.assert_allclose(continued_batch, q * PARALLEL, atol=1e-8)


def test_continuation_beyond_the_end_of_a_branch_is_refused():
    bar = PlanarBody(1.0, np.array([0.1, 0.0, 0.0]), 0.01 * np.eye(3))
    swinging = Dynamics(FourBar(0.4, 0.5, 0.15, 0.45, (bar,) * 3).robot(1.0))  # the crank swings
    previous = swinging.expand_positions([1.0])
    with pytest.raises(SingularModelError):
        swinging.expand_positions([3.0], previous=previous)


def test_continuation_with_invalid_arguments_is_refused(parallelogram):
    with pytest.raises(InvalidInputError, match="give previous too"):
        parallelogram.expand_positions([1.0], velocities=PARALLEL)
    with pytest.raises(InvalidInputError, match="previous"):
        parallelogram.expand_positions([1.0], previous=[1.0])
    with pytest.raises(InvalidInputError, match="velocities"):
        parallelogram.expand_positions([1.0], previous=PARALLEL, velocities=[np.nan] * 4)


def test_continuation_accepts_robots_without_loops():
    dynamics = Dynamics(load_robot("ur5e"))
    np.testing.assert_array_equal(dynamics.expand_positions(np.ones(6), previous=np.zeros(6)), np.ones(6))
