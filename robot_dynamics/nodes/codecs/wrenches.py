"""Wrenches on links as messages and as arrays (6,), force before torque, in the frame of the link."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from geometry_msgs.msg import Wrench, WrenchStamped
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import NS_PER_SECOND, to_nanoseconds
from robot_dynamics.nodes.codecs.joint_order import resolve_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.codecs.joint_order import JointOrder


def read_wrench(message: Wrench, location: str) -> Array:
    """Return (6,) of a geometry_msgs/Wrench; `location` is its name in errors."""
    force = message.force
    torque = message.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    if not np.isfinite(values).all():
        raise InvalidInputError(f"{location} is {values}: finite numbers are needed")
    return values


def write_wrench(values: Array) -> Wrench:
    """Return the geometry_msgs/Wrench of (6,)."""
    message = Wrench()
    message.force.x, message.force.y, message.force.z = map(float, values[:3])
    message.torque.x, message.torque.y, message.torque.z = map(float, values[3:])
    return message


def read_wrenches(
    messages: Sequence[WrenchStamped], times: Sequence[int], robot: Robot, namespace: str
) -> dict[str, Array]:
    """Return {link name: (N, 6)} of external wrenches for N trajectory points at `times` [ns].

    A message acts at every point if its stamp is zero, else at the points of that time. Wrenches on one link add up.
    Raises InvalidInputError.
    """
    point_times = np.asarray(times)
    by_time = np.argsort(point_times, kind="stable")
    sorted_times = point_times[by_time]
    wrenches: dict[str, Array] = {}
    for number, message in enumerate(messages):
        location = f"external_wrenches[{number}]"
        link = resolve_link(message.header.frame_id, robot, namespace, f"{location}.header.frame_id")
        values = read_wrench(message.wrench, f"{location} on {link!r}")
        stamp = to_nanoseconds(message.header.stamp)
        if message.header.stamp.sec < 0 or message.header.stamp.nanosec >= NS_PER_SECOND:
            raise InvalidInputError(f"{location}.header.stamp is not a valid time since the start of the trajectory")
        rows = by_time if stamp == 0 else by_time[slice(*np.searchsorted(sorted_times, [stamp, stamp + 1]))]
        if not len(rows):
            raise InvalidInputError(
                f"{location} on {link!r} has stamp {stamp * 1e-9:.9g} s, and no point has that "
                "time_from_start. A zero stamp means every point"
            )
        wrenches.setdefault(link, np.zeros((len(times), 6)))[rows] += values
    return wrenches


def resolve_link(name: str, robot: Robot, namespace: str, location: str) -> str:
    """Return the name of the link that a message means; `location` is the name of its field in errors."""
    try:
        return resolve_name("link", name, robot.frames_by_name, namespace)
    except InvalidInputError as error:
        raise InvalidInputError(f"{location}: {error}") from None


def wrenches_at(wrenches: Mapping[str, Array], rows: slice) -> dict[str, Array]:
    """Return {link name: (k, 6) or (6,)} at a range of points, of (N, 6) or (6,) where they are constant."""
    return {link: values if values.ndim == 1 else values[rows] for link, values in wrenches.items()}


def write_reactions(points: Sequence[JointTrajectoryPoint], reactions: Array, order: JointOrder) -> list[WrenchStamped]:
    """Return reaction wrenches of each point: on the base, then on each joint in the order of the response.

    reactions: (N, 1 + all joints, 6), the base first.
    """
    robot = order.dynamics.robot
    rows = [0, *(number + 1 for number in order.response_order)]
    messages = []
    for point, wrenches in zip(points, reactions, strict=True):
        for row in rows:
            message = WrenchStamped(wrench=write_wrench(wrenches[row]))
            message.header.frame_id = robot.links[row].name
            message.header.stamp.sec = point.time_from_start.sec
            message.header.stamp.nanosec = point.time_from_start.nanosec
            messages.append(message)
    return messages
