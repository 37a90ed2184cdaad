"""Drive gains of a Panda with known parameters: efforts of Pinocchio with noise, measured with gains that differ from
the nominal ones, without a payload and with a payload of known mass."""

import os
from dataclasses import dataclass, replace

import numpy as np
import pytest
from peers.known_panda import COULOMB, NOISE, VISCOUS, truth
from peers.linear_gains import ordinary_least_squares_gains
from peers.recorded import JOINTS, loaded_panda, panda_motion
from scipy.signal import lfilter
from scipy.stats import binom, norm

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.drive_gains import Payload, PayloadIdentificationModel, identify_gains
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.gain_problem import GainProblem
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


# the same body as that of "loaded", fixed to the flange in another way
ROBOTS = {**ROBOTS, "remounted": loaded_panda(PAYLOAD.mass, (-0.08, 0.05, 0.12), 0.015)}
MOTIONS["remounted"] = panda_motion(30.0, RATE, 2, viscous=VISCOUS, coulomb=COULOMB, model=ROBOTS["remounted"])


@dataclass(frozen=True)
class Run:
    """A recording with signals (N, k) of motors and the drives to read them."""

    name: str
    signals: np.ndarray
    drives: Drives
    notes = ()

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

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


def run(name, drives, seed=None, further=None, correlation=0.0):
    """Simulate the signals of drives whose true gains are WRONG times the nominal ones.

    further: function of velocities, efforts beyond those of the model; correlation: of the noise, of neighbours."""
    rng = np.random.default_rng([seed or 0, len(name)])
    noise = rng.normal(size=(len(MOTIONS[name].q), 7))
    noise = lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], noise, axis=0)
    motor_efforts = MOTIONS[name].efforts + (0 if seed is None else NOISE) * noise
    motor_efforts = motor_efforts + (0 if further is None else further(MOTIONS[name].qd))
    return Run(name, motor_efforts @ np.linalg.inv(drives.ratios) / (drives.effort_gains * WRONG), drives)


def gain_samples(runs, loads=(("loaded", PAYLOAD),), **settings):
    """Samples from which gains are identified."""
    model = build_identification_model(DYNAMICS, runs[0].drives)
    return Samples(runs, PayloadIdentificationModel(model, dict(loads)), **settings)


def identify(runs, loads=(("loaded", PAYLOAD),), **settings):
    """Identify gains and parameters of runs."""
    gains = identify_gains(gain_samples(runs, loads, **settings))
    fit = fit_parameters(Samples([replace(run, drives=gains.drives) for run in runs], gains.model, **settings))
    return gains, gains.include_gain_uncertainty(fit)


def stribeck(qd):
    """Friction at low speeds that the identified model does not have."""
    return COULOMB * np.sign(qd) / (1 + (qd / 0.1) ** 2)


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


@pytest.mark.slow
def test_ordinary_least_squares_are_biased_and_total_least_squares_are_not():
    """With four times the noise of the other tests, ordinary least squares lose a fifth of each gain and more."""
    drives, ordinary, initial, normalized = direct_drives(JOINTS), [], [], []
    for seed in range(1, 5):
        runs = [run(name, drives, seed) for name in ("bare", "loaded")]
        noise = [run(name, drives, seed).signals - run(name, drives).signals for name in ("bare", "loaded")]
        runs = [replace(a, signals=a.signals + 3 * e) for a, e in zip(runs, noise, strict=True)]
        samples = gain_samples(runs)
        factors = samples.accumulate_factors().factors
        problem = GainProblem(factors.triangles)
        ordinary.append(ordinary_least_squares_gains(problem.y.T, np.moveaxis(problem.X, 0, 1), problem.L.T) / WRONG)
        initial.append(
            1
            / problem.initial_values(problem.noise_squares() / factors.samples, factors.samples)[
                problem.parameter_count :
            ]
            / WRONG
        )
        gains = identify_gains(samples)
        normalized.append((gains.drives.effort_gains - WRONG) / gains.standard_deviations)
    assert np.mean(ordinary, axis=0).max() < 0.8
    assert np.mean(initial, axis=0) == pytest.approx(np.ones(7), abs=0.1)  # linear total least squares
    assert np.abs(np.mean(normalized, axis=0)).max() < 1  # the bias is below a standard deviation
    assert np.sqrt(np.mean(np.square(normalized))) < 1.4


@pytest.mark.slow
@pytest.mark.parametrize(("further", "correlation"), [(stribeck, 0.0), (None, 0.93)], ids=["friction", "noise"])
def test_deviations_include_errors_of_the_model_and_correlated_noise(further, correlation):
    """Friction that the model does not have, or noise that is correlated over 0.3 s: there, deviations for white noise
    are too small by a factor of three."""
    drives, errors, deviations = direct_drives(JOINTS), [], []
    for seed in range(1, 5):
        gains = identify_gains(gain_samples([run(name, drives, seed, further, correlation) for name in ROBOTS][:2]))
        errors.append(gains.drives.effort_gains - WRONG)
        deviations.append(gains.standard_deviations)
    assert 0.5 < np.sqrt(np.mean(np.square(np.divide(errors, deviations)))) < 1.5
    assert np.abs(np.mean(errors, axis=0) / WRONG)[:6].max() < (0.006 if further else 0.03)


def test_a_payload_that_is_mounted_again_has_a_centre_of_its_own():
    drives = direct_drives(JOINTS)
    loads = [("loaded", PAYLOAD), ("remounted", PAYLOAD)]
    gains, fit = identify([run("bare", drives), run("loaded", drives), run("remounted", drives)], loads)
    assert gains.drives.effort_gains == pytest.approx(WRONG, rel=1e-6)
    assert fit.training_quality.rms_unfiltered.max() < 1e-6
    centres = [gains.model.payloads[name].parameters[6:9] / PAYLOAD.mass for name, _ in loads]
    assert np.linalg.norm(centres[0] - centres[1]) == pytest.approx(np.linalg.norm([0.11, 0.07, 0.07]), rel=1e-3)
    model = replace(gains.model, payloads={"loaded": gains.model.payloads["loaded"]})
    assert model.with_same_payloads(dict(loads)).payloads["remounted"] is gains.model.payloads["loaded"]


def test_gains_above_a_deviation_of_5_percent_count_as_uncertain():
    drives = direct_drives(JOINTS)
    gains = identify_gains(gain_samples([run("bare", drives, 1), run("loaded", drives, 1)]))
    assert not gains.uncertain.any()
    deviations = np.where(np.arange(7) == 3, 0.06, 0.01) * gains.drives.effort_gains
    assert replace(gains, standard_deviations=deviations).uncertain.tolist() == [False] * 3 + [True] + [False] * 3
