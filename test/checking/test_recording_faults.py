"""Faults of a recording itself are named and dated: encoders that jump, columns that are swapped, missing rows."""

import json

import numpy as np
import pytest
from peers.recorded import panda_motion

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.checking.check import Predictor
from robot_dynamics.checking.faults import Evidence
from robot_dynamics.recordings.alignment import resample_samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import filter_motions
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.sample_statistics import SampleStatistics

RATE = 100.0
DURATION = 25.0


@pytest.fixture(scope="module")
def predictor():
    dynamics = Dynamics(load_robot("panda"))
    return Predictor(dynamics, direct_drives(dynamics.joint_names))


@pytest.fixture
def samples(predictor):
    """Samples of a sound recording: times, positions, velocities, efforts with noise; stamps jitter a little."""
    motion = panda_motion(duration=DURATION, rate=RATE, seed=1)
    rng = np.random.default_rng(0)
    times = motion.times + rng.uniform(-2e-4, 2e-4, len(motion.times))
    return times, motion.q, motion.qd, motion.efforts + 0.1 * rng.normal(size=motion.efforts.shape)


def find_fault(predictor, times, q, qd, efforts):
    drives = predictor.drives
    stamps = np.round(1e9 * (times + 1)).astype(np.int64)
    rows = zip(stamps.tolist(), q, qd, efforts, strict=True)
    messages = [JointSample("/joint_states", stamp, stamp, drives.names, *signals) for stamp, *signals in rows]
    statistics = SampleStatistics()
    evidence = Evidence(predictor)
    for motion in filter_motions(resample_samples(messages, drives.names, statistics), drives, statistics):
        evidence.add(motion, predictor(motion))
    return evidence.find_fault()


def test_sound_recording_has_no_fault(predictor, samples):
    assert find_fault(predictor, *samples) is None


def test_encoder_that_jumps_is_named(predictor, samples):
    """0.05 rad in the last joint, whose offset no effort shows."""
    times, q, qd, efforts = samples
    q = q.copy()
    q[times > 13, 6] += 0.05
    fault = find_fault(predictor, times, q, qd, efforts)
    assert (fault.kind, fault.joints) == ("offset", ("panda_joint7",))
    assert fault.onset == pytest.approx(13.0, abs=0.05) and fault.between[0] <= 13.0 <= fault.between[1]
    assert json.loads(json.dumps(vars(fault), allow_nan=False))["gain"] is None  # JSON has no infinite numbers


@pytest.mark.parametrize("part", [0.1, 0.3])
def test_rows_that_are_missing_at_random_are_named(predictor, samples, part):
    times = samples[0]
    kept = (times < 11) | (np.random.default_rng(3).random(len(times)) > part)
    fault = find_fault(predictor, *(signal[kept] for signal in samples))
    assert fault.kind == "missing" and fault.joints == ()
    assert fault.onset == pytest.approx(11.0, abs=0.5) and fault.between[0] <= 11.0 <= fault.between[1]


@pytest.mark.parametrize("shows_gap", [True, False])
def test_rows_that_are_missing_at_one_time_are_named(predictor, samples, shows_gap):
    """0.3 s are cut out; stamps show the gap, or go on as if there were none."""
    times, *signals = samples
    kept = (times < 9) | (times > 9.3)
    later = times[kept] - (0 if shows_gap else 0.3) * (times[kept] > 9)
    fault = find_fault(predictor, later, *(signal[kept] for signal in signals))
    assert fault.kind == "missing" and fault.onset == pytest.approx(9.0, abs=0.2)


@pytest.mark.parametrize("onset", [0.0, 12.0])
@pytest.mark.parametrize("pair", [(0, 1), (2, 6), (4, 5)])
def test_joints_whose_columns_are_swapped_are_named(predictor, samples, pair, onset):
    times, *signals = samples
    after = times >= onset
    for signal in signals:
        signal[np.ix_(after, pair)] = signal[np.ix_(after, pair[::-1])]
    fault = find_fault(predictor, times, *signals)
    assert (fault.kind, fault.joints) == ("swapped", tuple(predictor.drives.names[joint] for joint in pair))
    assert fault.onset == pytest.approx(onset, abs=0.3)
    assert ("from the start" in fault.sentence) == (onset == 0)


def test_efforts_that_are_swapped_from_the_start_are_named_so(predictor, samples):
    times, q, qd, efforts = samples
    efforts[:, [1, 3]] = efforts[:, [3, 1]]
    fault = find_fault(predictor, times, q, qd, efforts)
    assert (fault.kind, fault.joints) == ("swapped", ("panda_joint2", "panda_joint4"))
    assert fault.sentence.startswith("efforts of") and "from the start" in fault.sentence
    assert fault.between[0] <= fault.onset < 1


def test_load_from_the_start_is_an_error_of_the_model(predictor, samples):
    times, q, qd, efforts = samples
    robot = predictor.dynamics.robot.with_payload("panda_link8", Inertia(2.0))
    qdd = np.gradient(qd, times, axis=0)
    loaded = Dynamics(robot).inverse(q, qd, qdd) - predictor.dynamics.inverse(q, qd, qdd)
    assert find_fault(predictor, times, q, qd, efforts + loaded) is None


def test_friction_that_falls_slowly_is_no_fault(predictor, samples):
    """A joint that warms up: its friction falls by 3 N m in 25 s."""
    times, q, qd, efforts = samples
    efforts[:, 3] -= 3 * times / DURATION * np.sign(qd[:, 3])
    assert find_fault(predictor, times, q, qd, efforts) is None
