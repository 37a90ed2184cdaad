"""Impulses of dry friction fulfil their complementarity conditions, whatever joints stick."""

import numpy as np
import pytest

from robot_dynamics.simulation import friction_impulses as module
from robot_dynamics.simulation.friction_impulses import friction_impulses


def random_problem(rng, has_dependent_joints):
    """W, velocities and limits of k joints on n coordinates, with more joints than coordinates if they depend."""
    size = rng.integers(1, 8)
    count = size + rng.integers(1, 4) if has_dependent_joints else rng.integers(1, size + 1)
    shares = rng.normal(size=(size, count))
    factor = rng.normal(size=(size, size))
    W = shares.T @ np.linalg.solve(factor @ factor.T + 0.1 * np.eye(size), shares)
    velocities = shares.T @ rng.normal(size=size) * 10 ** rng.uniform(-3, 1)
    return W, velocities, -rng.uniform(0.1, 2, count), rng.uniform(0.1, 2, count)


def violation(W, velocities, lowest, highest, impulses):
    """Largest violation of: within the limits; at rest inside of them; at a limit no motion along the impulse."""
    after = velocities + W @ impulses
    is_lowest, is_highest = impulses <= lowest + 1e-9, impulses >= highest - 1e-9
    motion = np.where(is_lowest, -after, np.where(is_highest, after, np.abs(after)))
    return max(motion.max(), (impulses - highest).max(), (lowest - impulses).max())


@pytest.mark.parametrize("uses_search", [True, False])
def test_impulses_fulfil_the_conditions(uses_search, monkeypatch):
    monkeypatch.setattr(module, "MAX_SWEEPS", 20000)
    if not uses_search:
        monkeypatch.setattr(module, "MAX_EXCHANGES", 0)
    rng = np.random.default_rng(0)
    for _ in range(100 if uses_search else 10):
        W, velocities, lowest, highest = random_problem(rng, has_dependent_joints=False)
        impulses = friction_impulses(W, velocities, (lowest, highest), np.zeros(len(W)))
        assert violation(W, velocities, lowest, highest, impulses) < 1e-9


def test_search_finds_the_joints_that_stick(monkeypatch):
    """Without the iterations that follow a search, which are slow to converge."""
    monkeypatch.setattr(module, "_relax", lambda *_: pytest.fail("the search failed"))
    rng = np.random.default_rng(1)
    for _ in range(200):
        W, velocities, lowest, highest = random_problem(rng, has_dependent_joints=False)
        friction_impulses(W, velocities, (lowest, highest), np.zeros(len(W)))


def test_joints_that_depend_on_each_other_stop_as_well():
    """Their impulses are not unique, the velocities are."""
    rng = np.random.default_rng(2)
    for _ in range(30):
        W, velocities, lowest, highest = random_problem(rng, has_dependent_joints=True)
        impulses = friction_impulses(W, velocities, (50 * lowest, 50 * highest), np.zeros(len(W)), is_dependent=True)
        after = velocities + W @ impulses
        assert violation(W, velocities, 50 * lowest, 50 * highest, impulses) < 1e-6 * np.abs(velocities).max()
        assert np.abs(after).max() < np.abs(velocities).max()
