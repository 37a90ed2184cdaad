"""Identification of a Panda with known parameters: efforts of Pinocchio with added friction and noise."""

import os
import pickle
from dataclasses import replace

import numpy as np
import pytest
from peers import known_panda
from peers.known_panda import COULOMB, NOISE, VISCOUS
from peers.recorded import JOINTS, panda_motion
from scipy.stats import binom, chi2

from robot_dynamics import Dynamics, Inertia, load_robot
from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.determination import judge_determination
from robot_dynamics.identification.fitting import fit_parameters, select_essential_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.motion_blocks import MAX_BLOCKS
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.identification.triangular_factors import TriangularFactors, solve_least_squares
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion

RUNS = int(os.environ.get("NOISY_RUNS", "12"))
DYNAMICS = Dynamics(load_robot("panda"))
MODEL = build_identification_model(DYNAMICS, direct_drives(JOINTS))
OFFSETS = np.array([0.1, -0.2, 0.05, 0.0, 0.3, -0.1, 0.02])
MOTION = panda_motion(duration=40.0, rate=50.0, viscous=VISCOUS, coulomb=COULOMB)


class Known:
    """A recording with exact motions and noise on the efforts, in two pieces without a gap."""

    name, notes = "known", ()

    def __init__(self, efforts):
        self.efforts = efforts

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

    def motions(self, statistics, *, cutoff=None, progress=None):
        half = len(MOTION.q) // 2
        for part in (slice(None, half), slice(half, None)):
            rows = MOTION.q[part], MOTION.qd[part], MOTION.qdd[part], self.efforts[part], self.efforts[part]
            yield Motion(
                MOTION.times[part][0], 50.0, 8.0, *rows, np.ones(7, dtype=bool), np.ones(rows[0].shape, dtype=bool)
            )

    def signal_segments(self):
        return [part for part in self.motions(None)]


def efforts(seed=None):
    noise = 0 if seed is None else NOISE * np.random.default_rng(seed).normal(size=MOTION.efforts.shape)
    return MOTION.efforts + OFFSETS + noise


def truth():
    return known_panda.truth(MODEL, OFFSETS)


def fit_of(measured, method="weighted", **settings):
    return fit_parameters(Samples([Known(measured)], MODEL, **settings), method=method)


@pytest.mark.parametrize("method", ["ordinary", "weighted", "robust"])
def test_fit_without_noise_returns_the_true_parameters(method):
    fit = fit_of(efforts(), method)
    assert np.abs(fit.values - truth()).max() < 1e-6
    assert fit.training_quality.rms_unfiltered.max() < 1e-8 and fit.condition < 200 and fit.warnings == ()
    assert MODEL.inertial_count == 48 and len(MODEL.names) == 48 + 14 + 7


def error_statistics(runs):
    """χ² of each run, and the fraction of 95 % intervals that cover the truth, for noise on the efforts."""
    statistic, covered = [], []
    for seed in range(runs):
        fit = fit_of(efforts(seed))
        error = fit.values - truth()
        statistic.append(error @ np.linalg.solve(fit.covariance, error))
        covered.append(np.abs(error) < 1.96 * fit.standard_deviations)
    return np.array(statistic), np.mean(covered)


def test_errors_are_as_large_as_estimated():
    """There are 12 runs here, and 200 in `make soak`."""
    statistic, covered = error_statistics(RUNS)
    P = len(MODEL.names)
    above = int((statistic > chi2.ppf(0.999, P)).sum())
    print(f"{RUNS} runs: χ² of {P} parameters {statistic.mean():.1f} in the mean, {statistic.max():.1f} at most,")
    print(f"{above} above {chi2.ppf(0.999, P):.1f}, the 99.9 % quantile; 95 % intervals cover {100 * covered:.1f} %")
    assert above <= binom.ppf(0.999, RUNS, 0.001)  # expected by chance
    assert statistic.mean() == pytest.approx(P, rel=0.2) and 0.90 < covered < 0.99


def test_robust_least_squares_tolerates_collisions():
    measured = efforts(0)
    rng = np.random.default_rng(1)
    for start in rng.integers(0, len(measured) - 20, 12):
        measured[start : start + 10] += rng.choice([-1, 1], 7) * 30 * NOISE
    scale = np.maximum(fit_of(efforts(0)).standard_deviations, 1e-9)
    error = {method: np.abs(fit_of(measured, method).values - truth()) / scale for method in ("weighted", "robust")}
    assert np.sqrt((error["robust"] ** 2).mean()) < 0.5 * np.sqrt((error["weighted"] ** 2).mean())


def test_weights_improve_the_offsets_of_joints_with_low_noise():
    errors = {}
    for method in ("ordinary", "weighted"):
        offsets = [(fit_of(efforts(seed), method).values - truth())[-7:] for seed in (1, 2)]
        errors[method] = np.mean(np.square(offsets / NOISE))
    assert errors["weighted"] < errors["ordinary"]


def test_parameters_without_excitation_are_reported_and_not_essential():
    moved = MOTION._replace(q=MOTION.q.copy(), qd=MOTION.qd.copy(), qdd=MOTION.qdd.copy())
    for array, value in ((moved.q, 0.3), (moved.qd, 0), (moved.qdd, 0)):
        array[:, 6] = value

    class Still(Known):
        source = part = message_count = None
        time_range = (-np.inf, np.inf)

        def motions(self, statistics, *, cutoff=None, progress=None):
            rows = moved.q, moved.qd, moved.qdd, self.efforts, self.efforts
            yield Motion(0.0, 50.0, 8.0, *rows, np.ones(7, dtype=bool), np.ones(rows[0].shape, dtype=bool))

    fit = fit_parameters(Samples([Still(efforts(3))], MODEL))
    assert any("does not excite" in sentence and "Fv.panda_joint7" in sentence for sentence in fit.warnings)
    brief = fit_parameters(Samples([Known(efforts(3))], MODEL, end_fraction=0.1))
    assert brief.condition > 200 and judge_determination(brief).verdict != "well"
    assert not select_essential_parameters(fit)[list(MODEL.names).index("Fv.panda_joint7")]
    essential = select_essential_parameters(fit_of(efforts(3)))
    assert essential[list(MODEL.names).index("Fv.panda_joint1")] and 30 < essential.sum() < len(MODEL.names)


def test_inertia_that_the_description_makes_far_too_large_is_fitted():
    """Link 7 has 0.7 kg, and in the description 1 kg m² about its centre of mass: a table that was filled somehow."""
    robot = load_robot("panda")
    last = robot.links[-1]
    filled = replace(last, inertia=Inertia(last.inertia.mass, last.inertia.first_moments, 1.02 * np.eye(3)))
    wrong = Dynamics(replace(robot, links=(*robot.links[:-1], filled)))
    noisy = efforts() + 3.0 * np.random.default_rng(1).normal(size=MOTION.efforts.shape)
    model = build_identification_model(wrong, direct_drives(JOINTS))
    fit = fit_parameters(Samples([Known(noisy)], model))
    assert fit.training_quality.rms[6] < 1.05 * fit_of(noisy).training_quality.rms[6]
    assert fit.seen[model.names.index("ZZ.panda_link7")]


def test_held_out_samples_are_not_fitted():
    samples = Samples([Known(efforts(0))], MODEL, end_fraction=0.6)
    validation = Samples([Known(efforts(0))], MODEL, start_fraction=0.6)
    fit = fit_parameters(samples, validation=validation)
    assert fit.training_quality.samples == 1200 and fit.validation_quality.samples == 800
    assert fit.training_quality.rms_unfiltered == pytest.approx(NOISE, rel=0.1)
    assert fit.validation_quality.rms_unfiltered == pytest.approx(NOISE, rel=0.15)
    with pytest.raises(RecordingError, match="no sample is left"):
        fit_parameters(Samples([Known(efforts(0))], MODEL, end_fraction=0.02))


def test_triangular_factors_of_parts_agree_with_numpy():
    rng = np.random.default_rng(0)
    X, y, weights = rng.normal(size=(300, 3, 10)), rng.normal(size=(300, 3)), np.array([1.0, 4.0, 0.25])
    parts = (
        TriangularFactors.from_samples(X[:7], y[:7])
        + TriangularFactors.from_samples(X[7:200], y[7:200])
        + TriangularFactors.from_samples(X[200:], y[200:])
    )
    solution = solve_least_squares(*parts.weighted_system(weights))
    root = np.sqrt(weights)
    expected, squares, *_ = np.linalg.lstsq((X * root[:, None]).reshape(-1, 10), (y * root).ravel(), rcond=None)
    assert np.allclose(solution.values, expected, atol=1e-12)
    assert (weights * parts.residual_sum_of_squares(expected)).sum() == pytest.approx(squares[0])
    A = (X * root[:, None]).reshape(-1, 10)
    assert np.allclose(solution.covariance, np.linalg.inv(A.T @ A)) and parts.samples.tolist() == [300] * 3


def test_sums_from_other_processes_do_not_grow_with_the_recording():
    """Each block has a size of its own, so their number is limited; the sums of all blocks are those of all rows."""
    short, long = (Samples([Known(efforts(0))], MODEL, end_fraction=part).accumulate_factors() for part in (0.3, 1.0))
    assert long.factors.samples.min() > 3 * short.factors.samples.max()
    assert len(short.blocks) == 12 and len(long.blocks) == 20  # the motion repeats itself after 20 s
    rows = short.factors.samples.sum()
    repeated = short
    while len(repeated.blocks) < MAX_BLOCKS:
        motions = short.blocks.motions
        shifted = motions._replace(positions=motions.positions + len(repeated.blocks))
        repeated = repeated + replace(short, blocks=replace(short.blocks, motions=shifted))
    repeated = repeated + short
    assert len(repeated.blocks) == MAX_BLOCKS and len(pickle.dumps(repeated)) < MAX_BLOCKS * 8 * 7 * 71**2
    assert repeated.factors.samples.sum() % rows == 0 and repeated.factors.samples.sum() > 5 * rows
    doubled = (short + short).factors.residual_sum_of_squares(truth())
    assert doubled == pytest.approx(2 * short.factors.residual_sum_of_squares(truth()))
    assert len((short + short).blocks) == len(short.blocks)  # a repeated motion adds to its block


def pseudo_inertia(inertia):
    J, MS = inertia.second_moments, inertia.first_moments
    return np.block([[np.trace(J) / 2 * np.eye(3) - J, MS[:, None]], [MS[None], np.array([[inertia.mass]])]])


def test_consistent_robot_has_valid_inertias_and_fits_as_well():
    """The noisy data lead to inconsistent bodies without constraints."""
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    noisy = MOTION.efforts + OFFSETS + 5 * NOISE * np.random.default_rng(0).normal(size=MOTION.efforts.shape)
    fit = fit_of(noisy)
    consistent = fit_consistent_robot(fit)
    for link in consistent.robot.links[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(link.inertia)).min() > 0
    assert consistent.robot.warnings == ()
    assert all(min(joint.rotor_inertia, joint.viscous_friction, joint.coulomb_friction) >= 0
               for joint in consistent.robot.joints)  # fmt: skip
    quality = Samples([Known(noisy)], MODEL).quality(consistent.values)
    assert (quality.rms < 1.02 * fit.training_quality.rms).all()
    assert (
        quality.rms
        > 0.999 * fit.training_quality.rms.mean() * fit.training_quality.rms / fit.training_quality.rms.mean()
    ).all()
    again = Dynamics(load_robot(write_mdh_yaml(consistent.robot)))
    predicted = again.inverse(MOTION.q, MOTION.qd, MOTION.qdd) + consistent.drives.effort_offsets
    clean = MOTION.efforts + OFFSETS
    assert (np.sqrt(((predicted - clean) ** 2).mean(0)) < 5 * NOISE * 0.25).all()


def test_consistent_robot_agrees_with_the_truth():
    pytest.importorskip("clarabel", reason="clarabel, which computes physically consistent inertias, is not installed")
    consistent = fit_consistent_robot(fit_of(efforts(0)))
    error = np.abs(consistent.values - truth()) / fit_of(efforts(0)).standard_deviations
    assert np.sqrt((error**2).mean()) < 1.5
    assert consistent.drives.effort_offsets == pytest.approx(OFFSETS, abs=0.1)


@pytest.mark.slow
def test_robots_with_loops_are_identified():
    dynamics = Dynamics(load_robot("five_bar"))
    times = np.arange(3000) / 100.0
    middle = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]]
    q, qd, qdd = (np.zeros((len(times), 2)) for _ in range(3))
    for frequency, amplitude, phase in ((0.3, 0.12, (0, 1)), (0.7, 0.08, (2, 0.5)), (1.1, 0.05, (1, 3))):
        w, angles = 2 * np.pi * frequency, 2 * np.pi * frequency * times[:, None] + np.array(phase)
        q, qd, qdd = (a + amplitude * b for a, b in zip((q, qd, qdd), (
            np.sin(angles), w * np.cos(angles), -w * w * np.sin(angles)), strict=True))  # fmt: skip
    q = q + middle
    measured = dynamics.inverse(q, qd, qdd) + 1e-3 * np.random.default_rng(0).normal(size=q.shape)

    class Loops(Known):
        source = part = message_count = None
        time_range = (-np.inf, np.inf)

        def motions(self, statistics, *, cutoff=None, progress=None):
            yield Motion(
                0.0,
                100.0,
                8.0,
                q,
                qd,
                qdd,
                self.efforts,
                self.efforts,
                np.ones(2, dtype=bool),
                np.ones(q.shape, dtype=bool),
            )

    model = build_identification_model(dynamics, direct_drives(dynamics.joint_names))
    fit = fit_parameters(Samples([Loops(measured)], model))
    expected = np.concatenate([model.grouping_matrix @ dynamics.parameters, np.zeros(2)])
    assert np.abs((fit.values - expected) / fit.standard_deviations).max() < 5
