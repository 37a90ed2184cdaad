"""References out of trajectory_msgs/JointTrajectory, in the order of the controlled joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import require_empty, to_nanoseconds
from robot_dynamics.nodes.codecs.joint_order import resolve_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

FIELDS = ("positions", "velocities", "accelerations")


def read_reference(message: JointTrajectory, joints: Sequence[str], namespace: str) -> tuple[Array, Array]:
    """Return times (N,) [s] from the start and points (3, N, joints) of a JointTrajectory, nan for empty fields.

    joints: names of the controlled joints. The message must name all of them, in any order, and no others. Raises
    InvalidInputError.
    """
    order = order_joints(message.joint_names, joints, namespace)
    points = message.points
    for number, point in enumerate(points):
        require_empty(point, "effort", f"points[{number}]", "this node computes the efforts")
    values = np.stack([_read_field(points, field, len(joints)) for field in FIELDS])
    times = np.array([to_nanoseconds(point.time_from_start) for point in points]) * 1e-9
    return times, values[:, :, order]


def order_joints(message_names: Sequence[str], joints: Sequence[str], namespace: str) -> list[int]:
    """Return the index of each controlled joint in the names of a message. Raises InvalidInputError."""
    names = [resolve_name("joint", name, joints, namespace) for name in message_names]
    missing = [name for name in joints if name not in names]
    if len(names) != len(joints) or missing:
        reason = f"joints missing: {', '.join(map(repr, missing))}" if missing else "a joint is named more than once"
        raise InvalidInputError(f"{reason}. All controlled joints must be named, each once")
    return [names.index(name) for name in joints]


def _read_field(points: Sequence[JointTrajectoryPoint], field: str, size: int) -> Array:
    """Return (N, size) of a field, rows of nan where it is empty; positions may not be empty."""
    columns = [getattr(point, field) for point in points]
    lengths = np.array([len(column) for column in columns])
    has_values = lengths > 0 if field != "positions" else np.ones(len(points), dtype=bool)
    uneven = np.flatnonzero(has_values & (lengths != size))
    if len(uneven):
        raise InvalidInputError(
            f"points[{uneven[0]}].{field} has {lengths[uneven[0]]} values: {size} are needed, one for each joint"
        )
    values = np.full((len(points), size), np.nan)
    values[has_values] = np.array([column for column in columns if len(column)]).reshape(-1, size)
    invalid = np.flatnonzero(has_values & ~np.isfinite(values).all(axis=1))
    if len(invalid):
        raise InvalidInputError(f"points[{invalid[0]}].{field} is not finite")
    return values


def read_reference_point(message: JointTrajectory, joints: Sequence[str], namespace: str) -> Array:
    """Return (3, joints) of a JointTrajectory with one point; empty velocities and accelerations are zero.

    Raises InvalidInputError.
    """
    _, points = read_reference(message, joints, namespace)
    count = points.shape[1]
    if count != 1:
        raise InvalidInputError(f"{count} points came: publish one at a time here, and a trajectory on ~/reference")
    return np.nan_to_num(points[:, 0])
