"""Identification of a Panda whose truth is known: efforts by Pinocchio, friction and noise that were put in."""

import os
import pickle

import numpy as np
import pytest
from peers import known_panda
from peers.known_panda import COULOMB, NOISE, VISCOUS
from peers.recorded import JOINTS, panda_motion
from scipy.stats import binom, chi2

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.fitting import fit_parameters, select_essential_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.physical_consistency import fit_consistent_robot
from robot_dynamics.identification.samples import Samples
from robot_dynamics.identification.triangular_factors import TriangularFactors, solve_least_squares
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion

RUNS = int(os.environ.get("NOISY_RUNS", "12"))
DYNAMICS = Dynamics(load_robot("panda"))
COLUMNS = build_identification_model(DYNAMICS, direct_drives(JOINTS))
OFFSETS = np.array([0.1, -0.2, 0.05, 0.0, 0.3, -0.1, 0.02])
MOTION = panda_motion(duration=40.0, rate=50.0, viscous=VISCOUS, coulomb=COULOMB)


class Known:
    """A recording of which motions are known as they were, with noise on the efforts. Two pieces, without a gap."""

    name, notes = "known", ()

    def __init__(self, efforts):
        self.efforts = efforts

    def motions(self, statistics, *, cutoff=None, progress=None):
        half = len(MOTION.q) // 2
        for part in (slice(None, half), slice(half, None)):
            rows = MOTION.q[part], MOTION.qd[part], MOTION.qdd[part], self.efforts[part], self.efforts[part]
            yield Motion(MOTION.times[part][0], 50.0, 8.0, *rows, np.ones(7, dtype=bool))

    def signal_segments(self):
        return [part for part in self.motions(None)]


def efforts(seed=None):
    noise = 0 if seed is None else NOISE * np.random.default_rng(seed).normal(size=MOTION.efforts.shape)
    return MOTION.efforts + OFFSETS + noise


def truth():
    return known_panda.truth(COLUMNS, OFFSETS)


def fit_of(measured, method="weighted", **settings):
    return fit_parameters(Samples([Known(measured)], COLUMNS, **settings), method=method)


@pytest.mark.parametrize("method", ["ordinary", "weighted", "robust"])
def test_without_noise_the_truth_comes_back(method):
    fit = fit_of(efforts(), method)
    assert np.abs(fit.values - truth()).max() < 1e-6
    assert fit.training_quality.rms_unfiltered.max() < 1e-8 and fit.condition < 200 and fit.warnings == ()
    assert COLUMNS.inertial_count == 48 and len(COLUMNS.names) == 48 + 14 + 7


def error_statistics(runs):
    """(χ² of each run, how often 95 % intervals cover) for noise on the efforts."""
    statistic, covered = [], []
    for seed in range(runs):
        fit = fit_of(efforts(seed))
        error = fit.values - truth()
        statistic.append(error @ np.linalg.solve(fit.covariance, error))
        covered.append(np.abs(error) < 1.96 * fit.standard_deviations)
    return np.array(statistic), np.mean(covered)


def test_errors_are_as_large_as_they_are_said_to_be():
    """Of 12 runs here; of 200 in `make soak`."""
    statistic, covered = error_statistics(RUNS)
    P = len(COLUMNS.names)
    above = int((statistic > chi2.ppf(0.999, P)).sum())
    print(f"{RUNS} runs: χ² of {P} parameters {statistic.mean():.1f} in the mean, {statistic.max():.1f} at most,")
    print(f"{above} above {chi2.ppf(0.999, P):.1f}, the 99.9 % quantile; 95 % intervals cover {100 * covered:.1f} %")
    assert above <= binom.ppf(0.999, RUNS, 0.001)  # as chance has it
    assert statistic.mean() == pytest.approx(P, rel=0.2) and 0.90 < covered < 0.99


def test_robust_least_squares_survives_collisions():
    measured = efforts(0)
    rng = np.random.default_rng(1)
    for start in rng.integers(0, len(measured) - 20, 12):
        measured[start : start + 10] += rng.choice([-1, 1], 7) * 30 * NOISE
    error = {method: np.abs(fit_of(measured, method).values - truth()) / np.maximum(fit_of(efforts(0)).standard_deviations, 1e-9)
             for method in ("weighted", "robust")}  # fmt: skip
    assert np.sqrt((error["robust"] ** 2).mean()) < 0.5 * np.sqrt((error["weighted"] ** 2).mean())


def test_weights_make_the_quiet_joints_count():
    errors = {}
    for method in ("ordinary", "weighted"):
        offsets = [(fit_of(efforts(seed), method).values - truth())[-7:] for seed in (1, 2)]
        errors[method] = np.mean(np.square(offsets / NOISE))
    assert errors["weighted"] < errors["ordinary"]


def test_what_the_motion_does_not_show_is_said_and_not_essential():
    moved = MOTION._replace(q=MOTION.q.copy(), qd=MOTION.qd.copy(), qdd=MOTION.qdd.copy())
    for array, value in ((moved.q, 0.3), (moved.qd, 0), (moved.qdd, 0)):
        array[:, 6] = value

    class Still(Known):
        def motions(self, statistics, *, cutoff=None, progress=None):
            rows = moved.q, moved.qd, moved.qdd, self.efforts, self.efforts
            yield Motion(0.0, 50.0, 8.0, *rows, np.ones(7, dtype=bool))

    fit = fit_parameters(Samples([Still(efforts(3))], COLUMNS))
    assert any("does not excite" in sentence and "Fv.panda_joint7" in sentence for sentence in fit.warnings)
    brief = fit_parameters(Samples([Known(efforts(3))], COLUMNS, end_fraction=0.1))
    assert brief.condition > 200 and any("condition number" in sentence for sentence in brief.warnings)
    assert not select_essential_parameters(fit)[list(COLUMNS.names).index("Fv.panda_joint7")]
    needed = select_essential_parameters(fit_of(efforts(3)))
    assert needed[list(COLUMNS.names).index("Fv.panda_joint1")] and 30 < needed.sum() < len(COLUMNS.names)


def test_what_is_held_out_is_not_fitted():
    samples = Samples([Known(efforts(0))], COLUMNS, end_fraction=0.6)
    held = Samples([Known(efforts(0))], COLUMNS, start_fraction=0.6)
    fit = fit_parameters(samples, validation=held)
    assert fit.training_quality.samples == 1200 and fit.validation_quality.samples == 800
    assert fit.training_quality.rms_unfiltered == pytest.approx(NOISE, rel=0.1)
    assert fit.validation_quality.rms_unfiltered == pytest.approx(NOISE, rel=0.15)
    with pytest.raises(RecordingError, match="no sample is left"):
        fit_parameters(Samples([Known(efforts(0))], COLUMNS, end_fraction=0.02))


def test_factors_of_parts_are_those_of_the_whole_and_of_numpy():
    rng = np.random.default_rng(0)
    X, y, weights = rng.normal(size=(300, 3, 10)), rng.normal(size=(300, 3)), np.array([1.0, 4.0, 0.25])
    parts = (
        TriangularFactors.from_samples(X[:7], y[:7])
        + TriangularFactors.from_samples(X[7:200], y[7:200])
        + TriangularFactors.from_samples(X[200:], y[200:])
    )
    found = solve_least_squares(*parts.weighted_system(weights))
    root = np.sqrt(weights)
    expected, squares, *_ = np.linalg.lstsq((X * root[:, None]).reshape(-1, 10), (y * root).ravel(), rcond=None)
    assert np.allclose(found.values, expected, atol=1e-12)
    assert (weights * parts.residual_sum_of_squares(expected)).sum() == pytest.approx(squares[0])
    A = (X * root[:, None]).reshape(-1, 10)
    assert np.allclose(found.covariance, np.linalg.inv(A.T @ A)) and parts.samples == 300


def test_what_other_processes_send_does_not_grow_with_the_recording():
    """And is what it is here: the Factors of both parts, added."""
    whole = Samples([Known(efforts(0))], COLUMNS).accumulate_factors()
    start, end = (
        Samples([Known(efforts(0))], COLUMNS, **part).accumulate_factors()
        for part in ({"end_fraction": 0.3}, {"start_fraction": 0.3})
    )
    assert whole.rows > 3 * start.rows and len(pickle.dumps(whole)) == pytest.approx(len(pickle.dumps(start)), rel=0.01)
    assert (start + end).rows == pytest.approx(whole.rows, abs=2)


def pseudo_inertia(inertia):
    J, MS = inertia.second_moments, inertia.first_moments
    return np.block([[np.trace(J) / 2 * np.eye(3) - J, MS[:, None]], [MS[None], np.array([[inertia.mass]])]])


def test_inertias_that_are_written_can_exist_and_fit_as_well():
    """Of noisy data, which by themselves lead to bodies that cannot be."""
    pytest.importorskip("clarabel", reason="clarabel, which finds inertias that bodies can have, is not installed")
    noisy = MOTION.efforts + OFFSETS + 5 * NOISE * np.random.default_rng(0).normal(size=MOTION.efforts.shape)
    fit = fit_of(noisy)
    found = fit_consistent_robot(fit)
    for link in found.robot.links[1:]:
        assert np.linalg.eigvalsh(pseudo_inertia(link.inertia)).min() > 0
    assert found.robot.warnings == ()
    assert all(min(joint.rotor_inertia, joint.viscous_friction, joint.coulomb_friction) >= 0
               for joint in found.robot.joints)  # fmt: skip
    quality = Samples([Known(noisy)], COLUMNS).quality(found.values)
    assert (quality.rms < 1.02 * fit.training_quality.rms).all()
    assert (
        quality.rms
        > 0.999 * fit.training_quality.rms.mean() * fit.training_quality.rms / fit.training_quality.rms.mean()
    ).all()
    again = Dynamics(load_robot(write_mdh_yaml(found.robot)))
    predicted = again.inverse(MOTION.q, MOTION.qd, MOTION.qdd) + found.drives.effort_offsets
    clean = MOTION.efforts + OFFSETS
    assert (np.sqrt(((predicted - clean) ** 2).mean(0)) < 5 * NOISE * 0.25).all()


def test_the_nearest_robot_to_the_truth_is_the_truth():
    pytest.importorskip("clarabel", reason="clarabel, which finds inertias that bodies can have, is not installed")
    found = fit_consistent_robot(fit_of(efforts(0)))
    error = np.abs(found.values - truth()) / fit_of(efforts(0)).standard_deviations
    assert np.sqrt((error**2).mean()) < 1.5
    assert found.drives.effort_offsets == pytest.approx(OFFSETS, abs=0.1)


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
        def motions(self, statistics, *, cutoff=None, progress=None):
            yield Motion(0.0, 100.0, 8.0, q, qd, qdd, self.efforts, self.efforts, np.ones(2, dtype=bool))

    columns = build_identification_model(dynamics, direct_drives(dynamics.joint_names))
    fit = fit_parameters(Samples([Loops(measured)], columns))
    expected = np.concatenate([columns.grouping_matrix @ dynamics.parameters, np.zeros(2)])
    assert np.abs((fit.values - expected) / fit.standard_deviations).max() < 5
