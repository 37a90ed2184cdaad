"""What noise of the encoders does to an identified Panda: velocities and accelerations are derivatives of noisy
positions, so that columns are noisy too, and least squares is no longer right in the mean (errors in variables).

The bias is the mean of what the same noise of efforts leads to with noise of positions, less what it leads to without:
that is right in the mean (`test_fitting`), and its scatter goes out. In units of the standard deviations that are told.
"""

import os
from functools import cache

import numpy as np
import pytest
from peers.known_panda import COULOMB, NOISE, VISCOUS, truth
from peers.recorded import JOINTS, panda_motion

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.identification.fitting import fit_parameters
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.alignment import SignalSegment
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.joint_motions import filter_motions

RUNS = int(os.environ.get("NOISY_RUNS", "5"))
RATE = 100.0
SMALL, LARGE = 1e-4, 1e-3  # [rad] standard deviation of each position
DRIVES = direct_drives(JOINTS)
COLUMNS = build_identification_model(Dynamics(load_robot("panda")), DRIVES)


class Encoders:
    """A recording of positions and efforts, as encoders and drives tell them."""

    name, notes = "encoders", ()

    def __init__(self, motion, seed, noise):
        of_efforts, of_positions = np.random.default_rng(seed).normal(size=(2, *motion.q.shape))
        q, efforts = motion.q + noise * of_positions, motion.efforts + NOISE * of_efforts
        self.stretch = SignalSegment(0.0, RATE, q, np.full_like(q, np.nan), efforts, False)

    def motions(self, statistics, *, cutoff=None):
        return filter_motions([self.stretch], DRIVES, statistics, cutoff)


@cache
def fits(noise, cutoff, speed):
    """The Fits of all runs: standard deviation of positions [rad], cut-off [Hz], how many times the usual speed."""
    motion = panda_motion(40.0, RATE, viscous=VISCOUS, coulomb=COULOMB, speed=speed)
    return [fit_parameters(Samples([Encoders(motion, seed, noise)], COLUMNS, cutoff=cutoff)) for seed in range(RUNS)]


def bias(noise, cutoff=8.0, speed=1.0):
    """(P,) bias in deviations and its standard error, and the part of 95 % intervals that cover the truth."""
    noisy, clean = fits(noise, cutoff, speed), fits(0.0, cutoff, speed)
    standard_deviations = np.mean([fit.standard_deviations for fit in noisy], axis=0)
    moved = np.array([fit.values - other.values for fit, other in zip(noisy, clean, strict=True)]) / standard_deviations
    covered = np.mean([np.abs(fit.values - truth(COLUMNS)) < 1.96 * fit.standard_deviations for fit in noisy])
    mean, error = moved.mean(axis=0), moved.std(axis=0, ddof=1) / np.sqrt(RUNS)
    worst = np.argsort(-np.abs(mean))[:3]
    told = ", ".join(f"{COLUMNS.names[k]} {mean[k]:+.2f} ± {error[k]:.2f}" for k in worst)
    print(f"{RUNS} runs, {noise:g} rad, {cutoff:g} Hz, speed {speed:g}: bias RMS {np.sqrt((mean**2).mean()):.2f}, "
          f"{told}; covered {100 * covered:.1f} %")  # fmt: skip
    return mean, error, covered


def test_encoders_of_a_tenth_of_a_milliradian_bias_less_than_a_deviation():
    mean, _, covered = bias(SMALL)
    assert np.abs(mean).max() < 0.7 and 0.90 < covered < 0.99


def test_encoders_of_a_milliradian_bias_by_many_deviations():
    """Not by chance, and first of all inertias about the axes of the joints, which look smaller than they are."""
    mean, error, covered = bias(LARGE)
    assert np.abs(mean).max() > 8 and np.abs(mean / error).max() > 10 and covered < 0.8
    shrunk = [COLUMNS.names.index(f"ZZ.panda_link{number}") for number in (2, 3, 4)]
    assert (mean[shrunk] < -5).all() and (mean[shrunk] + 4 * error[shrunk] < 0).all()
    assert COLUMNS.names[np.abs(mean).argmax()].startswith("ZZ.")


def test_bias_grows_with_the_square_of_the_noise():
    """As variances of noisy columns do; in parameters, not in deviations, which residuals make larger too."""
    moved = [np.mean([fit.values - other.values for fit, other in
                      zip(fits(noise, 8.0, 1.0), fits(0.0, 8.0, 1.0), strict=True)], axis=0)
             [COLUMNS.names.index("ZZ.panda_link4")] for noise in (SMALL, 3 * SMALL)]  # fmt: skip
    assert moved[1] / moved[0] == pytest.approx(9, rel=0.5)


@pytest.mark.parametrize(("cutoff", "speed", "most"), [(4.0, 1.0, 2.5), (8.0, 2.0, 6.0), (4.0, 2.0, 1.0)])
def test_a_lower_cutoff_and_faster_motions_take_the_bias_away(cutoff, speed, most):
    assert np.abs(bias(LARGE, cutoff, speed)[0]).max() < most


def test_half_the_cutoff_tells_who_is_biased():
    """A recording shows it without a known truth: parameters then move by more than two deviations, or do not."""
    moved = {noise: np.mean([np.abs(fit.values - other.values) > 2 * other.standard_deviations for fit, other in
                             zip(fits(noise, 8.0, 1.0), fits(noise, 4.0, 1.0), strict=True)])
             for noise in (SMALL, LARGE)}  # fmt: skip
    print(f"with half the cut-off {100 * moved[SMALL]:.1f} % of parameters move, biased {100 * moved[LARGE]:.1f} %")
    assert moved[SMALL] < 0.05 and moved[LARGE] > 0.2
