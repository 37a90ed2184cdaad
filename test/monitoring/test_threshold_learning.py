"""Thresholds from random residuals whose false alarms are counted, and from residuals near standstill."""

from dataclasses import replace

import numpy as np
import pytest

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import RecordingError
from robot_dynamics.monitoring.collision_detector import CollisionDetector
from robot_dynamics.monitoring.collision_thresholds import STICTION_RATIO, CollisionThresholds, dry_friction
from robot_dynamics.monitoring.contact_observer import Observation
from robot_dynamics.monitoring.threshold_learning import MARGIN, LargestRatios, ThresholdLearner

K = 50.0
STEP = 0.02  # [s] a time constant of the observer
SCALES = np.array([3.0, 2.0, 1.0, 1.0, 0.5, 0.2])
FAST = np.ones(6)
NAMES = tuple(f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))


class Source:
    """Observations with given residuals, and the detector that judges them, as those of a ContactObserver."""

    def __init__(self, thresholds):
        self.detector = CollisionDetector(thresholds)
        self.stamp = 0
        self.decay = np.full(6, np.exp(-K * STEP))

    def observation(self, residuals, velocities=FAST):
        self.stamp += round(STEP * 1e9)
        begins = self.detector.update(self.stamp, STEP, residuals, velocities, self.decay)
        return Observation(self.stamp, residuals, np.zeros(0), True, self.detector.is_collision, begins)


def undecided():
    return CollisionThresholds(NAMES, np.full(6, np.inf), np.zeros(6), K)


def filtered_noise(count, seed):
    """Gaussian noise (count, 6) that the filter of the observer has coloured."""
    white = np.random.default_rng(seed).normal(size=(count, 6))
    decay = np.exp(-K * STEP)
    rows = [np.zeros(6)]
    for row in white:
        rows.append(decay * rows[-1] + np.sqrt(1 - decay**2) * row)
    return SCALES * np.array(rows[1:])


@pytest.fixture(scope="module")
def dynamics():
    return Dynamics(load_robot("ur5e"), compiled=False)


def learn(dynamics, residuals, interval, velocities=None):
    source = Source(undecided())
    learner = ThresholdLearner(dynamics, undecided())
    for k, row in enumerate(residuals):
        velocity = np.ones(6) if velocities is None else velocities[k]
        learner.add(source, source.observation(row, velocity))
    return learner.learn(interval)


def test_false_alarms_are_about_as_rare_as_stated(dynamics):
    """Learnt from 100 s for one in 60 s, and judged for 40 minutes: noise has lighter tails than Gumbel's."""
    residuals = filtered_noise(5000, 0)
    learnt = learn(dynamics, residuals, 60.0)
    assert learnt.duration == pytest.approx(100.0, abs=0.5) and (learnt.blocks > 400).all()
    assert learnt.rms == pytest.approx(SCALES, rel=0.1)
    source = Source(learnt.thresholds)
    source.detector.release_time = 0.0
    alarms = sum(source.observation(row).begins for row in filtered_noise(120_000, 1))
    assert 0 < alarms < 80  # 40 are stated
    rarer = learn(dynamics, residuals, 36_000.0).thresholds.moving
    assert (rarer > 1.2 * learnt.thresholds.moving).all() and (rarer < 3 * learnt.thresholds.moving).all()
    assert (rarer >= MARGIN * learnt.largest).all()


def test_thresholds_near_standstill_cover_what_was_seen_there(dynamics):
    residuals = filtered_noise(4000, 2)
    velocities = np.ones((4000, 6))
    velocities[1000:1500] = 0.01
    residuals[1100:1400, 2] = 12.0  # friction that holds the elbow
    learnt = learn(dynamics, residuals, 3600.0, velocities)
    moving, slow = learnt.thresholds.moving, learnt.thresholds.slow
    assert moving[2] < 8.0 and moving[2] + slow[2] >= MARGIN * 12.0
    assert slow[0] < 3.0
    judged = Source(learnt.thresholds)
    ratios = LargestRatios(6)
    for row, velocity in zip(residuals, velocities, strict=True):
        ratios.add(judged, judged.observation(row, velocity))
    assert not judged.detector.is_collision and judged.detector.event is None
    assert (ratios.largest < 1).all() and ratios.largest[2] > 0.7 and ratios.duration == pytest.approx(80, abs=0.1)


def test_dry_friction_is_the_least_allowance_near_standstill():
    robot = load_robot("ur5e")
    dynamics = Dynamics(
        replace(robot, joints=tuple(replace(joint, coulomb_friction=4.0) for joint in robot.joints)), compiled=False
    )
    learnt = learn(dynamics, filtered_noise(2000, 3), 3600.0)
    assert learnt.thresholds.slow == pytest.approx(STICTION_RATIO * dry_friction(dynamics))


def test_too_little_motion_is_refused_by_joint(dynamics):
    velocities = np.ones((1000, 6))
    velocities[100:, 4] = 0.0
    with pytest.raises(RecordingError, match=r"'wrist_2_joint' moves for 1.8 s in the recordings: 4 s or more"):
        learn(dynamics, filtered_noise(1000, 4), 3600.0, velocities)
