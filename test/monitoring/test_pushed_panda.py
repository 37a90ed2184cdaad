"""A Panda in MuJoCo with friction and noise, identified from one run: pushes of 10 N, and fast motion without any.

MONITORED_MINUTES sets the length of the motion without pushes, and MONITORED_PUSHES their number; `make soak` has ten
minutes and a hundred pushes."""

import os

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="mujoco is not installed")
pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")

from peers.pushed_panda import run
from peers.recorded import Motion, write_table

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds
from robot_dynamics.monitoring.contact_observer import ContactObserver
from robot_dynamics.monitoring.frame_wrench import WrenchEstimator
from robot_dynamics.monitoring.momentum_balance import MomentumBalance
from robot_dynamics.monitoring.threshold_learning import ThresholdLearner
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

MINUTES = float(os.environ.get("MONITORED_MINUTES", "0.25"))
PUSHES = int(os.environ.get("MONITORED_PUSHES", "15"))
BANDWIDTH = 50.0
FORCE = 10.0  # [N]
PERIOD, DURATION = 0.8, 0.4  # [s] of the pushes
SETTLED = 0.15  # [s] after which a push is measured
FIRST = 1.0  # [s] of the first push


@pytest.fixture(scope="module")
def balance(tmp_path_factory):
    """The balance of the robot that is identified from a run of 30 s."""
    states = list(run(30.0, seed=1))[::8]
    signals = [np.array(values) for values in zip(*((s.time, s.q, s.qd, s.efforts) for s in states), strict=True)]
    times, q, qd, efforts = signals
    path = write_table(tmp_path_factory.mktemp("runs") / "run.csv", Motion(times, q, qd, qd, efforts))
    dynamics = Dynamics(load_robot("panda"))
    recording = open_recording(path, direct_drives(dynamics.joint_names))
    model = build_identification_model(dynamics, recording.drives)
    consistent = fit_consistent_robot(fit_parameters(Samples([recording], model, cutoff=12.0)))
    return MomentumBalance(Dynamics(consistent.robot), consistent.drives)


def observe(observer, states):
    """Yield each state with its observation, by the code of the node."""
    balance = observer.balance
    for state in states:
        balance.position[:], balance.velocity[:], balance.effort[:] = state.q, state.qd, state.efforts
        yield state, observer.update(round(state.time * 1e9))


@pytest.fixture(scope="module")
def thresholds(balance):
    """Learnt from another run of 30 s, for one false alarm in 8 hours."""
    names = balance.dynamics.joint_names
    observer = ContactObserver(balance, CollisionThresholds(names, np.full(7, np.inf), np.zeros(7), BANDWIDTH))
    learner = ThresholdLearner(balance.dynamics, observer.detector.thresholds)
    for _, observation in observe(observer, run(30.0, seed=2)):
        learner.add(observer, observation)
    return learner.learn(8 * 3600.0).thresholds


def test_fast_motion_without_contact_has_no_collision(balance, thresholds):
    observer = ContactObserver(balance, thresholds)
    fastest, largest = np.zeros(7), np.zeros(7)
    for state, observation in observe(observer, run(60 * MINUTES, seed=3)):
        fastest = np.maximum(fastest, np.abs(state.qd))
        largest = np.maximum(largest, np.abs(observation.efforts) / observer.detector.bounds)
        assert not observation.begins, observer.detector.event
    assert (fastest > 1.0).all() and (largest > 0.3).all()  # it moves, and the thresholds are no walls


def test_pushes_of_ten_newtons_are_detected_within_twenty_milliseconds(balance, thresholds):
    """In random directions, at the flange, during fast motion; the force is within 10 % in the mean of each push."""
    directions = np.random.default_rng(5).normal(size=(PUSHES, 3))
    directions /= np.linalg.norm(directions, axis=1)[:, None]

    def push(t):
        number, phase = divmod(t - FIRST, PERIOD)
        return FORCE * directions[int(number)] if 0 <= number < PUSHES and phase < DURATION else None

    observer = ContactObserver(balance, thresholds)
    kinds = {kind: WrenchEstimator(balance.dynamics, "panda_link8", kind, thresholds.moving) for kind in
             ("force", "wrench")}  # fmt: skip
    flange = balance.dynamics.frame("panda_link8")
    delays, forces, false_alarms = {}, {}, 0
    for state, observation in observe(observer, run(FIRST + PUSHES * PERIOD, seed=4, push=push)):
        number, phase = divmod(state.time - FIRST, PERIOD)
        if not state.force.any():
            false_alarms += observation.begins
            continue
        assert np.array_equal(state.force, FORCE * directions[int(number)])
        if observation.is_collision:
            delays.setdefault(number, phase)
        if phase > SETTLED:
            R = flange.pose(balance.program_positions)[:3, :3]
            for kind, estimator in kinds.items():
                wrench = estimator.estimate(balance.program_positions, observation.efforts).wrench
                forces.setdefault((kind, number), []).append(R @ wrench[:3])
    assert len(delays) == PUSHES and false_alarms == 0
    assert max(delays.values()) <= 0.020
    errors = {kind: [np.linalg.norm(np.mean(rows, axis=0) - FORCE * directions[int(number)]) / FORCE
                     for (of, number), rows in forces.items() if of == kind] for kind in kinds}  # fmt: skip
    assert all(len(values) == PUSHES and max(values) < 0.1 for values in errors.values()), errors
