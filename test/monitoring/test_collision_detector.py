"""The decision: thresholds, hysteresis, standstill, and what a collision says of itself."""

import numpy as np
import pytest

from robot_dynamics.monitoring.collision_detector import CollisionDetector
from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds

STEP = 0.01
K = 50.0
DECAY = np.full(2, np.exp(-K * STEP))
FAST = np.full(2, 1.0)


def detector(**options):
    thresholds = CollisionThresholds(("shoulder", "wrist"), np.array([5.0, 1.0]), np.array([10.0, 2.0]), K)
    made = CollisionDetector(thresholds, **options)
    feed(made, [[0.0, 0.0]] * 50)  # no longer near standstill
    return made


def feed(decision, efforts, velocities=FAST):
    """Whether collisions begin, and whether there is one, at each sample."""
    rows = [
        (decision.update(k * 10_000_000, STEP, np.array(row, dtype=float), velocities, DECAY), decision.is_collision)
        for k, row in enumerate(efforts)
    ]
    return [begins for begins, _ in rows], [collides for _, collides in rows]


def test_a_collision_begins_once_and_ends_after_the_release_time():
    decision = detector(release_ratio=0.5, release_time=0.03)
    low, between, high = [2.4, 0.4], [3.0, 0.4], [-5.1, 0.4]
    begins, collides = feed(decision, [low, between, high, high, between, low, low, between, low, low, low, low])
    assert begins == [False, False, True, *[False] * 9]
    assert collides == [False, False, *[True] * 8, False, False]  # `between` begins the time of release anew
    event = decision.event
    assert (event.joint, event.effort, event.threshold) == ("shoulder", -5.1, pytest.approx(5.0, abs=1e-6))
    assert event.stamp == 20_000_000 and "external effort -5.1 of 'shoulder' is beyond 5" in str(event)


def test_the_joint_that_exceeds_its_own_threshold_most_is_named():
    decision = detector()
    feed(decision, [[6.0, 1.9]])
    assert decision.event.joint == "wrist"


def test_thresholds_near_standstill_pass_the_filter_of_the_observer():
    decision = detector()
    slow = np.array([0.01, 1.0])
    bounds = []
    for _ in range(3):
        feed(decision, [[0.0, 0.0]], slow)
        bounds.append(decision.bounds.copy())
    assert np.array(bounds)[:, 0] == pytest.approx(5 + 10 * (1 - np.exp(-K * STEP * np.arange(1, 4))))
    assert np.array(bounds)[:, 1] == pytest.approx(1.0, abs=1e-6)
    assert feed(decision, [[8.0, 0.0]], slow)[1] == [False]  # friction that holds
    assert feed(decision, [[8.0, 0.0]] * 100)[1][-1]  # a contact, when it moves


def test_clear_and_continue():
    decision = detector()
    feed(decision, [[9.0, 0.0]])
    other = detector()
    other.continue_from(decision)
    assert other.is_collision and other.event is decision.event
    other.clear()
    assert not other.is_collision and decision.is_collision
    decision.restart()
    assert decision.is_collision  # it lasts until efforts are low


def test_joints_without_threshold_decide_nothing():
    thresholds = CollisionThresholds(("shoulder", "wrist"), np.array([np.inf, 1.0]), np.zeros(2), K)
    decision = CollisionDetector(thresholds)
    assert not feed(decision, [[1e9, 0.0]])[1][0]
