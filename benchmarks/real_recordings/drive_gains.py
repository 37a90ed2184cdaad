"""Drive gains of a real UR10e by several methods, beside those that its controller uses.

The recordings are those of shamilmamedov/dynamic_calibration: currents without a load and with one of known mass. They
also contain the currents and the torques that the controller computes. Their regression gives its gains: currents are
torques divided by gains, plus a curve of friction over velocity. So the gains are known independently of any load.

The least squares of the literature are computed with numpy and Pinocchio, with filters and rows of the authors.

    python benchmarks/real_recordings/drive_gains.py CHECKOUT

CHECKOUT is a checkout of github.com/shamilmamedov/dynamic_calibration.
"""

import argparse
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from scipy.linalg import qr
from scipy.signal import butter, filtfilt

sys.path.insert(0, str(Path(__file__).parents[2] / "test"))

from peers.linear_gains import ordinary_least_squares_gains, total_least_squares_gains

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.identification.drive_gains import Payload, PayloadIdentificationModel, identify_gains
from robot_dynamics.identification.identification_model import build_identification_model
from robot_dynamics.identification.samples import Samples
from robot_dynamics.recordings.drives import direct_drives
from robot_dynamics.recordings.recording import open_recording

COLUMNS = 31  # time, then positions, velocities, currents, computed currents and computed torques of 6 joints
LINK = "tool0"


class Pair(NamedTuple):
    """Recordings without and with a load [kg], with first and last row, counted from 1, as in the authors' scripts."""

    unloaded: str
    unloaded_rows: tuple[int, int]
    loaded: str
    loaded_rows: tuple[int, int]
    mass: float


PAIRS = {
    "14 harmonics": Pair("ur-20_02_19_14harm50sec", (195, 4966), "ur-20_02_19_14harm50secLoad", (308, 5071), 2.805),
    "15 harmonics": Pair("ur-20_02_19_15harm50sec", (100, 5300), "ur-20_02_19_15harm50secLoad", (100, 6050), 2.805),
    "31 January": Pair("ur-20_01_31-unload", (300, 2623), "ur-20_01_31-load", (370, 2881), 2.805),
    "13 January": Pair("ur-20_02_10-30sec_12harm", (635, 3510), "ur-20_01_13-load_2600", (250, 2274), 2.602),
}
AUTHORS = "14 harmonics"  # the pair of estimate_drive_gains.m
COMMENT = np.array([14.87, 13.26, 11.13, 10.62, 11.03, 11.47])  # main.m, from the literature: not of this robot
CONSTRAINED = np.array([10.0, 10.6956, 8.4566, 9.0029, 9.48, 10.1232])  # UR10E_parameters.txt; joint 1 is at its bound


class Signals(NamedTuple):
    """times (N,) [s]; q, qd, currents, computed_currents, computed_torques (N, 6)."""

    times: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    currents: np.ndarray
    computed_currents: np.ndarray
    computed_torques: np.ndarray


def read_signals(folder, name, rows):
    """Read the rows of a recording."""
    lines = (folder / f"{name}.csv").read_text().splitlines()[rows[0] - 1 : rows[1]]
    values = np.array([[float(cell) for cell in line.split(",")] for line in lines if line.count(",") == COLUMNS - 1])
    return Signals(values[:, 0] - values[0, 0], *np.split(values[:, 1:], 5, axis=1))


def controller_gains(signals):
    """Gains (6,) with which the controller computes currents, and residuals (6,) relative to the spread of currents."""
    gains, errors = np.zeros(6), np.zeros(6)
    for joint in range(6):
        moving = np.abs(signals.qd[:, joint]) > 0.05
        v, current = signals.qd[moving, joint], signals.computed_currents[moving, joint]
        curve = [np.sign(v), v, v * np.abs(v), v**3, np.sign(v) * np.exp(-np.abs(v) / 0.1), np.ones_like(v)]
        columns = np.column_stack([signals.computed_torques[moving, joint], *curve])
        values = np.linalg.lstsq(columns, current, rcond=None)[0]
        gains[joint] = 1 / values[0]
        errors[joint] = np.std(current - columns @ values) / np.std(current)
    return gains, errors


def linear_equations(pair, folder, model):
    """Currents (N, 6), columns (N, 6, P) and efforts of the known mass (N, 6) of a pair, filtered as by the authors."""
    data = model.createData()
    base = _base_columns(model, data)
    parts = []
    for name, rows, is_loaded in ((pair.unloaded, pair.unloaded_rows, 0.0), (pair.loaded, pair.loaded_rows, 1.0)):
        signals = read_signals(folder, name, rows)
        qd = filtfilt(*butter(5, 0.15), signals.qd, axis=0)
        qdd = np.zeros_like(qd)
        qdd[1:-1] = (qd[2:] - qd[:-2]) / (signals.times[2:] - signals.times[:-2])[:, None]
        qdd = filtfilt(*butter(5, 0.15), qdd, axis=0)
        full = _regressor(model, data, signals.q, qd, qdd)
        friction = np.concatenate([column[..., None] * np.eye(6) for column in (qd, np.sign(qd), np.ones_like(qd))], -1)
        load = full[..., 50:60] * is_loaded  # of the last link: mass, first moments, inertia
        currents = filtfilt(*butter(5, 0.2), signals.currents, axis=0)
        parts.append(
            (currents, np.concatenate([full[..., base], friction, load[..., 1:]], -1), load[..., 0] * pair.mass)
        )
    return [np.concatenate(arrays) for arrays in zip(*parts, strict=True)]


def _regressor(model, data, q, qd, qdd):
    """Columns (N, 6, 66) of the inertial parameters and the rotor inertias."""
    bodies = np.array([pin.computeJointTorqueRegressor(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
    return np.concatenate([bodies, qdd[..., None] * np.eye(6)], axis=-1)


def _base_columns(model, data):
    """Numbers of independent columns of the regressor."""
    q, qd, qdd = np.random.default_rng(0).uniform(-3, 3, (3, 40, 6))
    matrix = _regressor(model, data, q, qd, 2 * qdd).reshape(-1, 66)
    return qr(matrix, mode="r", pivoting=True)[1][: np.linalg.matrix_rank(matrix)]


def identified_gains(pairs, folder, robot):
    """Gains of this project, from one or several pairs."""
    dynamics = Dynamics(load_robot(str(robot)))
    joints = dynamics.joint_names
    recordings, payloads = [], {}
    with tempfile.TemporaryDirectory() as temporary:
        for pair in pairs:
            for name, rows in ((pair.unloaded, pair.unloaded_rows), (pair.loaded, pair.loaded_rows)):
                signals = read_signals(folder, name, rows)
                values = np.stack([signals.q, signals.qd, signals.currents], axis=-1).reshape(len(signals.q), -1)
                titles = [f"{joint}.{kind}" for joint in joints for kind in ("position", "velocity", "effort")]
                path = Path(temporary) / f"{name}.csv"
                table = np.column_stack([signals.times, values])
                np.savetxt(path, table, delimiter=",", header=",".join(["time", *titles]), comments="")
                recordings.append(open_recording(path, direct_drives(joints)))
            payloads[recordings[-1].name] = Payload(LINK, pair.mass)
        model = build_identification_model(dynamics, direct_drives(joints))
        return identify_gains(Samples(recordings, PayloadIdentificationModel(model, payloads)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("checkout", type=Path)
    checkout = parser.parse_args().checkout
    folder = checkout / "dataset_ur10e/identification_data"
    robot = checkout / "URe/urdf/ur10e.urdf"
    rows = []
    by_controller = []
    for name, pair in PAIRS.items():
        gains, errors = controller_gains(read_signals(folder, pair.loaded, pair.loaded_rows))
        by_controller.append(gains)
        print(f"controller, {name:14}", *(f"{gain:8.3f}" for gain in gains), f" residuals {100 * errors.max():.1f} %")
    controller = np.mean(by_controller, axis=0)
    equations = linear_equations(PAIRS[AUTHORS], folder, pin.buildModelFromUrdf(str(robot)))
    rows += [("controller", controller, None), ("comment in main.m", COMMENT, None)]
    rows += [("ordinary least squares", ordinary_least_squares_gains(*equations), None)]
    rows += [("total least squares", total_least_squares_gains(*equations), None)]
    rows += [("UR10E_parameters.txt", CONSTRAINED, None)]
    identified = {name: identified_gains([pair], folder, robot) for name, pair in PAIRS.items()}
    identified["all"] = identified_gains(PAIRS.values(), folder, robot)
    rows += [
        (f"identify, {name}", gains.drives.effort_gains, gains.standard_deviations)
        for name, gains in identified.items()
    ]
    for title, gains, deviations in rows:
        print(f"{title:26}", *(f"{gain:8.2f}" for gain in gains))
        if deviations is not None:
            print(f"{'  deviation':26}", *(f"{deviation:8.2f}" for deviation in deviations))
            print(f"{'  against controller [%]':26}", *(f"{100 * error:8.1f}" for error in gains / controller - 1))
    names = list(PAIRS)
    normalized = [
        (identified[a].drives.effort_gains - identified[b].drives.effort_gains)
        / np.hypot(identified[a].standard_deviations, identified[b].standard_deviations)
        for i, a in enumerate(names)
        for b in names[:i]
    ]
    print(f"differences of pairs in deviations: RMS {np.sqrt(np.mean(np.square(normalized))):.2f}")


if __name__ == "__main__":
    main()
