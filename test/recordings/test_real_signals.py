"""Signals of real robots: residuals beside those of an independent analysis with Pinocchio, and with late stamps.

The recordings are beside the checkout, if present: a UR10 and a Panda (unisa-acg/inverse-dynamics-solver, BSD-3), and
tables of other robots with their sources in a README. They are not part of this repository."""

from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from peers.arrivals import arrival_stamps
from peers.pinocchio_analysis import analyse_signals, fit_residuals, nearest_samples, read_bag, read_table
from peers.prepared_signals import prepare_motion
from peers.recorded import REAL_DATA

from robot_dynamics.model.loading import shipped_robots

TABLES = Path(__file__).parents[3] / "realdata"
CUTOFF = 8.0
RECORDINGS = {  # name: path, URDF, stride of the samples in the fit
    "ur10": (REAL_DATA / "ur10" / "ur10_unisa_mcap", REAL_DATA / "ur10" / "ur10.urdf", 1),
    "ur10e_30s": (TABLES / "ur10e/identification_data/ur-20_02_10-30sec_12harm.csv", TABLES / "ur10e/robot.urdf", 1),
    "ur10e_50s": (TABLES / "ur10e/identification_data/ur-20_02_12-50sec_12harm.csv", TABLES / "ur10e/robot.urdf", 1),
    "kuka_1": (TABLES / "kuka_lwr4/measurements_1.csv", TABLES / "kuka_lwr4/robot.urdf", 1),
    "kuka_3": (TABLES / "kuka_lwr4/measurements_3.csv", TABLES / "kuka_lwr4/robot.urdf", 1),
    "panda_1khz": (TABLES / "panda_1khz/exciting_traj_1.csv", TABLES / "panda_1khz/robot.urdf", 5),
    "xmate": (TABLES / "xmate7p/1kHz_5p_traj1.csv", TABLES / "xmate7p/robot.urdf", 2),
}


@cache
def load(name):
    """(path, model, joints, Signals, stride) of a recording; skip where it is absent."""
    path, urdf, stride = RECORDINGS[name]
    if not path.exists():
        pytest.skip(f"no recording {path}")
    model = pin.buildModelFromUrdf(str(urdf))
    joints = list(model.names)[1:]
    signals = read_table(path, joints) if path.suffix == ".csv" else read_bag(path, joints)
    return path, model, joints, signals, stride


@pytest.mark.slow
@pytest.mark.parametrize("measured_velocities", [True, False])
@pytest.mark.parametrize("name", RECORDINGS)
def test_residuals_are_those_of_the_independent_analysis(name, measured_velocities):
    """The same regression of both signals, at the same times."""
    path, model, joints, signals, stride = load(name)
    if measured_velocities and np.isnan(signals.qd).any():
        pytest.skip("no velocities are recorded")
    prepared, _ = prepare_motion(path, joints, CUTOFF, measured_velocities)
    expected = analyse_signals(signals, CUTOFF, measured_velocities)
    expected = nearest_samples(expected, prepared.times)
    ratios = fit_residuals(model, prepared, stride) / fit_residuals(model, expected, stride)
    assert (ratios < 1.03).all()
    assert (ratios > 0.97).all()


@pytest.mark.slow
def test_positions_of_a_panda_alone_have_the_residuals_of_measured_velocities():
    """30 messages per second, one in 50 of which repeats the values before it: with their stamps as times the residuals
    would be those of the independent analysis, 1.2 to 2 times as large in the first four joints."""
    path = REAL_DATA / "panda" / "panda_unisa_mcap"
    if not path.exists():
        pytest.skip(f"no recording {path}")
    model = pin.buildModelFromXML(shipped_robots()["panda"].read_text())
    joints = list(model.names)[1:]
    by_positions = fit_residuals(model, prepare_motion(path, joints, None, measured_velocities=False)[0])
    by_velocities = fit_residuals(model, prepare_motion(path, joints, None)[0])
    assert (by_positions < 1.03 * by_velocities).all()
    stamps_as_times = fit_residuals(model, analyse_signals(read_bag(path, joints), 5.88, False))
    assert (stamps_as_times[:4] > 1.2 * by_positions[:4]).all()
    # the reference fit of shared/data, with measured velocities
    assert (by_positions < 1.1 * np.array([0.28, 0.17, 0.22, 0.28, 0.10, 0.08, 0.06])).all()


@pytest.mark.slow
@pytest.mark.parametrize("measured_velocities", [True, False])
@pytest.mark.parametrize("kind", ["bursts", "stalls", "delays", "two_sided"])
@pytest.mark.parametrize("name", ["ur10", "xmate"])
def test_late_stamps_leave_residuals_as_they_are(name, kind, measured_velocities):
    path, model, joints, signals, stride = load(name)
    expected, _ = prepare_motion(path, joints, CUTOFF, measured_velocities)
    stamps = arrival_stamps(signals.times, kind)
    late, statistics = prepare_motion(path, joints, CUTOFF, measured_velocities, stamps)
    assert len(late.q) > 0.95 * len(expected.q) and statistics.counts["gaps"] == 0
    assert statistics.sampling_times
    ratios = fit_residuals(model, late, stride) / fit_residuals(model, expected, stride)
    assert (ratios < 1.05).all() and (ratios > 0.95).all()
