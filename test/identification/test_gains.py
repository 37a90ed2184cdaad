"""Drive gains of a Panda with known parameters: efforts of Pinocchio with noise, measured with gains that differ from
the nominal ones, without a payload and with a payload of known mass."""

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
WRONG = np.array([0.83, 1.2, 0.8, 1.11, 1.17, 0.9, 1.07])  # true gains, relative to the nominal ones
PAYLOAD = Payload("panda_link8", 3.0)
COUPLED = replace(direct_drives(JOINTS), names=tuple(f"motor_{k}" for k in range(7)), ratios=np.diag(
    [100.0, -80, 80, 60, 50, 40, 40]) + np.diag([0, 0, 0, 0, 0, 30.0], -1), effort_gains=np.full(7, 0.1))  # fmt: skip


ROBOTS = {"bare": None, "loaded": loaded_panda(PAYLOAD.mass, (0.03, -0.02, 0.19), 0.015)}
MOTIONS = {name: panda_motion(30.0, RATE, seed, viscous=VISCOUS, coulomb=COULOMB, model=model)
           for seed, (name, model) in enumerate(ROBOTS.items())}  # fmt: skip


@dataclass(frozen=True)
class Run:
    """A recording with signals (N, k) of motors and the drives to read them."""

    name: str
    signals: np.ndarray
    drives: Drives
    notes = ()

    def motions(self, statistics, *, cutoff=None):
        motion = MOTIONS[self.name.partition(" ")[0]]
        nothing = np.zeros_like(self.signals)
        efforts = self.drives.to_joint_space(nothing, nothing, self.signals)[2]
        yield Motion(
            0.0,
            RATE,
            8.0,
            motion.q,
            motion.qd,
            motion.qdd,
            efforts,
            efforts,
            np.ones(7, dtype=bool),
            np.ones(efforts.shape, dtype=bool),
        )


def run(name, drives, seed=None):
    """Simulate the signals of drives whose true gains are WRONG times the nominal ones."""
    rng = np.random.default_rng([seed or 0, len(name)])
    motor_efforts = MOTIONS[name].efforts + (0 if seed is None else NOISE) * rng.normal(size=(len(MOTIONS[name].q), 7))
    return Run(name, motor_efforts @ np.linalg.inv(drives.ratios) / (drives.effort_gains * WRONG), drives)


def identify(runs, loads=(("loaded", PAYLOAD),), **settings):
    """Identify gains and parameters of runs."""
    model = build_identification_model(DYNAMICS, runs[0].drives)
    loaded = PayloadIdentificationModel(model, tuple(dict.fromkeys(payload for _, payload in loads)), dict(loads))
    gains = identify_gains(Samples(runs, loaded, **settings))
    fit = fit_parameters(Samples([replace(run, drives=gains.drives) for run in runs], gains.model, **settings))
    return gains, gains.include_gain_uncertainty(fit)


@pytest.mark.parametrize("drives", [direct_drives(JOINTS), COUPLED], ids=["direct", "coupled"])
def test_gains_and_parameters_without_noise_are_the_true_ones(drives):
    gains, fit = identify([run("bare", drives), run("loaded", drives)])
    assert gains.drives.effort_gains == pytest.approx(drives.effort_gains * WRONG, rel=1e-6)
    assert np.abs(fit.values - truth(fit.model)).max() < 1e-5
    assert fit.training_quality.rms_unfiltered.max() < 1e-6


@pytest.mark.slow
def test_errors_of_gains_agree_with_their_standard_deviations():
    """There are 8 runs here, and 200 in `make soak`."""
    drives, relative, normalized, covered = direct_drives(JOINTS), [], [], []
    for seed in range(1, 1 + RUNS):
        gains, fit = identify([run("bare", drives, seed), run("loaded", drives, seed)])
        error = gains.drives.effort_gains - WRONG
        relative.append(error / WRONG)
        normalized.append(error / gains.standard_deviations)
        parameter_errors = (fit.values - truth(fit.model)) / fit.standard_deviations
        covered.append(np.abs(np.concatenate([normalized[-1], parameter_errors])) < 1.96)
    relative, normalized, covered = (
        np.array(relative),
        np.array(normalized),
        np.array(covered),
    )
    rms = " ".join(f"{100 * values:.2g}" for values in np.sqrt((relative**2).mean(axis=0)))
    print(f"{RUNS} runs: RMS errors of gains {rms} %, at most {100 * np.abs(relative).max():.2g} %, in deviations "
          f"{np.sqrt((normalized**2).mean()):.3f} RMS")  # fmt: skip
    coverage = [100 * values.mean() for values in (covered[:, :7], covered[:, 7:])]
    print(
        f"95 % intervals cover {coverage[0]:.1f} % of gains, {coverage[1]:.1f} % of {covered.shape[1] - 7} parameters"
    )
    assert np.abs(relative).max() < 0.05 and np.sqrt((normalized**2).mean()) == pytest.approx(
        1, abs=0.6 if RUNS < 50 else 0.1
    )
    assert np.abs(normalized.mean(axis=0) * np.sqrt(RUNS)).max() < norm.ppf(1 - 0.001 / 14)  # unbiased
    assert covered[:, :7].sum() >= binom.ppf(0.001, covered[:, :7].size, 0.90) and 0.9 < covered[:, 7:].mean() < 0.99


def test_gains_that_masses_do_not_determine_are_refused():
    """All runs or none have the payload, or it is too light."""
    drives = direct_drives(JOINTS)
    bare, loaded = run("bare", drives, 1), run("loaded", drives, 1)
    for runs, loads in (([loaded], [("loaded", PAYLOAD)]), ([bare], []), ([bare, loaded], [])):
        with pytest.raises(RecordingError, match="runs with a payload of known mass beside runs without it"):
            identify(runs, loads)
    light = Payload("panda_link8", 1e-4)  # less than the noise
    with pytest.raises(RecordingError, match=r"standard deviations are too large \(panda_joint1 \d+%"):
        identify([bare, replace(run("bare", drives, 2), name="bare again")], [("bare again", light)])
    silent = [replace(recording, signals=recording.signals * (np.arange(7) != 2)) for recording in (bare, loaded)]
    with pytest.raises(RecordingError, match="the measured efforts of panda_joint3 are zero"):
        identify(silent)


def test_gains_far_from_the_nominal_ones_are_identified():
    """As with currents and unknown gains; one motor has the opposite sign."""
    drives = replace(direct_drives(JOINTS), effort_gains=np.array([14.0, -14.0, 9.0, 9.0, 0.9, 0.9, 0.9]))
    nominal_drives = direct_drives(JOINTS)
    runs = [replace(run(name, drives, 1), drives=nominal_drives) for name in ("bare", "loaded")]
    gains, _ = identify(runs)
    assert gains.drives.effort_gains == pytest.approx(drives.effort_gains * WRONG, rel=0.04)
