"""An analysis of recordings that shares no code with this project: NumPy, SciPy and Pinocchio.

Signals are interpolated on a uniform grid where their stamps are uneven, and filtered without delay (Butterworth of
order 4, forward and backward). Accelerations are gradients of filtered velocities. Inertial parameters, rotor inertias,
friction (viscous, Coulomb) and offsets are fitted by least squares with one weight for each joint.
"""

from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import butter, filtfilt

UNEVEN = 0.02  # [mean steps] deviation of stamps from a uniform grid, beyond which signals are interpolated


class Signals(NamedTuple):
    """times (N,) [s]; q, qd, efforts (N, n)."""

    times: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    efforts: np.ndarray


class FilteredMotion(NamedTuple):
    """times (N,) [s]; q, qd, qdd, efforts (N, n), filtered."""

    times: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    efforts: np.ndarray


def read_bag(path, joints):
    """Return the Signals of joints in a bag. Skip the test where `rosbags` is not installed."""
    pytest.importorskip("rosbags", reason="rosbags, which reads bags, is not installed")
    from rosbags.rosbag2 import Reader
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_JAZZY)
    rows = []
    with Reader(path) as reader:
        for connection, _, data in reader.messages():
            if connection.msgtype != "sensor_msgs/msg/JointState":
                continue
            message = store.deserialize_cdr(data, connection.msgtype)
            columns = [message.name.index(joint) for joint in joints]
            time = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
            rows.append([time, *message.position[columns], *message.velocity[columns], *message.effort[columns]])
    return _signals(np.array(rows), len(joints))


def read_table(path, joints):
    """Return the Signals of joints in a CSV file of this project's form; velocities are nan where it has none."""
    with open(path) as file:
        names = file.readline().strip().split(",")
    rows = np.loadtxt(path, delimiter=",", skiprows=1)
    values = [rows[:, names.index("time")]]
    for signal in ("position", "velocity", "effort"):
        columns = [f"{joint}.{signal}" for joint in joints]
        values += [
            rows[:, names.index(column)] if column in names else np.full(len(rows), np.nan) for column in columns
        ]
    return _signals(np.stack(values, axis=1), len(joints))


def _signals(rows, n):
    """Return the Signals of rows (N, 1 + 3 n); late, repeated and impossible stamps are left out."""
    times = rows[:, 0] - rows[0, 0]
    later = np.r_[True, times[1:] > np.maximum.accumulate(times)[:-1]] & (np.abs(times) < 1e6)
    return Signals(times[later], *(rows[later, 1 + k * n : 1 + (k + 1) * n] for k in range(3)))


def analyse_signals(signals, cutoff, measured_velocities=True):
    """Return the FilteredMotion of Signals on a grid with their mean rate; cutoff [Hz]."""
    times, *values = signals
    step = (times[-1] - times[0]) / (len(times) - 1)
    grid = times[0] + step * np.arange(int(np.floor((times[-1] - times[0]) / step + 1e-6)) + 1)
    if len(grid) != len(times) or np.abs(grid - times).max() > UNEVEN * step:
        values = [CubicSpline(times, np.nan_to_num(columns))(grid) for columns in values]
    q, qd, efforts = values
    if not measured_velocities:
        qd = np.gradient(q, step, axis=0)
    b, a = butter(4, cutoff, fs=1 / step)
    pad = min(len(q) - 1, int(1 / (cutoff * step)))
    q, qd, efforts = (filtfilt(b, a, columns, axis=0, padlen=pad) for columns in (q, qd, efforts))
    return FilteredMotion(grid, q, qd, np.gradient(qd, step, axis=0), efforts)


def regressor(model, q, qd, qdd):
    """Columns (N, n, 10 n + 4 n): inertial parameters, rotor inertia, viscous and Coulomb friction, offset."""
    data = model.createData()
    n = model.nv
    X = np.zeros((len(q), n, 14 * n))
    joints = np.arange(n)
    for row, state in enumerate(zip(q, qd, qdd, strict=True)):
        X[row, :, : 10 * n] = pin.computeJointTorqueRegressor(model, data, *state)
    for block, column in enumerate((qdd, qd, np.sign(qd), np.ones_like(qd))):
        X[:, joints, (10 + block) * n + joints] = column
    return X


def fit_residuals(model, motion, stride=1):
    """RMS (n,) of measured minus fitted efforts, with one weight for each joint; every `stride`-th sample counts."""
    X = regressor(model, *(values[::stride] for values in motion[1:4]))
    y = motion.efforts[::stride]
    weights = np.ones(model.nv)
    for _ in range(3):
        A = (X / weights[:, None]).reshape(-1, X.shape[-1])
        scale = np.linalg.norm(A, axis=0)
        scale[scale == 0] = 1
        solution = np.linalg.lstsq(A / scale, (y / weights).ravel(), rcond=1e-9)[0] / scale
        weights = np.sqrt(np.mean((y - X @ solution) ** 2, axis=0))
    return weights


def prediction_residuals(model, motion, stride=1):
    """RMS (n,) of measured efforts minus those of a model without friction."""
    data = model.createData()
    states = zip(*(values[::stride] for values in motion[1:4]), strict=True)
    predicted = np.array([pin.rnea(model, data, *state) for state in states])
    return np.sqrt(np.mean((motion.efforts[::stride] - predicted) ** 2, axis=0))


def nearest_samples(motion, times):
    """Return the samples of a FilteredMotion that are nearest to times (N,) [s]."""
    step = (motion.times[-1] - motion.times[0]) / (len(motion.times) - 1)
    rows = np.clip(np.round((times - motion.times[0]) / step).astype(int), 0, len(motion.times) - 1)
    return FilteredMotion(*(values[rows] for values in motion))
