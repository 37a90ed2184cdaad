"""References out of trajectory_msgs/JointTrajectory: times and points in the order of the controlled joints."""

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.geometry import require_empty, to_nanoseconds
from robot_dynamics.nodes.codecs.joint_order import resolve_name

FIELDS = ("positions", "velocities", "accelerations")


def read_reference(message, joints, namespace):
    """(times (N,) [s] from the start, points (3, N, joints) with nan where they do not tell) of a JointTrajectory.

    joints: names of those that are controlled: all of them must be named, in any order, and no others. Raises
    QuestionError.
    """
    named = [resolve_name("joint", name, joints, namespace) for name in message.joint_names]
    missing = [name for name in joints if name not in named]
    if len(named) != len(joints) or missing:
        what = f"joints missing: {', '.join(map(repr, missing))}" if missing else "a joint is named more than once"
        raise InvalidInputError(f"{what}. All joints that are controlled must be named, each once")
    order = [named.index(name) for name in joints]
    points = message.points
    for number, point in enumerate(points):
        require_empty(point, "effort", f"points[{number}]", "efforts are what this node computes")
    values = np.stack([_field(points, field, len(joints)) for field in FIELDS])
    times = np.array([to_nanoseconds(point.time_from_start) for point in points]) * 1e-9
    return times, values[:, :, order]


def _field(points, field, size):
    """(N, size) of a field, rows of nan where a point does not tell it."""
    columns = [getattr(point, field) for point in points]
    lengths = np.array([len(column) for column in columns])
    told = lengths > 0 if field != "positions" else np.ones(len(points), dtype=bool)
    uneven = np.flatnonzero(told & (lengths != size))
    if len(uneven):
        found = f"points[{uneven[0]}].{field} has {lengths[uneven[0]]} values"
        raise InvalidInputError(f"{found}: {size} are needed, one for each joint")
    values = np.full((len(points), size), np.nan)
    values[told] = np.array([column for column in columns if len(column)]).reshape(-1, size)
    wrong = np.flatnonzero(told & ~np.isfinite(values).all(axis=1))
    if len(wrong):
        raise InvalidInputError(f"points[{wrong[0]}].{field} is not finite")
    return values


def read_reference_point(message, joints, namespace):
    """(3, joints) of a JointTrajectory with one point: zero where it tells no velocity or acceleration.

    Raises QuestionError.
    """
    _, values = read_reference(message, joints, namespace)
    if values.shape[1] != 1:
        raise InvalidInputError(
            f"{values.shape[1]} points came: one at a time is right here, a trajectory goes to reference"
        )
    return np.nan_to_num(values[:, 0])
