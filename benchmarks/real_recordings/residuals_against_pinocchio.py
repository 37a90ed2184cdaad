"""Residuals of recordings of real robots: motions of this project beside those of an independent analysis.

Both motions enter the same regression with Pinocchio (test/peers/pinocchio_analysis.py): inertial parameters, rotor
inertias, friction and offsets, by least squares. Printed are the RMS of measured minus fitted effort of each joint, and
its ratio to that of the independent analysis: with measured velocities, and with positions only.

    python benchmarks/real_recordings/residuals_against_pinocchio.py FOLDER [--urdf ROBOT.urdf] [--cutoff 8]

A folder contains CSV files of this project's form, or bags, and `robot.urdf`.
"""

import argparse
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parents[2] / "test"))

from peers.pinocchio_analysis import analyse_signals, fit_residuals, nearest_samples, read_bag, read_table
from peers.prepared_signals import prepare_motion

from robot_dynamics.errors import RobotDynamicsError

MAX_FITTED_SAMPLES = 8000


def find_recordings(folder):
    """Return the CSV files and bags of a folder, in the order of their names."""
    bags = [path.parent for path in folder.rglob("metadata.yaml")]
    return sorted([*folder.rglob("*.csv"), *bags])


def compare(path, model, cutoff, measured_velocities):
    """Return RMS (n,) of the residuals of a recording, and their ratios (n,) to those of the independent analysis.

    Return None if velocities are not measured.
    """
    joints = list(model.names)[1:]
    signals = read_table(path, joints) if path.suffix == ".csv" else read_bag(path, joints)
    if measured_velocities and not np.isfinite(signals.qd).all():
        return None
    prepared, _ = prepare_motion(path, joints, cutoff, measured_velocities)
    expected = nearest_samples(analyse_signals(signals, cutoff, measured_velocities), prepared.times)
    stride = 1 + len(prepared.q) // MAX_FITTED_SAMPLES
    rms = fit_residuals(model, prepared, stride)
    return rms, rms / fit_residuals(model, expected, stride)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--urdf", type=Path, help="description of the robot; default: robot.urdf in the folder")
    parser.add_argument("--cutoff", type=float, default=8.0, help="cut-off frequency of the filters [Hz]")
    options = parser.parse_args()
    model = pin.buildModelFromUrdf(str(options.urdf or options.folder / "robot.urdf"))
    for path in find_recordings(options.folder):
        for velocities in (True, False):
            try:
                residuals = compare(path, model, options.cutoff, velocities)
            except (RobotDynamicsError, ValueError) as error:
                print(f"{path.name}: {error}")
                break
            if residuals is None:
                continue
            rms, ratios = residuals
            label = "measured velocities" if velocities else "positions only"
            print(f"{path.name}, {label}")
            print("  RMS  ", *(f"{value:8.3f}" for value in rms))
            print("  ratio", *(f"{value:8.3f}" for value in ratios), flush=True)


if __name__ == "__main__":
    main()
