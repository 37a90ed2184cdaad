"""Points of a request in flat arrays, row-major: one row for each point, or a single row that holds at every point."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import Base
from robot_dynamics.nodes.codecs.fields import require_finite
from robot_dynamics.nodes.codecs.geometry import to_matrices
from robot_dynamics.nodes.codecs.joint_order import resolve_name
from robot_dynamics.nodes.codecs.wrenches import resolve_link
from robot_dynamics_interfaces.srv import DirectDynamicsBatch, DynamicsTermsBatch, InverseDynamicsBatch

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot

FlatRequest: TypeAlias = InverseDynamicsBatch.Request | DirectDynamicsBatch.Request | DynamicsTermsBatch.Request
"""A request with flat arrays."""

POSE_SIZE = 7  # position x, y, z; quaternion x, y, z, w
TWIST_SIZE = 6
WRENCH_SIZE = 6
FIELD_NAMES = {"effort": "efforts"}  # names that differ from those of JointTrajectoryPoint


def read_rows(request: FlatRequest, field: str, columns: int, needed: str) -> Array:
    """Return (count, columns) of a field, without a copy.

    needed: what the columns are of, for errors. Raises InvalidInputError if the field has another number of values.
    """
    values: Array = np.asarray(getattr(request, field), dtype=float)
    count = request.count
    if values.size == count * columns:
        return values.reshape(count, columns)
    if values.size == columns:
        return np.broadcast_to(values, (count, columns))
    row = "1 value" if columns == 1 else f"{columns} values"
    raise InvalidInputError(
        f"{field} has {values.size} values: {count * columns} are needed, for each of {count} points a row of {row}, "
        f"{needed}; or {row} that hold at every point"
    )


class FlatFields:
    """The fields of joints at a range of the points of a request with flat arrays.

    Parameters
    ----------
    request : the message.
    names : joints of the columns.
    rows : the range.
    """

    def __init__(self, request: FlatRequest, names: Sequence[str], rows: slice) -> None:
        self._request = request
        self._names = names
        self._rows = rows

    def read(self, field: str, size: int, optional: bool = False) -> Array:
        """Return values (N, size) of a field. Raises InvalidInputError if it has another number of values.

        optional: whether the error says that the field may be empty.
        """
        needed = "one for each joint" + (", or none" if optional else "")
        return read_rows(self._request, FIELD_NAMES.get(field, field), size, needed)[self._rows]

    def is_empty(self, field: str) -> bool:
        """Return whether the field has no values."""
        return not len(getattr(self._request, FIELD_NAMES.get(field, field), ()))

    def require_empty(self, field: str, reason: str) -> None:
        """Raise InvalidInputError with a reason if the field has values."""
        if not self.is_empty(field):
            raise InvalidInputError(f"{FIELD_NAMES.get(field, field)} has values: {reason}, leave it empty")

    def locate(self, field: str, point: int, joint: int | None = None) -> str:
        """Return the place of a point, or of a joint in it, for errors."""
        name = FIELD_NAMES.get(field, field)
        number = self._rows.start + point
        if joint is None:
            return f"{name} at point {number}"
        joints = self._names
        if len(getattr(self._request, name)) == len(joints):
            return f"{name}[{joint}] (joint {joints[joint]!r})"
        return f"{name}[{number * len(joints) + joint}] (point {number}, joint {joints[joint]!r})"


class FlatLinkMotions:
    """The motion of links, of the base or of platforms, in flat arrays.

    Parameters
    ----------
    request : the message.
    links : names of the links.
    names : names of the links in the message, in the order of the columns; empty: `links`.
    namespace : of the node.

    Raises
    ------
    InvalidInputError
        The message has other links, or arrays of another length.
    """

    acceleration_location = "base_accelerations"

    def __init__(self, request: FlatRequest, links: Sequence[str], names: Sequence[str], namespace: str) -> None:
        self._links = [resolve_name("base link", name, links, namespace) for name in names] or list(links)
        if sorted(self._links) != sorted(links):
            raise InvalidInputError(
                f"base_links are {', '.join(self._links)}: each of {', '.join(links)} is needed once, or none of the "
                "names"
            )
        count = len(links)
        of_links = f"of {', '.join(self._links)}"
        pose = f"the pose {of_links}: position x, y, z and quaternion x, y, z, w"
        self._poses = read_rows(request, "base_poses", POSE_SIZE * count, pose)
        self._twists = read_rows(request, "base_twists", TWIST_SIZE * count, f"the twist {of_links}")
        self.has_acceleration = bool(getattr(request, "base_accelerations", ()))
        self._accelerations = self._twists
        if self.has_acceleration:
            needed = f"the acceleration {of_links}"
            self._accelerations = read_rows(request, "base_accelerations", TWIST_SIZE * count, needed)

    def read(self, rows: slice) -> dict[str, Base]:
        """Return {link: Base} at a range of points. Raises InvalidInputError."""
        return {link: self._read_link(link, entry, rows) for entry, link in enumerate(self._links)}

    def _read_link(self, link: str, entry: int, rows: slice) -> Base:
        place = f"of {link!r} at point {{}}"
        poses = self._poses[rows, entry * POSE_SIZE : (entry + 1) * POSE_SIZE]
        names = (f"base_poses: the position {place}", f"base_poses: the quaternion {place}")
        columns = slice(entry * TWIST_SIZE, (entry + 1) * TWIST_SIZE)
        twists = self._twists[rows, columns]
        require_finite(twists, f"base_twists {place}", rows.start)
        accelerations = None
        if self.has_acceleration:
            accelerations = self._accelerations[rows, columns]
            require_finite(accelerations, f"base_accelerations {place}", rows.start)
        return Base(to_matrices(poses[:, :3], poses[:, 3:], names, rows.start), twists, accelerations)


def read_flat_wrenches(
    request: InverseDynamicsBatch.Request | DirectDynamicsBatch.Request, robot: Robot, namespace: str
) -> dict[str, Array]:
    """Return {link name: (count, 6)} of external wrenches, (6,) where they are constant. Raises InvalidInputError."""
    names = request.wrench_links
    if not names and not request.external_wrenches:
        return {}
    needed = f"force and torque on each of {len(names)} wrench_links"
    rows = read_rows(request, "external_wrenches", WRENCH_SIZE * len(names), needed)
    if len(request.external_wrenches) == WRENCH_SIZE * len(names):
        rows = rows[0]
    wrenches: dict[str, Array] = {}
    for entry, name in enumerate(names):
        link = resolve_link(name, robot, namespace, f"wrench_links[{entry}]")
        values = rows[..., entry * WRENCH_SIZE : (entry + 1) * WRENCH_SIZE]
        require_finite(np.atleast_2d(values), f"external_wrenches on {link!r} at point {{}}")
        wrenches[link] = wrenches[link] + values if link in wrenches else values
    return wrenches
