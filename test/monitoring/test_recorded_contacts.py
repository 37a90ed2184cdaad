"""Recordings through the observer: known motions and contacts, and sound recordings of real robots without a collision.

The UR10 and the Panda are recordings of unisa-acg/inverse-dynamics-solver (BSD-3), beside the checkout."""

from itertools import pairwise

import numpy as np
import pinocchio as pin
import pytest
from peers.recorded import REAL_DATA, Motion, messages, panda_model, panda_motion, write_bag, write_table

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds
from robot_dynamics.monitoring.contact_observer import ContactObserver
from robot_dynamics.monitoring.momentum_balance import MomentumBalance
from robot_dynamics.monitoring.recorded_contacts import observe_recording
from robot_dynamics.monitoring.threshold_learning import ThresholdLearner
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.sample_range import SampleRange

WRENCH = np.array([0.0, 0.0, -30.0, 0.0, 0.0, 0.0])
LENGTH = 6.0  # [s]


def undecided(names, bandwidth):
    return CollisionThresholds(names, np.full(len(names), np.inf), np.zeros(len(names)), bandwidth)


def pushed_motion():
    """A motion of a Panda at 100 Hz, with a force on the flange from 3 to 4 s; the external torques (N, 7) too."""
    motion = panda_motion(LENGTH, 100.0)
    model = panda_model()
    data, frame = model.createData(), model.getFrameId("panda_link8")
    external = np.zeros((len(motion.times), 7))
    for k in np.flatnonzero((motion.times >= 3) & (motion.times < 4)):
        external[k] = pin.computeFrameJacobian(model, data, motion.q[k], frame, pin.LOCAL_WORLD_ALIGNED).T @ WRENCH
    return motion._replace(efforts=motion.efforts - external), external


@pytest.fixture(scope="module")
def observer():
    dynamics = Dynamics(load_robot("panda"))
    return ContactObserver(MomentumBalance(dynamics), undecided(dynamics.joint_names, 20.0))


def observed(observer, path, **options):
    recording = open_recording(path, direct_drives(observer.balance.dynamics.joint_names))
    observations = list(observe_recording(recording, observer, **options))
    return np.array([o.stamp * 1e-9 for o in observations]), np.array([o.efforts for o in observations])


@pytest.mark.parametrize("kind", ["bag", "table"])
def test_recorded_push_is_observed_with_the_time_constant(observer, tmp_path, kind):
    motion, external = pushed_motion()
    write = {"bag": lambda: write_bag(tmp_path / "run", messages(motion)),
             "table": lambda: write_table(tmp_path / "run.csv", motion)}[kind]  # fmt: skip
    times, efforts = observed(observer, write())
    assert len(times) == len(motion.times) and times == pytest.approx(motion.times - motion.times[0], abs=1e-6)
    filtered, mean = [np.zeros(7)], np.zeros(7)
    for before, after in pairwise(external):
        now = 0.5 * (before + after)
        mean = now + np.exp(-20 * 0.01) * (mean - now)
        filtered.append(mean)
    assert np.abs(efforts - filtered).max() < 0.02 * np.abs(external).max()


def test_velocities_that_were_not_measured_are_derivatives(observer, tmp_path):
    motion, external = pushed_motion()
    rows = messages(motion._replace(qd=np.zeros((len(motion.times), 0))))
    times, efforts = observed(observer, write_bag(tmp_path / "run", rows), cutoff=20.0)
    inside = (times > 3.3) & (times < 4.0)
    assert np.abs(efforts[inside] - external[inside]).max() < 0.1 * np.abs(external).max()
    assert np.abs(efforts[(times > 0.5) & (times < 2.9)]).max() < 0.5


def test_gap_restarts_the_observer(observer, tmp_path):
    motion, _ = pushed_motion()
    kept = (motion.times < 1.0) | (motion.times > 2.0)
    motion = motion._replace(**{name: getattr(motion, name)[kept] for name in motion._fields})
    restarts = observer.restarts
    times, efforts = observed(observer, write_bag(tmp_path / "run", messages(motion)))
    assert observer.restarts >= restarts + 1 and times.max() > LENGTH - 0.1
    assert not efforts[np.argmax(times > 1.5)].any()


def test_recording_without_efforts_is_refused(observer, tmp_path):
    motion, _ = pushed_motion()
    rows = messages(motion._replace(efforts=np.zeros((len(motion.times), 0))))
    with pytest.raises(RecordingError, match="efforts of 'panda_joint1' were not measured"):
        observed(observer, write_bag(tmp_path / "run", rows))


def test_moving_base_is_refused(tmp_path):
    dynamics = Dynamics(load_robot("free_flying_arm"))
    flying = ContactObserver(MomentumBalance(dynamics), undecided(dynamics.joint_names, 20.0))
    motion, _ = pushed_motion()
    recording = open_recording(write_bag(tmp_path / "run", messages(motion)), direct_drives(dynamics.joint_names))
    with pytest.raises(RecordingError, match="the base of 'free_flying_arm' moves"):
        next(observe_recording(recording, flying))


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
@pytest.mark.parametrize(
    ("description", "bag", "split", "cutoff", "bandwidth", "largest", "frame", "force"),
    [
        (str(REAL_DATA / "ur10/ur10.urdf"), "ur10/ur10_unisa_mcap", 2000, 8.0, 20.0, 25.0, "tool0", 50.0),
        ("panda", "panda/panda_unisa_mcap", 520, None, 10.0, 4.0, "panda_link8", 20.0),
    ],
)
def test_real_robots_have_no_collision_until_a_force_is_added(
    description, bag, split, cutoff, bandwidth, largest, frame, force, tmp_path
):
    """Model and thresholds come from the first part of the recording, for one false alarm in 8 hours.

    The second part is observed as it is, and with the torques of a force for half a second."""
    pytest.importorskip("rosbags", reason="rosbags, which reads bags, is not installed")
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    dynamics = Dynamics(load_robot(description))
    names = dynamics.joint_names
    first, second = (
        open_recording(REAL_DATA / bag, direct_drives(names), sample_range=part)
        for part in (SampleRange(None, None, 0, split), SampleRange(None, None, split, None))
    )
    model = build_identification_model(dynamics, first.drives)
    consistent = fit_consistent_robot(fit_parameters(Samples([first], model, cutoff=cutoff)))
    balance = MomentumBalance(Dynamics(consistent.robot), consistent.drives)
    observer = ContactObserver(balance, undecided(names, bandwidth))
    learner = ThresholdLearner(balance.dynamics, observer.detector.thresholds)
    for observation in observe_recording(first, observer):
        learner.add(observer, observation)
    thresholds = learner.learn(8 * 3600.0).thresholds
    assert (thresholds.moving < largest).all()

    def collision_times(recording):
        judge = ContactObserver(balance, thresholds)
        return [o.stamp * 1e-9 for o in observe_recording(recording, judge) if o.begins]

    assert collision_times(second) == []
    (segment,) = second.signal_segments()
    rows = range(len(segment) // 2, len(segment) // 2 + round(0.5 * segment.rate))
    begin = rows[0] / segment.rate
    efforts = segment.effort.copy()
    for k in rows:
        J = balance.dynamics.frame(frame).jacobian(segment.position[k])
        efforts[k] -= J.T @ (force * np.array([0.6, -0.64, 0.48, 0, 0, 0]))
    times = np.arange(len(segment)) / segment.rate
    pushed = Motion(times, segment.position, segment.velocity, segment.velocity, efforts)
    path = write_table(tmp_path / "pushed.csv", pushed, names)
    found = collision_times(open_recording(path, first.drives))
    assert len(found) == 1 and begin <= found[0] < begin + 3 / bandwidth
