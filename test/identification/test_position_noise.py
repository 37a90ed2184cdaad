"""Effect of encoder noise on an identified Panda: velocities and accelerations are derivatives of noisy positions, so
that the columns are noisy too, and least squares is biased (errors in variables).

The bias is the mean difference between fits with and without position noise, with the same noise of the efforts. The
fits without position noise are unbiased (`test_fitting`). The unit is the estimated standard deviation.
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
MODEL = build_identification_model(Dynamics(load_robot("panda")), DRIVES)


class Encoders:
    """A recording of noisy positions and efforts."""

    name, notes = "encoders", ()

    def __init__(self, motion, seed, noise):
        effort_noise, position_noise = np.random.default_rng(seed).normal(size=(2, *motion.q.shape))
        q, efforts = motion.q + noise * position_noise, motion.efforts + NOISE * effort_noise
        self.segment = SignalSegment(0.0, RATE, q, np.full_like(q, np.nan), efforts, False)

    source = part = message_count = None
    time_range = (-np.inf, np.inf)

    def motions(self, statistics, *, cutoff=None):
        return filter_motions([self.segment], DRIVES, statistics, cutoff)


@cache
def fits(noise, cutoff, speed):
    """Fits of all runs; noise: standard deviation of positions [rad]; cutoff [Hz]; speed: factor."""
    motion = panda_motion(40.0, RATE, viscous=VISCOUS, coulomb=COULOMB, speed=speed)
    return [fit_parameters(Samples([Encoders(motion, seed, noise)], MODEL, cutoff=cutoff)) for seed in range(RUNS)]


def bias(noise, cutoff=8.0, speed=1.0):
    """Bias (P,) in standard deviations, its standard error, and the fraction of 95 % intervals that cover the truth."""
    noisy, clean = fits(noise, cutoff, speed), fits(0.0, cutoff, speed)
    standard_deviations = np.mean([fit.standard_deviations for fit in noisy], axis=0)
    shifts = (
        np.array([fit.values - reference.values for fit, reference in zip(noisy, clean, strict=True)])
        / standard_deviations
    )
    covered = np.mean([np.abs(fit.values - truth(MODEL)) < 1.96 * fit.standard_deviations for fit in noisy])
    mean, error = shifts.mean(axis=0), shifts.std(axis=0, ddof=1) / np.sqrt(RUNS)
    worst = np.argsort(-np.abs(mean))[:3]
    largest = ", ".join(f"{MODEL.names[k]} {mean[k]:+.2f} ± {error[k]:.2f}" for k in worst)
    print(f"{RUNS} runs, {noise:g} rad, {cutoff:g} Hz, speed {speed:g}: bias RMS {np.sqrt((mean**2).mean()):.2f}, "
          f"{largest}; covered {100 * covered:.1f} %")  # fmt: skip
    return mean, error, covered


@pytest.mark.slow
def test_bias_from_noise_of_a_tenth_of_a_milliradian_is_below_a_deviation():
    mean, _, covered = bias(SMALL)
    assert np.abs(mean).max() < 0.7 and 0.90 < covered < 0.99


def test_bias_from_noise_of_a_milliradian_is_many_deviations():
    """The bias is significant; inertias about joint axes are underestimated."""
    mean, error, covered = bias(LARGE)
    assert np.abs(mean).max() > 6 and np.abs(mean / error).max() > 10 and covered < 0.85
    shrunk = [MODEL.names.index(f"ZZ.panda_link{number}") for number in (2, 3, 4)]
    assert (mean[shrunk] < -4).all() and (mean[shrunk] + 4 * error[shrunk] < 0).all()


def test_bias_grows_with_the_square_of_the_noise():
    """So do the variances of noisy columns. The bias is not divided by deviations, which depend on the noise."""
    shifts = [np.mean([fit.values - reference.values for fit, reference in
                      zip(fits(noise, 8.0, 1.0), fits(0.0, 8.0, 1.0), strict=True)], axis=0)
             [MODEL.names.index("ZZ.panda_link4")] for noise in (SMALL, 3 * SMALL)]  # fmt: skip
    assert shifts[1] / shifts[0] == pytest.approx(9, rel=0.5)


@pytest.mark.slow
@pytest.mark.parametrize(("cutoff", "speed", "most"), [(4.0, 1.0, 2.5), (8.0, 2.0, 6.0), (4.0, 2.0, 1.0)])
def test_bias_decreases_with_a_lower_cutoff_and_faster_motions(cutoff, speed, most):
    assert np.abs(bias(LARGE, cutoff, speed)[0]).max() < most


@pytest.mark.slow
def test_halving_the_cutoff_reveals_bias():
    """Biased parameters change by more than two standard deviations, which needs no known truth."""
    shifted = {noise: np.mean([np.abs(fit.values - reference.values) > 2 * reference.standard_deviations
                             for fit, reference in zip(fits(noise, 8.0, 1.0), fits(noise, 4.0, 1.0), strict=True)])
             for noise in (SMALL, LARGE)}  # fmt: skip
    print(f"with half the cut-off {100 * shifted[SMALL]:.1f} % of parameters move, biased {100 * shifted[LARGE]:.1f} %")
    assert shifted[SMALL] < 0.05 and shifted[LARGE] > 0.2
