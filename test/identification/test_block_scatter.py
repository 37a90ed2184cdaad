"""Standard deviations of fits whose residuals are not white noise: correlated noise, friction that is not modelled.

The truth of such a fit is not known: a wrong model fits each motion best with other values. The deviations are right if
the differences between fits to different motions are as large as they say.
"""

import itertools
from functools import cache

import numpy as np
import pytest
from peers.known_panda import COULOMB, NOISE, VISCOUS
from peers.recorded import JOINTS, panda_motion
from scipy.signal import lfilter

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.identification.alternatives import try_alternatives
from robot_dynamics.identification.block_scatter import block_covariance, held_out_squares, joint_covariance
from robot_dynamics.identification.determination import judge_determination
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.motion_blocks import MotionBlocks, MotionSummary
from robot_dynamics.identification.samples import Samples
from robot_dynamics.identification.triangular_factors import TriangularFactors
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.rest import moving_samples

RATE = 50.0
MODEL = build_identification_model(Dynamics(load_robot("panda")), direct_drives(JOINTS))
STRIBECK_VELOCITY = 0.1  # [rad/s]


class Simulated:
    """A recording with exact positions; added: efforts (N, 7) that the model does not have."""

    notes = ()

    def __init__(self, motion, added, name="simulated"):
        self.name, self.motion, self.added = name, motion, added

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

    def motions(self, statistics, *, cutoff=None):
        q, qd, qdd = self.motion.q, self.motion.qd, self.motion.qdd
        measured = self.motion.efforts + self.added
        moving = moving_samples(q, RATE, 8.0)
        yield Motion(0.0, RATE, 8.0, q, qd, qdd, measured, measured, np.ones(7, dtype=bool), moving)

    def signal_segments(self):
        return list(self.motions(None))


def stribeck(motion):
    return 0.8 * COULOMB * np.exp(-np.square(motion.qd / STRIBECK_VELOCITY)) * np.sign(motion.qd)


def correlated_noise(motion, seed):
    """Noise of the standard deviation of NOISE whose correlation decays in 0.3 s."""
    decay = np.exp(-1 / (0.3 * RATE))
    white = np.random.default_rng(seed).normal(size=motion.q.shape)
    return NOISE * np.sqrt(1 - decay**2) * lfilter([1.0], [1.0, -decay], white, axis=0)


@cache
def fits(kind, runs=6):
    results = []
    for seed in range(runs):
        motion = panda_motion(20.0, RATE, seed, VISCOUS, COULOMB)
        added = 0.3 * NOISE * np.random.default_rng(seed).normal(size=motion.q.shape)
        added += stribeck(motion) if kind == "stribeck" else correlated_noise(motion, 100 + seed)
        results.append(fit_parameters(Samples([Simulated(motion, added)], MODEL)))
    return results


def normalised_differences(results, deviations):
    """Differences of all pairs of fits over the root of the sum of both variances."""
    return np.concatenate([
        ((a.values - b.values) / np.hypot(deviations(a), deviations(b)))[a.seen & b.seen]
        for a, b in itertools.combinations(results, 2)
    ])  # fmt: skip


def white_deviations(fit):
    return np.sqrt(np.square(fit.directions).sum(axis=1) / fit.white_share)


@pytest.mark.parametrize("kind", ["stribeck", "correlated"])
def test_deviations_hold_for_model_error_and_correlated_noise(kind):
    z = normalised_differences(fits(kind), lambda fit: fit.standard_deviations)
    white = normalised_differences(fits(kind), white_deviations)
    rms, white_rms = (np.sqrt(np.square(values).mean()) for values in (z, white))
    covered = np.mean(np.abs(z) < 1.96)
    print(f"{kind}: RMS {rms:.2f}, with white noise {white_rms:.2f}; {100 * covered:.1f} % within 95 % intervals")
    assert 0.8 < rms < 1.3 and 0.88 < covered < 0.99
    assert white_rms > 1.5


def test_repeating_a_motion_does_not_reduce_the_deviations_by_model_error():
    once = panda_motion(20.0, RATE, 0, VISCOUS, COULOMB)
    thrice = panda_motion(60.0, RATE, 0, VISCOUS, COULOMB)
    results = [fit_parameters(Samples([Simulated(motion, stribeck(motion))], MODEL)) for motion in (once, thrice)]
    assert len(results[0].blocks) == len(results[1].blocks) == 20
    seen = results[0].seen & results[1].seen
    ratio = (results[1].standard_deviations / results[0].standard_deviations)[seen]
    assert 0.85 < np.median(ratio) < 1.1


def test_block_covariance_is_the_jackknife_of_clusters():
    """Compared with fits without each cluster, a joint in a block."""
    rng = np.random.default_rng(1)
    X, y = rng.normal(size=(90, 2, 4)), rng.normal(size=(90, 2))
    blocks = [TriangularFactors.from_samples(X[k : k + 15], y[k : k + 15]) for k in range(0, 90, 15)]
    motions = MotionSummary(*(np.arange(6.0)[:, None],) * 4)
    motion_blocks = MotionBlocks(tuple(blocks), ("run",) * 6, motions, np.arange(6))
    A, b = X.reshape(-1, 4), y.ravel()
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    directions = Vt.T / s
    values = directions @ (U.T @ b)
    changes = []
    for k in range(0, 90, 15):
        for joint in range(2):
            kept = np.ones(y.shape, dtype=bool)
            kept[k : k + 15, joint] = False
            changes.append(np.linalg.lstsq(X[kept], y[kept], rcond=None)[0] - values)
    expected = 5 / 6 * np.array(changes).T @ np.array(changes)
    covariance = directions @ block_covariance(motion_blocks, np.ones(2), directions, values) @ directions.T
    assert np.allclose(covariance, expected, atol=1e-7)
    squares = np.zeros(2)
    for k in range(0, 90, 15):
        kept = np.ones(90, dtype=bool)
        kept[k : k + 15] = False
        without = np.linalg.lstsq(X[kept].reshape(-1, 4), y[kept].ravel(), rcond=None)[0]
        squares += np.square(y[~kept] - X[~kept] @ without).sum(axis=0)
    total = held_out_squares(motion_blocks, np.ones(2), directions, values).sum(axis=0)
    assert total == pytest.approx(squares, rel=1e-6)


def test_samples_at_rest_do_not_count():
    """At rest a joint holds any effort within its static friction; here it is stuck at ten times Coulomb friction."""
    motion = panda_motion(20.0, RATE, 0, VISCOUS, COULOMB)
    arrays = [array.copy() for array in motion[1:4]]
    for array, values in zip(arrays, (motion.q[400, 6], 0.0, 0.0), strict=True):
        array[400:700, 6] = values
    stopped = motion._replace(q=arrays[0], qd=arrays[1], qdd=arrays[2], efforts=motion.efforts.copy())
    stopped.efforts[400:700, 6] += 10 * COULOMB[6]
    noise = 0.1 * NOISE * np.random.default_rng(0).normal(size=motion.q.shape)
    fit = fit_parameters(Samples([Simulated(stopped, noise)], MODEL))
    quality = fit.training_quality
    assert quality.moving[6] == pytest.approx(0.7, abs=0.05) and (quality.moving[:6] > 0.99).all()
    assert quality.rms_unfiltered[6] < 0.3 * COULOMB[6]
    assert fit.values[MODEL.names.index("Fs.panda_joint7")] == pytest.approx(COULOMB[6], abs=0.05)


def test_what_a_short_motion_does_not_show_keeps_the_description():
    motion = panda_motion(2.5, RATE, 0, VISCOUS, COULOMB)
    noise = NOISE * np.random.default_rng(0).normal(size=motion.q.shape)
    fit = fit_parameters(Samples([Simulated(motion, noise)], MODEL))
    determination = judge_determination(fit)
    assert determination.verdict != "well" and determination.main_parameters
    assert not fit.seen.all() and fit.directions.shape[1] < len(fit.values)
    distance = np.abs(fit.values - fit.prior.values) / fit.prior.deviations
    assert distance.max() < 5 and (fit.standard_deviations < 2 * fit.prior.deviations).all()
    long = panda_motion(20.0, RATE, 0, VISCOUS, COULOMB)
    noise = 0.3 * NOISE * np.random.default_rng(0).normal(size=long.q.shape)
    good = fit_parameters(Samples([Simulated(long, noise)], MODEL))
    assert judge_determination(good).verdict == "well" and judge_determination(good).main_parameters == ()


def test_a_negative_rotor_inertia_is_warned_of_and_its_removal_is_tried():
    motion = panda_motion(20.0, RATE, 0, VISCOUS, COULOMB)
    added = 0.1 * NOISE * np.random.default_rng(0).normal(size=motion.q.shape)
    rotors = added.copy()
    rotors[:, 4] -= 0.3 * motion.qdd[:, 4]
    wrong = fit_parameters(Samples([Simulated(motion, rotors)], MODEL))
    warning = next(text for text in wrong.warnings if text.startswith("negative rotor inertia"))
    assert "Ia.panda_joint5" in warning and "--no-rotor-inertia" in warning
    (alternative,) = try_alternatives(wrong)
    assert alternative.option == "--no-rotor-inertia" and alternative.change > 0.5 and not alternative.is_better
    right = fit_parameters(Samples([Simulated(motion, added)], MODEL))
    assert not any("negative" in text for text in right.warnings)
    reference = fit_parameters(
        Samples([Simulated(motion, added)],
                build_identification_model(MODEL.dynamics, MODEL.drives, rotor_inertia=False))
    )  # fmt: skip
    (alternative,) = try_alternatives(right)
    assert alternative.held_out_rms == pytest.approx(reference.held_out_rms, rel=0.02)
    assert alternative.change < 0.01


def joint_scatter(X, y):
    """Covariance between joints of a fit to columns X (N, n, P) and efforts y (N, n), in orthonormal directions."""
    P = X.shape[-1]
    Q, R = np.linalg.qr(X.reshape(-1, P))
    directions = np.linalg.inv(R)
    values = directions @ (Q.T @ y.ravel())
    return joint_covariance(TriangularFactors.from_samples(X, y), np.ones(X.shape[1]), directions, values)


def test_scatter_between_joints_is_unbiased_for_white_noise():
    """Also in a direction that one joint determines nearly alone; the covariance of the directions is 1."""
    rng = np.random.default_rng(0)
    X = rng.normal(size=(30, 5, 4))
    X[:, 1:, 3] *= 0.05
    mean = np.mean([joint_scatter(X, rng.normal(size=(30, 5))) for _ in range(1500)], axis=0)
    assert mean == pytest.approx(np.eye(4), abs=0.15)


def test_scatter_between_joints_shows_a_wrong_gain():
    """Efforts of one joint are 5 % too small: an error of the parameters that its seconds do not show."""
    rng = np.random.default_rng(1)
    X = rng.normal(size=(200, 5, 2))
    y = X @ np.array([3.0, -2.0])
    y[:, 2] *= 0.95
    R = np.linalg.qr(X.reshape(-1, 2), mode="r")
    error = R @ (np.linalg.lstsq(X.reshape(-1, 2), y.ravel(), rcond=None)[0] - [3.0, -2.0])
    deviation = np.sqrt(np.trace(joint_scatter(X, y)))
    assert 0.5 * np.linalg.norm(error) < deviation < 2 * np.linalg.norm(error)
