"""Serialized trajectories: read as rclpy reads them, in any layout, and refused where they are damaged."""

import struct

import numpy as np
import pytest
from nodes.controller_probe import PANDA, trajectory_message
from rclpy.serialization import serialize_message

from robot_dynamics import InvalidInputError
from robot_dynamics.nodes.codecs.references import read_reference
from robot_dynamics.nodes.codecs.serialized_trajectories import BLOCK, MAX_POINTS, read_serialized_reference

RNG = np.random.default_rng(7)
STAMP = 1_700_000_000_123_456_789


def random_message(joints, count, frame=""):
    """A trajectory in which points have different fields."""
    points = RNG.normal(size=(3, count, len(joints)))
    times = np.cumsum(RNG.uniform(1e-3, 2.0, count))
    message = trajectory_message(joints, times, *points, start=STAMP)
    message.header.frame_id = frame
    for k, point in enumerate(message.points):
        if k % 3:
            point.accelerations = []
        if k % 5 == 4:
            point.velocities = []
    return message


def to_bytes(message):
    return np.frombuffer(serialize_message(message), dtype=np.uint8)


def read(data, joints=PANDA):
    return read_serialized_reference(data, joints, "/")


@pytest.mark.parametrize("count", [0, 1, 2, 7, 2 * BLOCK + 3])
@pytest.mark.parametrize("joints", [PANDA, PANDA[:2], PANDA[:1]], ids=len)
@pytest.mark.parametrize("frame", ["", "base", "world"])
def test_arrays_are_those_of_the_message_that_rclpy_reads(count, joints, frame):
    message = random_message(joints[::-1], count, frame)
    stamp, times, points = read(to_bytes(message), joints)
    expected_times, expected_points = read_reference(message, joints, "/")
    assert stamp == STAMP
    np.testing.assert_array_equal(times, expected_times)
    np.testing.assert_array_equal(points, expected_points.reshape(points.shape))


def serialized_by_peer(message, little_endian):
    """The bytes of a message as rosbags writes them, in one of the byte orders."""
    rosbags = pytest.importorskip("rosbags.typesys")
    store = rosbags.get_typestore(rosbags.Stores.ROS2_JAZZY)
    kinds = store.types
    stamp = kinds["builtin_interfaces/msg/Time"](message.header.stamp.sec, message.header.stamp.nanosec)
    points = [
        kinds["trajectory_msgs/msg/JointTrajectoryPoint"](
            *(np.array(values) for values in (point.positions, point.velocities, point.accelerations, point.effort)),
            kinds["builtin_interfaces/msg/Duration"](point.time_from_start.sec, point.time_from_start.nanosec),
        )
        for point in message.points
    ]
    header = kinds["std_msgs/msg/Header"](stamp, message.header.frame_id)
    trajectory = kinds["trajectory_msgs/msg/JointTrajectory"](header, message.joint_names, points)
    data = store.serialize_cdr(trajectory, "trajectory_msgs/msg/JointTrajectory", little_endian=little_endian)
    return np.frombuffer(bytes(data), dtype=np.uint8)


@pytest.mark.parametrize("little_endian", [True, False])
def test_bytes_of_another_writer_are_read_in_both_orders(little_endian):
    message = random_message(PANDA, 5, "base")
    data = serialized_by_peer(message, little_endian)
    assert data[1] == little_endian
    for value, expected in zip(read(data), read(to_bytes(message)), strict=True):
        np.testing.assert_array_equal(value, expected)


@pytest.mark.parametrize(
    ("field", "values", "reason"),
    [
        ("effort", np.zeros(7), r"points\[600\].effort has values: this node computes the efforts"),
        ("positions", [], r"points\[600\].positions has 0 values: 7 are needed"),
        ("velocities", np.zeros(3), r"points\[600\].velocities has 3 values: 7 are needed"),
        ("accelerations", [0.0] * 6 + [np.nan], r"points\[600\].accelerations is not finite"),
    ],
)
def test_invalid_points_are_named(field, values, reason):
    message = random_message(PANDA, BLOCK + 200)
    setattr(message.points[600], field, np.asarray(values, dtype=float))
    with pytest.raises(InvalidInputError, match=reason):
        read(to_bytes(message))


def test_joints_are_matched_by_name():
    with pytest.raises(InvalidInputError, match="joints missing: 'panda_joint7'"):
        read(to_bytes(random_message(PANDA[:6], 2)))


def test_damaged_messages_are_refused_and_never_end_in_another_error():
    data = serialized_by_peer(random_message(PANDA, 3, "world"), True)
    assert len(read(data)[1]) == 3
    for size in range(len(data)):
        with pytest.raises(InvalidInputError):
            read(data[:size].copy())
    for _ in range(3000):
        damaged = data.copy()
        damaged[RNG.integers(len(data), size=RNG.integers(1, 4))] = RNG.integers(256)
        try:
            read(damaged)
        except InvalidInputError:
            continue


def test_number_of_points_is_bounded_before_memory_is_taken():
    text = to_bytes(random_message(PANDA[:1], 1)).tobytes()
    start = text.index(PANDA[0].encode()) + len(PANDA[0]) + 1
    start += -(start - 4) % 4
    assert struct.unpack_from("<I", text, start) == (1,)
    for count, reason in ((MAX_POINTS + 1, f"at most {MAX_POINTS}"), (MAX_POINTS, "too few")):
        struct.pack_into("<I", damaged := bytearray(text), start, count)
        with pytest.raises(InvalidInputError, match=reason):
            read(np.frombuffer(bytes(damaged), dtype=np.uint8), PANDA[:1])
