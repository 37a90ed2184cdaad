"""A trajectory_msgs/JointTrajectory as it is serialized (CDR), read into arrays without an object for each point."""

from __future__ import annotations

import struct
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import NS_PER_SECOND
from robot_dynamics.nodes.codecs.references import order_joints

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ByteArray, IntArray

FIELDS = ("positions", "velocities", "accelerations", "effort")
HEADER_SIZE = 4  # bytes before the body, from which alignment counts
MIN_POINT_SIZE = 24  # bytes: four lengths and a duration
MAX_POINTS = 200_000
BLOCK = 500  # points: a millisecond, after which other threads go on
PAUSE = 1e-3  # [s]


@dataclass(frozen=True, eq=False)
class SerializedTrajectory:
    """Where the content of a serialized message is.

    Attributes
    ----------
    stamp : of the header [ns].
    joint_names : of the message.
    times : (N,) of the points from the start [s].
    numbers : all bytes of the body as numbers.
    lengths, offsets : (N, 4) number of values of each of FIELDS, and index of the first one in `numbers`.
    """

    stamp: int
    joint_names: list[str]
    times: Array
    numbers: Array
    lengths: IntArray
    offsets: IntArray


def read_serialized_reference(data: ByteArray, joints: Sequence[str], namespace: str) -> tuple[int, Array, Array]:
    """Return the stamp [ns], times (N,) and points (3, N, joints) of a serialized JointTrajectory.

    As `read_reference`; a thread that reads a long message often lets others go on. Raises InvalidInputError.
    """
    message = _parse(data)
    order = order_joints(message.joint_names, joints, namespace)
    count = len(message.times)
    points = np.full((3, count, len(joints)), np.nan)
    for block in _blocks(count):
        _check_lengths(message.lengths[block], len(joints), block.start)
        for k in range(3):
            rows = np.flatnonzero(message.lengths[block, k])
            indices = message.offsets[block, k][rows, None] + np.array(order)
            values = message.numbers[indices]
            invalid = np.flatnonzero(~np.isfinite(values).all(axis=1))
            if len(invalid):
                raise InvalidInputError(f"points[{block.start + rows[invalid[0]]}].{FIELDS[k]} is not finite")
            points[k, block.start + rows] = values
    return message.stamp, message.times, points


def _blocks(count: int) -> Iterator[slice]:
    """Yield the ranges of some points each, and pause between them."""
    for start in range(0, count, BLOCK):
        if start:
            time.sleep(PAUSE)
        yield slice(start, min(start + BLOCK, count))


def _check_lengths(lengths: IntArray, size: int, first: int) -> None:
    """Refuse points whose fields do not have a value for each joint. first: number of the first point."""
    efforts = np.flatnonzero(lengths[:, 3])
    if len(efforts):
        raise InvalidInputError(
            f"points[{first + efforts[0]}].effort has values: this node computes the efforts, leave it empty"
        )
    for k, field in enumerate(FIELDS[:3]):
        uneven = np.flatnonzero((lengths[:, k] != size) & ((lengths[:, k] > 0) | (field == "positions")))
        if len(uneven):
            raise InvalidInputError(
                f"points[{first + uneven[0]}].{field} has {lengths[uneven[0], k]} values: {size} are needed, one for "
                "each joint"
            )


def _parse(data: ByteArray) -> SerializedTrajectory:
    try:
        return _parse_body(data)
    except (struct.error, IndexError, UnicodeDecodeError) as error:
        raise InvalidInputError(f"the message is not a trajectory_msgs/JointTrajectory: {error}") from None


def _parse_body(data: ByteArray) -> SerializedTrajectory:
    if bytes(data[:2]) not in (b"\0\0", b"\0\1"):
        raise InvalidInputError(f"the message is serialized in a form ({bytes(data[:2]).hex()}) other than CDR")
    order = "<" if data[1] else ">"
    body = data[HEADER_SIZE:].data
    length_at = struct.Struct(f"{order}I").unpack_from
    duration_at = struct.Struct(f"{order}iI").unpack_from

    def text_at(position: int) -> tuple[str, int]:
        (size,) = length_at(body, position)
        end = position + 4 + size
        if not 0 < size <= len(body) - position - 4:
            raise InvalidInputError("the message is not a trajectory_msgs/JointTrajectory: a text is too long")
        return bytes(body[position + 4 : end - 1]).decode(), (end + 3) & ~3

    seconds, nanoseconds = duration_at(body, 0)
    _, position = text_at(8)  # frame_id
    (name_count,) = length_at(body, position)
    position += 4
    names = []
    for _ in range(name_count):
        name, position = text_at(position)
        names.append(name)
    (count,) = length_at(body, position)
    position += 4
    if count > MAX_POINTS:
        raise InvalidInputError(f"{count} points: a reference has at most {MAX_POINTS}; send parts one after another")
    if count * MIN_POINT_SIZE > len(body) - position:
        raise InvalidInputError(f"the message has {len(body)} bytes, too few for {count} points")
    times = np.empty(count)
    lengths = np.empty((count, len(FIELDS)), dtype=np.intp)
    offsets = np.empty((count, len(FIELDS)), dtype=np.intp)
    for block in _blocks(count):
        sizes, starts, seconds_from_start = [], [], []
        for _ in range(block.start, block.stop):
            for _ in FIELDS:
                (size,) = length_at(body, position)
                position += 4
                if size:
                    position = (position + 7) & ~7
                sizes.append(size)
                starts.append(position >> 3)
                position += 8 * size
            whole, rest = duration_at(body, position)
            seconds_from_start.append((whole * NS_PER_SECOND + rest) * 1e-9)
            position += 8
        lengths[block] = np.reshape(sizes, (-1, len(FIELDS)))
        offsets[block] = np.reshape(starts, (-1, len(FIELDS)))
        times[block] = seconds_from_start
    numbers = np.frombuffer(body, dtype=f"{order}f8", count=len(body) >> 3)
    return SerializedTrajectory(seconds * NS_PER_SECOND + nanoseconds, names, times, numbers, lengths, offsets)
