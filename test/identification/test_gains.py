"""Gains of drives of a Panda whose truth is known: efforts by Pinocchio, measured with other gains than those that are
told, with noise, without a payload and with one of which the mass is known and nothing else."""

import os
from dataclasses import dataclass, replace

import numpy as np
import pytest
from peers.known_panda import COULOMB, NOISE, VISCOUS, truth
from peers.recorded import JOINTS, loaded_panda, panda_motion
from scipy.stats import binom, norm

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.drive_gains import Payload, PayloadIdentificationModel, identify_gains
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import Drives, direct_drives
from robot_dynamics.recordings.joint_motions import Motion

RUNS = int(os.environ.get("NOISY_RUNS", "8"))
RATE = 50.0
DYNAMICS = Dynamics(load_robot("panda"))
WRONG = np.array([0.83, 1.2, 0.8, 1.11, 1.17, 0.9, 1.07])  # what torques are, by those that are told
PAYLOAD = Payload("panda_link8", 3.0)
COUPLED = replace(direct_drives(JOINTS), names=tuple(f"motor_{k}" for k in range(7)), ratios=np.diag(
    [100.0, -80, 80, 60, 50, 40, 40]) + np.diag([0, 0, 0, 0, 0, 30.0], -1), effort_gains=np.full(7, 0.1))  # fmt: skip


ROBOTS = {"bare": None, "loaded": loaded_panda(PAYLOAD.mass, (0.03, -0.02, 0.19), 0.015)}
MOTIONS = {name: panda_motion(30.0, RATE, seed, viscous=VISCOUS, coulomb=COULOMB, model=model)
           for seed, (name, model) in enumerate(ROBOTS.items())}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A recording: signals (N, k) of motors, and the drives that they are read with."""

    name: str
    signals: np.ndarray
    drives: Drives
    notes = ()

    def motions(self, statistics, *, cutoff=None):
        motion = MOTIONS[self.name.partition(" ")[0]]
        nothing = np.zeros_like(self.signals)
        efforts = self.drives.to_joint_space(nothing, nothing, self.signals)[2]
        yield Motion(0.0, RATE, 8.0, motion.q, motion.qd, motion.qdd, efforts, efforts, np.ones(7, dtype=bool))


def run(name, drives, seed=None):
    """What drives measure whose gains are WRONG times those that they tell."""
    chance = np.random.default_rng([seed or 0, len(name)])
    at_motors = MOTIONS[name].efforts + (0 if seed is None else NOISE) * chance.normal(size=(len(MOTIONS[name].q), 7))
    return Run(name, at_motors @ np.linalg.inv(drives.ratios) / (drives.effort_gains * WRONG), drives)


def identified(runs, loads=(("loaded", PAYLOAD),), **settings):
    """(Gains, Fit) of runs."""
    columns = build_identification_model(DYNAMICS, runs[0].drives)
    loaded = PayloadIdentificationModel(columns, tuple(dict.fromkeys(payload for _, payload in loads)), dict(loads))
    gains = identify_gains(Samples(runs, loaded, **settings))
    fit = fit_parameters(Samples([replace(run, drives=gains.drives) for run in runs], gains.model, **settings))
    return gains, gains.include_gain_uncertainty(fit)


@pytest.mark.parametrize("drives", [direct_drives(JOINTS), COUPLED], ids=["direct", "coupled"])
def test_without_noise_gains_and_parameters_are_the_true_ones(drives):
    gains, fit = identified([run("bare", drives), run("loaded", drives)])
    assert gains.drives.effort_gains == pytest.approx(drives.effort_gains * WRONG, rel=1e-6)
    assert np.abs(fit.values - truth(fit.model)).max() < 1e-5
    assert fit.training_quality.rms_unfiltered.max() < 1e-6


def test_gains_are_as_certain_as_they_are_said_to_be():
    """Of 8 runs here; of 200 in `make soak`."""
    drives, parts, units, covered = direct_drives(JOINTS), [], [], []
    for seed in range(1, 1 + RUNS):
        gains, fit = identified([run("bare", drives, seed), run("loaded", drives, seed)])
        error = gains.drives.effort_gains - WRONG
        parts.append(error / WRONG)
        units.append(error / gains.standard_deviations)
        of_parameters = (fit.values - truth(fit.model)) / fit.standard_deviations
        covered.append(np.abs(np.concatenate([units[-1], of_parameters])) < 1.96)
    parts, units, covered = np.array(parts), np.array(units), np.array(covered)
    rms = " ".join(f"{100 * part:.2g}" for part in np.sqrt((parts**2).mean(axis=0)))
    print(f"{RUNS} runs: RMS errors of gains {rms} %, at most {100 * np.abs(parts).max():.2g} %, in deviations "
          f"{np.sqrt((units**2).mean()):.3f} RMS")  # fmt: skip
    told = [100 * part.mean() for part in (covered[:, :7], covered[:, 7:])]
    print(f"95 % intervals cover {told[0]:.1f} % of gains, {told[1]:.1f} % of {covered.shape[1] - 7} parameters")
    assert np.abs(parts).max() < 0.05 and np.sqrt((units**2).mean()) == pytest.approx(1, abs=0.6 if RUNS < 50 else 0.1)
    assert np.abs(units.mean(axis=0) * np.sqrt(RUNS)).max() < norm.ppf(1 - 0.001 / 14)  # right in the mean
    assert covered[:, :7].sum() >= binom.ppf(0.001, covered[:, :7].size, 0.90) and 0.9 < covered[:, 7:].mean() < 0.99


def test_where_masses_and_gains_look_alike_no_gain_is_told():
    """The payload in all runs, in none, or one that does not make itself felt."""
    drives = direct_drives(JOINTS)
    bare, loaded = run("bare", drives, 1), run("loaded", drives, 1)
    for runs, loads in (([loaded], [("loaded", PAYLOAD)]), ([bare], []), ([bare, loaded], [])):
        with pytest.raises(RecordingError, match="runs with a payload of known mass beside runs without it"):
            identified(runs, loads)
    light = Payload("panda_link8", 1e-4)  # which no joint feels beside the noise
    with pytest.raises(RecordingError, match=r"standard deviations are too large \(panda_joint1 \d+%"):
        identified([bare, replace(run("bare", drives, 2), name="bare again")], [("bare again", light)])
    silent = [replace(each, signals=each.signals * (np.arange(7) != 2)) for each in (bare, loaded)]
    with pytest.raises(RecordingError, match="the measured efforts of panda_joint3 are zero"):
        identified(silent)


def test_gains_that_are_far_off_are_found_too():
    """As of currents, of which nobody told a gain; a motor that turns the wrong way too."""
    drives = replace(direct_drives(JOINTS), effort_gains=np.array([14.0, -14.0, 9.0, 9.0, 0.9, 0.9, 0.9]))
    told = direct_drives(JOINTS)
    runs = [replace(run(name, drives, 1), drives=told) for name in ("bare", "loaded")]
    gains, _ = identified(runs)
    assert gains.drives.effort_gains == pytest.approx(drives.effort_gains * WRONG, rel=0.04)
