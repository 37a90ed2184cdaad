"""Faults added to simulated and real recordings are identified and dated; recordings without fault have none."""

import os
import re
from itertools import pairwise

import numpy as np
import pytest
from peers.recorded import REAL_DATA, messages, panda_motion, write_bag

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.checking import faults
from robot_dynamics.checking.check import Predictor
from robot_dynamics.checking.faults import Evidence
from robot_dynamics.cli.main import main
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.recording import open_recording
from robot_dynamics.recordings.rest import moving_samples
from robot_dynamics.recordings.signals import choose_cutoff, differentiate, lowpass

KINDS = ("payload", "friction", "gain", "swapped", "sign", "delay", "contact")
KINDS_OF_EACH_RUN = ("payload", "friction", "delay", "contact")  # `make soak` tests all with FAULT_TRIALS
REQUIRED_PARTS = {"gain": 0.4, "contact": 0.6, "sign": 0.7}  # of real faults that are identified; else 0.8
TRIALS = int(os.environ.get("FAULT_TRIALS", "6"))  # of each kind and robot
LATE = 0.03  # [s]


class Subject:
    """A robot with signals of a recording (N, n), to which faults are added before filtering."""

    def __init__(self, dynamics, drives, link, rate, q, qd, efforts):
        self.dynamics, self.link, self.rate = dynamics, link, rate
        self.predictor = Predictor(dynamics, drives)
        self.cutoff, self.efforts = choose_cutoff(rate), efforts
        self.q, self.qd = (lowpass(values, rate, self.cutoff) for values in (q, qd))
        self.qdd = differentiate(self.qd, rate)
        loaded = Dynamics(dynamics.robot.with_payload(link, Inertia(1.0)))
        self.kilogram = loaded.inverse(self.q, self.qd, self.qdd) - dynamics.inverse(self.q, self.qd, self.qdd)
        push = np.tile([0.0, 0.0, 30.0, 0.0, 0.0, 0.0], (len(self.q), 1))
        pushed = dynamics.inverse(self.q, self.qd, self.qdd, external_wrenches={link: push})
        self.push = pushed - dynamics.inverse(self.q, self.qd, self.qdd)
        joints = dynamics.robot.joints
        self.step = np.array([2 * max(joint.coulomb_friction, 0.015 * joint.limits.effort) for joint in joints])

    def add_fault(self, kind, onset, rng):
        """(efforts with a fault from `onset` [s] on, names of its joints)."""
        efforts, n, after = self.efforts.copy(), len(self.step), slice(int(onset * self.rate), None)
        first, second = rng.choice(n, 2, replace=False)
        if kind == "delay":
            times = np.arange(len(efforts)) / self.rate
            efforts[after] = np.stack([np.interp(times[after] - LATE, times, each) for each in self.efforts.T], axis=1)
            return efforts, ()
        if kind == "contact":  # a push of 30 N along z of the link, which lasts a second
            bump = np.interp(np.arange(len(efforts)) / self.rate - onset, [0, 0.4, 0.6, 1], [0, 1, 1, 0])
            return efforts + bump[:, None] * self.push, None
        if kind == "payload":
            efforts[after] += self.kilogram[after]
            return efforts, ()
        if kind == "friction":
            efforts[after, first] += 0.5 * self.step[first] * np.sign(self.qd[after, first])
        if kind == "gain":
            efforts[after, first] *= 1.3
        if kind == "sign":
            efforts[after, first] *= -1
        if kind == "swapped":
            efforts[after, [first, second]] = efforts[after, [second, first]]
        names = self.dynamics.joint_names
        return efforts, {names[first], names[second]} if kind == "swapped" else {names[first]}

    def find_fault(self, efforts, pieces=1, measured=None):
        """The Fault of efforts that come in some pieces, without the edges, as a check has them."""
        ends = int(np.ceil(self.rate / self.cutoff))
        inside = slice(ends, len(efforts) - ends)
        arrays = (self.q, self.qd, self.qdd, lowpass(efforts, self.rate, self.cutoff), efforts)
        measured = np.ones(len(self.step), dtype=bool) if measured is None else measured
        moving = moving_samples(self.q, self.rate, self.cutoff)
        motion = Motion(
            ends / self.rate, self.rate, self.cutoff, *(array[inside] for array in arrays), measured, moving[inside]
        )
        evidence = Evidence(self.predictor, self.link)
        ends = np.linspace(0, len(motion), pieces + 1).astype(int)
        for begin, end in pairwise(ends):
            part = motion.slice_samples(begin, end)
            evidence.add(part, self.predictor(part))
        return evidence.find_fault()

    def count_identified(self, kind, trials, seed=0):
        """(identified, dated, enclosed): how many of the faults at random onsets are identified with their joints;
        dated within 0.5 s too; and have their onset, to a sample, in the interval of possible onsets."""
        rng, counts = np.random.default_rng(seed), np.zeros(3, dtype=int)
        for _ in range(trials):
            onset = rng.uniform(0.2, 0.8) * len(self.efforts) / self.rate
            efforts, joints = self.add_fault(kind, onset, rng)
            fault = self.find_fault(efforts)
            if fault and fault.kind == kind and (joints is None or set(fault.joints) == set(joints)):
                early, late = fault.between
                counts += [1, abs(fault.onset - onset) < 0.5, early - 1 / self.rate < onset < late + 1 / self.rate]
        return counts


def simulated(seed, duration=20.0):
    motion = panda_motion(duration=duration, rate=100.0, seed=seed % 5)
    noise = np.random.default_rng(seed).normal(size=motion.efforts.shape) * [0.4, 0.6, 0.4, 0.5, 0.1, 0.1, 0.05]
    dynamics = Dynamics(load_robot("panda"))
    drives = direct_drives(dynamics.joint_names)
    return Subject(dynamics, drives, "panda_link8", 100.0, motion.q, motion.qd, motion.efforts + noise)


def real(robot, recording, link):
    """A robot that is fitted to its recording, and the recording."""
    pytest.importorskip("clarabel", reason="clarabel, which fits physically consistent inertias, is not installed")
    dynamics = Dynamics(load_robot(robot))
    opened = open_recording(REAL_DATA / recording, direct_drives(dynamics.joint_names))
    identified = fit_consistent_robot(
        fit_parameters(Samples([opened], build_identification_model(dynamics, opened.drives)))
    )
    (segment,) = opened.signal_segments()
    signals = segment.position, segment.velocity, segment.effort
    return Subject(Dynamics(identified.robot), identified.drives, link, segment.rate, *signals)


@pytest.mark.slow
def test_evidence_of_simulated_recordings_without_fault_has_none():
    subject = simulated(0)
    motion = panda_motion(duration=20.0, rate=100.0)
    for seed in range(max(12, TRIALS)):
        noise = np.random.default_rng(seed).normal(size=motion.efforts.shape)
        assert subject.find_fault(motion.efforts + noise * [0.4, 0.6, 0.4, 0.5, 0.1, 0.1, 0.05]) is None, seed


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS if "FAULT_TRIALS" in os.environ else KINDS_OF_EACH_RUN)
def test_faults_of_simulated_recordings_are_identified_and_dated(kind):
    identified, dated, enclosed = simulated(1).count_identified(kind, 6)
    missed = 1 if kind in ("gain", "contact") else 0  # a gain of the first joint; a push that friction explains as well
    assert identified >= 6 - missed and dated == identified and enclosed >= identified - missed


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_faults_late_in_recordings_longer_than_the_memory_are_identified(kind, monkeypatch):
    monkeypatch.setattr(faults, "MAX_SAMPLES", 1000)  # of 6000 at 50 Hz
    subject = simulated(3, duration=120.0)
    efforts, joints = subject.add_fault(kind, 104.0, np.random.default_rng(0))
    fault = subject.find_fault(efforts, pieces=23)
    assert fault.kind == kind and (joints is None or set(fault.joints) == set(joints))
    assert fault.onset == pytest.approx(104.0, abs=0.5)
    assert subject.find_fault(subject.efforts, pieces=23) is None


@pytest.mark.parametrize("joint", [0, 3])
def test_joint_without_efforts_has_no_fault_and_hides_none(joint):
    subject = simulated(4)
    unloaded, loaded = subject.efforts.copy(), subject.add_fault("payload", 11.0, np.random.default_rng(0))[0]
    unloaded[:, joint] = loaded[:, joint] = 0
    measured = np.arange(7) != joint
    assert subject.find_fault(unloaded, measured=measured) is None
    fault = subject.find_fault(loaded, measured=measured)
    assert fault.kind == "payload" and fault.onset == pytest.approx(11.0, abs=0.2)


@pytest.mark.slow
@pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
@pytest.mark.parametrize(
    ("robot", "recording", "link"),
    [
        pytest.param(
            *(REAL_DATA / "ur10" / "ur10.urdf", "ur10/ur10_unisa_mcap", "tool0"),
            marks=pytest.mark.skipif("FAULT_TRIALS" not in os.environ, reason="a minute: a part of `make soak`"),
        ),
        ("panda", "panda/panda_unisa_mcap", "panda_link8"),
    ],
)
def test_faults_of_real_recordings_are_identified_and_dated(robot, recording, link):
    subject = real(robot, recording, link)
    assert subject.find_fault(subject.efforts) is None
    counts = {kind: subject.count_identified(kind, TRIALS) for kind in KINDS}
    for kind, (identified, dated, enclosed) in counts.items():
        print(f"{robot}: {kind:8} identified {identified}, within 0.5 s {dated}, enclosed {enclosed} of {TRIALS}")
    for kind, (identified, dated, _) in counts.items():
        required = REQUIRED_PARTS.get(kind, 0.8)
        assert identified >= int(required * TRIALS) and dated >= int(0.8 * required * TRIALS), counts


@pytest.mark.skipif(not REAL_DATA.is_dir(), reason=f"no real data in {REAL_DATA}")
def test_hand_of_a_panda_that_is_taken_off_is_identified_as_negative_payload():
    """The hand of a Panda has 0.73 kg; in the recording it is not mounted. Its efforts are added to the first half."""
    subject = real("panda", "panda/panda_unisa_mcap", "panda_link8")
    hand = Inertia.about_centre_of_mass(0.73, np.diag([1e-3, 2.5e-3, 1.7e-3]), [0, 0.01, 0.03])
    with_hand = Dynamics(subject.dynamics.robot.with_payload("panda_link8", hand))
    motion = subject.q, subject.qd, subject.qdd
    half = len(subject.q) // 2
    efforts = subject.efforts.copy()
    efforts[:half] += (with_hand.inverse(*motion) - subject.dynamics.inverse(*motion))[:half]
    subject.predictor = Predictor(with_hand, subject.predictor.drives)
    fault = subject.find_fault(efforts)
    assert fault.kind == "payload" and fault.onset == pytest.approx(half / subject.rate, abs=0.2)
    (kilograms,) = re.findall(r"payload of (\S+) kg", fault.sentence)
    assert float(kilograms) == pytest.approx(-0.73, abs=0.1)


@pytest.mark.slow
def test_command_reports_a_payload(tmp_path, capsys):
    subject = simulated(2)
    efforts, _ = subject.add_fault("payload", 8.0, np.random.default_rng(0))
    motion = panda_motion(duration=20.0, rate=100.0, seed=2)
    unloaded = messages(motion._replace(efforts=subject.efforts))
    loaded = messages(motion._replace(efforts=efforts))
    command = ["--robot", "panda", "--faults"]
    assert main(["replay-check", str(write_bag(tmp_path / "unloaded", unloaded)), *command]) == 0
    assert "\nno fault found\n\npassed, except" in capsys.readouterr().out
    assert main(["replay-check", str(write_bag(tmp_path / "loaded", loaded)), *command]) == 3
    output = capsys.readouterr().out
    sentence = r"fault: a payload of (\S+) kg on panda_link8, since (\S+) s \(between (\S+) and (\S+) s\)"
    kilograms, since, early, late = map(float, re.search(sentence, output).groups())
    assert kilograms == pytest.approx(1.0, abs=0.05) and since == pytest.approx(8.0, abs=0.1)
    assert 7.8 < early < 8.0 < late < 8.2
