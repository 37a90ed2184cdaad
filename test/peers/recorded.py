"""Recordings of a Panda with known truth: a smooth motion, efforts by Pinocchio, and bags of both."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pinocchio as pin
import pytest

from robot_dynamics.model.loading import shipped_robots
from robot_dynamics.model.placement import to_scipy_rotation

JOINTS = tuple(f"panda_joint{number}" for number in range(1, 8))
MIDDLE = np.array([0.0, -0.3, 0.0, -1.9, 0.0, 1.9, 0.3])
BEGINNING = 1_600_000_000_000_000_000
# real data beside the checkout; tests that read it are skipped where it is absent
REAL_DATA = Path(__file__).parents[3] / "shared" / "data"


class Stamp(NamedTuple):
    sec: int
    nanosec: int


class Header(NamedTuple):
    stamp: Stamp
    frame_id: str = ""


class JointState(NamedTuple):
    """Fields of a sensor_msgs/msg/JointState, without the package that defines it."""

    header: Header
    name: list
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


class Motion(NamedTuple):
    """times (N,); q, qd, qdd, efforts (N, 7)."""

    times: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    efforts: np.ndarray


def panda_motion(
    duration=20.0, rate=100.0, seed=0, viscous=0.0, coulomb=0.0, model=None, start=0.0, speed=1.0, times=None
):
    """Fourier series of up to 0.5 Hz times `speed` about the middle of the joints, exact derivatives; efforts by
    Pinocchio. times: (N,) [s] of the samples, in the place of duration, rate and start."""
    rng = np.random.default_rng(seed)
    times = start + np.arange(int(duration * rate)) / rate if times is None else times
    q, qd, qdd = (np.zeros((len(times), 7)) for _ in range(3))
    q += MIDDLE
    for frequency in (0.1, 0.2, 0.35, 0.5):
        w = 2 * np.pi * frequency * speed
        amplitude, phase = rng.uniform(0.1, 0.3, 7), rng.uniform(0, 2 * np.pi, 7)
        angles = w * times[:, None] + phase
        q += amplitude * np.sin(angles)
        qd += amplitude * w * np.cos(angles)
        qdd -= amplitude * w * w * np.sin(angles)
    model = model or panda_model()
    data = model.createData()
    efforts = np.array([pin.rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
    return Motion(times, q, qd, qdd, efforts + viscous * qd + coulomb * np.sign(qd))


def uneven_times(kind, duration, rate=100.0, seed=0):
    """Return times (N,) [s] of samples from a joint state publisher without a real-time clock.

    kind: "random", steps of an exponential distribution; "pairs", of which the second is stamped 50 µs after the first
    one; "pieces", of 1 to 40 samples at uneven steps between pauses of 6 to 12 steps, of which each fifth is longer.
    """
    rng, step = np.random.default_rng(seed), 1 / rate
    if kind == "pairs":
        return (np.arange(0, duration, 2 * step)[:, None] + [0, 5e-5]).ravel()
    steps = rng.exponential(step, int(1.5 * duration * rate))
    if kind == "pieces":
        steps = step * rng.uniform(0.6, 1.4, len(steps))
        number, start = 0, 0
        while start < len(steps):
            size = 300 if number % 5 == 0 else rng.integers(1, 12)
            start, number = start + size, number + 1
            steps[start : start + 1] = step * rng.uniform(6, 40)
    times = np.cumsum(steps)
    return times[times < duration]


def panda_model():
    return pin.buildModelFromXML(shipped_robots()["panda"].read_text())


def loaded_panda(mass, centre=(0.0, 0.0, 0.1), moment=0.0):
    """Return the model of a Panda with a payload: mass [kg], centre in the last link [m], moments of inertia."""
    model = panda_model()
    model.appendBodyToJoint(7, pin.Inertia(mass, np.array(centre), moment * np.eye(3)), pin.SE3.Identity())
    return model


def message(time, names, position, velocity=(), effort=()):
    """Return a JointState, `time` [s] after BEGINNING."""
    stamp = Stamp(*divmod(BEGINNING + round(time * 1e9), 1_000_000_000))
    arrays = (np.array(values, dtype=float) for values in (position, velocity, effort))
    return JointState(Header(stamp), list(names), *arrays)


def messages(motion, names=JOINTS):
    return [
        message(*row[:1], names, *row[1:])
        for row in zip(motion.times, motion.q, motion.qd, motion.efforts, strict=True)
    ]


def write_table(path, motion, joints=JOINTS):
    """Write a motion as a CSV file, and return its path."""
    signals = np.stack([motion.q, motion.qd, motion.efforts], axis=-1).reshape(len(motion.q), -1)
    names = [f"{joint}.{signal}" for joint in joints for signal in ("position", "velocity", "effort")]
    table = np.column_stack([motion.times, signals])
    np.savetxt(path, table, delimiter=",", header=",".join(["time", *names]), comments="")
    return path


def store():
    """Return the message types of `rosbags`; skip the test where it is not installed."""
    typesys = pytest.importorskip("rosbags.typesys", reason="rosbags, which writes bags, is not installed")
    return typesys.get_typestore(typesys.Stores.ROS2_JAZZY)


def of_rosbags(message, types):
    """Return a JointState as a message of `rosbags`; other messages unchanged."""
    if not isinstance(message, JointState):
        return message
    stamp = types["builtin_interfaces/msg/Time"](*message.header.stamp)
    return types["sensor_msgs/msg/JointState"](
        types["std_msgs/msg/Header"](stamp, message.header.frame_id), *message[1:]
    )


def odometry(time, pose, twist):
    """Return an Odometry of `rosbags`: pose (4, 4) and twist (6,) of a base, `time` [s] after BEGINNING."""
    types = store().types
    kinds = {
        name: types[f"geometry_msgs/msg/{name}"]
        for name in ("Point", "Quaternion", "Pose", "PoseWithCovariance", "Vector3", "Twist", "TwistWithCovariance")
    }
    header = of_rosbags(message(time, (), ()), types).header
    turned = kinds["Quaternion"](*to_scipy_rotation(pose[:3, :3]).as_quat())
    placed = kinds["PoseWithCovariance"](kinds["Pose"](kinds["Point"](*pose[:3, 3]), turned), np.zeros(36))
    moved = kinds["Twist"](kinds["Vector3"](*twist[:3]), kinds["Vector3"](*twist[3:]))
    of_twist = kinds["TwistWithCovariance"](moved, np.zeros(36))
    return types["nav_msgs/msg/Odometry"](header, "base_body", placed, of_twist)


def write_bag(path, messages, storage="mcap", compression=None, topic="/joint_states"):
    """Write messages, or (topic, message) pairs, into a new bag, with the times of their stamps. Skip the test where
    `rosbags` is not installed."""
    types = store()
    from rosbags.rosbag2 import CompressionFormat, StoragePlugin, Writer

    pairs = [entry if type(entry) is tuple else (topic, entry) for entry in messages]
    pairs = [(name, of_rosbags(value, types.types)) for name, value in pairs]
    kinds = {name: value.__msgtype__ for name, value in pairs}
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compression is not None:
        writer.set_compression(compression, CompressionFormat.ZSTD)
    with writer:
        connections = {name: writer.add_connection(name, kind, typestore=types) for name, kind in kinds.items()}
        for number, (name, value) in enumerate(pairs):
            header = getattr(value, "header", None)
            recorded = (
                BEGINNING + number * 1_000_000
                if header is None
                else (header.stamp.sec * 1_000_000_000 + header.stamp.nanosec)
            )
            data = types.serialize_cdr(value, value.__msgtype__)
            writer.write(connections[name], recorded, data)
    return path
