"""Points of joint trajectories as messages: their fields for `joint_values`, and the points of a response."""

from __future__ import annotations

from array import array
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import to_float_array

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

LOCATION = "points[{}]"  # of a point in a message, for errors


class PointFields:
    """The fields of points of a JointTrajectory.

    Parameters
    ----------
    points : sequence of JointTrajectoryPoint
    location : format of the number of a point in errors.
    first : number of the first point.
    """

    def __init__(self, points: Sequence[JointTrajectoryPoint], location: str = LOCATION, first: int = 0) -> None:
        self._points = points
        self._location = location
        self._first = first

    def read(self, field: str, size: int, optional: bool = False) -> Array:
        """Return values (N, size) of a field. Raises InvalidInputError if a point has another number of values.

        optional: whether the error says that the field may be empty.
        """
        columns = [getattr(point, field) for point in self._points]
        if set(map(len, columns)) - {size}:
            number, column = next((k, values) for k, values in enumerate(columns) if len(values) != size)
            none = ", or none" if optional else ""
            raise InvalidInputError(
                f"{self.locate(field, number)} has {len(column)} values: {size} are needed, one for each joint{none}"
            )
        return np.frombuffer(b"".join(columns)).reshape(len(columns), size)

    def is_empty(self, field: str) -> bool:
        """Return whether no point has values of a field."""
        return not any(len(getattr(point, field)) for point in self._points)

    def require_empty(self, field: str, reason: str) -> None:
        """Raise InvalidInputError with a reason if a point has values of a field."""
        for number, point in enumerate(self._points):
            if len(getattr(point, field)):
                raise InvalidInputError(f"{self.locate(field, number)} has values: {reason}, leave it empty")

    def locate(self, field: str, point: int, joint: int | None = None) -> str:
        """Return the place of a point, or of a joint in it, for errors."""
        column = "" if joint is None else f"[{joint}]"
        return f"{self._location.format(self._first + point)}.{field}{column}"


def write_points(points: Sequence[JointTrajectoryPoint], values: Mapping[str, Array]) -> None:
    """Complete points of a request, which become those of the response.

    values: (N, joints) of each field, in the order of the response. A field that has these values already is kept: the
    construction of points takes most of the time of a response.
    """
    for field, rows in values.items():
        size = rows.shape[1]
        flat = to_float_array(rows)
        present: list[array[float]] = [getattr(point, field) for point in points]
        if b"".join(present) == flat.tobytes() and not set(map(len, present)) - {size}:
            continue
        for k, point in enumerate(points):
            setattr(point, field, flat[k * size : (k + 1) * size])
