"""The motion of a moving base, or of other links, as MultiDOFJointTrajectory and as `Base`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import TYPE_CHECKING, Protocol

import numpy as np
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import Base
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import read_poses, read_twists, write_twist
from robot_dynamics.nodes.codecs.joint_order import resolve_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot


class LinkMotions(Protocol):
    """The motion of links at the points of a request: of the base, or of platforms.

    Attributes
    ----------
    has_acceleration : whether the request has accelerations.
    acceleration_location : name of the accelerations in errors.
    """

    has_acceleration: bool
    acceleration_location: str

    def read(self, rows: slice) -> dict[str, Base]:
        """Return {link: Base} at a range of points. Raises InvalidInputError."""
        ...


class LinkTrajectories:
    """The motion of links in a MultiDOFJointTrajectory with the same points as a JointTrajectory.

    Parameters
    ----------
    base : the message.
    times : time_from_start of each point of the joint trajectory [ns].
    links : names of the links.
    namespace : of the node.
    description : name of the links in errors.
    at_rest : velocities may be left out.

    Raises
    ------
    InvalidInputError
        The message has other links or points.
    """

    acceleration_location = "base.points[0].accelerations"

    def __init__(
        self,
        base: MultiDOFJointTrajectory,
        times: Sequence[int],
        links: Sequence[str],
        namespace: str,
        description: str,
        at_rest: bool = False,
    ) -> None:
        names = [resolve_name("base link", name, links, namespace) for name in base.joint_names] or list(links)
        if sorted(names) != sorted(links):
            raise InvalidInputError(
                f"base.joint_names are {', '.join(names)}: each of {', '.join(links)} is needed once, or none of the "
                "names"
            )
        if len(base.points) != len(times):
            raise InvalidInputError(
                f"base.points has {len(base.points)} entries: {description} moves, so its pose and twist are "
                f"needed at each of {len(times)} points"
            )
        has_acceleration = [len(point.accelerations) > 0 for point in base.points]
        if any(has_acceleration) and not all(has_acceleration):
            number = has_acceleration.index(False)
            raise InvalidInputError(
                f"base.points[{number}].accelerations has 0 entries: give it at all points or at none"
            )
        for number, (point, time) in enumerate(zip(base.points, times, strict=True)):
            if to_nanoseconds(point.time_from_start) not in (0, time):
                raise InvalidInputError(
                    f"base.points[{number}].time_from_start differs from that of the same point of the trajectory"
                )
        self.has_acceleration = any(has_acceleration)
        self._has_twist = not at_rest or any(len(point.velocities) for point in base.points)
        self._points = base.points
        self._links = names

    def read(self, rows: slice) -> dict[str, Base]:
        """Return {link: Base} at a range of points. Raises InvalidInputError."""
        points = self._points[rows]
        return {
            link: _read_entry(
                points, "base.points[{}]", self._has_twist, self.has_acceleration, entry, self._links, rows.start
            )
            for entry, link in enumerate(self._links)
        }


def check_base(
    base: MultiDOFJointTrajectory, times: Sequence[int], robot: Robot, namespace: str, at_rest: bool = False
) -> LinkTrajectories | None:
    """Return the motion of the base in a MultiDOFJointTrajectory, None for a robot with a fixed base.

    times: time_from_start of each point of the joint trajectory [ns]. at_rest: velocities may be left out. Raises
    InvalidInputError.
    """
    if not robot.moving_base:
        require_no_base(robot, base.points or base.joint_names)
        return None
    return LinkTrajectories(base, times, (robot.base_link,), namespace, f"the base of {robot.name!r}", at_rest)


def read_base_point(point: MultiDOFJointTrajectoryPoint, robot: Robot, at_rest: bool = False) -> Base | None:
    """Return the Base of one MultiDOFJointTrajectoryPoint, None for a robot with a fixed base.

    at_rest: velocities may be left out.
    """
    if not robot.moving_base:
        require_no_base(robot, point.transforms or point.velocities)
        return None
    has_twist = bool(point.velocities) or not at_rest
    base = _read_entry([point], "base", has_twist)
    return Base(np.asarray(base.pose)[0], np.asarray(base.twist)[0] if has_twist else np.zeros(6))


def write_base_points(
    points: Sequence[MultiDOFJointTrajectoryPoint], accelerations: Array
) -> list[MultiDOFJointTrajectoryPoint]:
    """Return the points of the base of a request, completed with accelerations (N, 6)."""
    return [
        MultiDOFJointTrajectoryPoint(
            transforms=point.transforms,
            velocities=point.velocities,
            accelerations=[write_twist(acceleration)],
            time_from_start=point.time_from_start,
        )
        for point, acceleration in zip(points, accelerations, strict=True)
    ]


def require_no_base(robot: Robot, entries: Collection[object], field: str = "base") -> None:
    """Refuse entries of a field with the motion of a base that is fixed. Raises InvalidInputError."""
    if len(entries):
        raise InvalidInputError(f"the base of {robot.name!r} is fixed: leave the field {field} empty")


def _read_entry(
    points: Sequence[MultiDOFJointTrajectoryPoint],
    location: str,
    has_twist: bool = True,
    has_acceleration: bool = False,
    entry: int = 0,
    links: Sequence[str] = ("the base link",),
    first: int = 0,
) -> Base:
    """Return the Base of the link number `entry` in points that have one pose, twist and acceleration of each link.

    has_twist, has_acceleration: whether the points have them; first: number of the first point, for errors.
    """
    fields = ["transforms"]
    if has_twist:
        fields.append("velocities")
    if has_acceleration:
        fields.append("accelerations")
    for field in fields:
        _require_one_of_each_link(points, field, location, links, first)
    poses = read_poses([point.transforms[entry] for point in points], location, first=first)
    twists: Array = np.zeros(6)
    if has_twist:
        twists = read_twists([point.velocities[entry] for point in points], f"{location}.velocities[{entry}]", first)
    accelerations = None
    if has_acceleration:
        entries = [point.accelerations[entry] for point in points]
        accelerations = read_twists(entries, f"{location}.accelerations[{entry}]", first)
    return Base(pose=poses, twist=twists, acceleration=accelerations)


def _require_one_of_each_link(
    points: Sequence[MultiDOFJointTrajectoryPoint], field: str, location: str, links: Sequence[str], first: int
) -> None:
    for number, point in enumerate(points, first):
        count = len(getattr(point, field))
        if count != len(links):
            needed = "one is needed" if len(links) == 1 else f"{len(links)} are needed"
            raise InvalidInputError(
                f"{location.format(number)}.{field} has {count} entries: {needed}, of {', '.join(links)}"
            )
