"""Markers of a robot for RViz: centres of mass, joint efforts and external wrenches, each in the frame of its link."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from robot_dynamics.model.placement import invert_placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.nodes.parameters import ParameterValues

Color: TypeAlias = tuple[float, float, float]

MASS_COLOR: Color = (0.95, 0.75, 0.1)
EFFORT_COLOR: Color = (0.1, 0.7, 0.2)
EXCESS_COLOR: Color = (0.9, 0.1, 0.1)
FORCE_COLOR: Color = (0.1, 0.4, 0.95)
TORQUE_COLOR: Color = (0.6, 0.2, 0.8)
OPACITY = 0.8
MIN_LENGTH = 0.01  # shorter arrows, as part of the length at the reference, are left out
SHAFT = 0.04  # diameter of the shaft of an arrow, as part of the length at the reference
HEAD = 0.1  # diameter of its head, likewise


class RobotMarkers:
    """The markers of one robot.

    Parameters
    ----------
    values : parameters of the node.
    """

    def __init__(self, dynamics: Dynamics, values: ParameterValues) -> None:
        self._dynamics = dynamics
        self._values = values
        self._prefix: str = values["frame_prefix"]
        self._shown: dict[tuple[str, int], str] = {}  # {namespace and id of a marker: frame}
        robot = dynamics.robot
        # placement of frame j of each link in the frame of the name of the link
        self._placements = [invert_placement(robot.frame(link.name).placement) for link in robot.links]

    def message(self, stamp: Time, efforts: Array, wrenches: Mapping[str, Array]) -> MarkerArray:
        """Return the markers, and deletions of those that were in the last message only.

        Parameters
        ----------
        stamp : of the state.
        efforts : (n,) of the independent joints, nan for joints without arrow [N m or N].
        wrenches : {link: (6,)}, force before torque in the frame of the link [N, N m].
        """
        markers = [*self._centres_of_mass(), *self._effort_arrows(efforts), *self._wrench_arrows(wrenches)]
        shown = {(marker.ns, marker.id): marker.header.frame_id for marker in markers}
        for (namespace, number), frame in self._shown.items():
            if (namespace, number) not in shown:
                markers.append(_new_marker(namespace, number, frame, Marker.ARROW, Marker.DELETE))
        self._shown = shown
        for marker in markers:
            marker.header.stamp = stamp
        return MarkerArray(markers=markers)

    def _centres_of_mass(self) -> Iterator[Marker]:
        """Yield a sphere of the mass of each link."""
        for number, link in enumerate(self._dynamics.robot.links):
            mass = float(link.inertia.mass)
            if mass <= 0:
                continue
            placement = self._placements[number]
            centre = placement[:3, :3] @ (link.inertia.first_moments / mass) + placement[:3, 3]
            marker = _new_marker("centre_of_mass", number, self._prefix + link.name, Marker.SPHERE)
            position = marker.pose.position
            position.x, position.y, position.z = map(float, centre)
            diameter = (6 * mass / (math.pi * self._values["markers.density"])) ** (1 / 3)
            marker.scale.x = marker.scale.y = marker.scale.z = diameter
            marker.color = _color(MASS_COLOR)
            yield marker

    def _effort_arrows(self, efforts: Array) -> Iterator[Marker]:
        """Yield an arrow along the axis of each independent joint, in the direction of its effort."""
        robot = self._dynamics.robot
        for name, effort in zip(self._dynamics.joint_names, efforts, strict=True):
            number = robot.joint_numbers[name] + 1  # of the link
            placement = self._placements[number]
            ratio = float(effort) / self._effort_reference(robot.joints[number - 1])
            yield from self._arrow(
                ("joint_effort", number),
                robot.links[number].name,
                placement[:3, 3],
                ratio * placement[:3, 2],
                EXCESS_COLOR if abs(ratio) > 1 else EFFORT_COLOR,
            )

    def _effort_reference(self, joint: Joint) -> float:
        limit = joint.limits.effort
        if 0 < limit < math.inf:
            return limit
        reference: float = self._values["markers.force" if joint.prismatic else "markers.torque"]
        return reference

    def _wrench_arrows(self, wrenches: Mapping[str, Array]) -> Iterator[Marker]:
        """Yield arrows of the force and of the torque on each link."""
        numbers = {name: number for number, name in enumerate(self._dynamics.robot.frames_by_name)}
        for link, wrench in wrenches.items():
            force = wrench[:3] / self._values["markers.force"]
            torque = wrench[3:] / self._values["markers.torque"]
            yield from self._arrow(("external_force", numbers[link]), link, np.zeros(3), force, FORCE_COLOR)
            yield from self._arrow(("external_torque", numbers[link]), link, np.zeros(3), torque, TORQUE_COLOR)

    def _arrow(self, key: tuple[str, int], link: str, start: Array, direction: Array, color: Color) -> Iterator[Marker]:
        """Yield an arrow from a point (3,) in the frame of a link; none if it is hardly visible.

        direction: (3,), of length 1 at the reference.
        """
        if not MIN_LENGTH <= np.linalg.norm(direction) < math.inf:
            return
        length: float = self._values["markers.length"]
        marker = _new_marker(*key, self._prefix + link, Marker.ARROW)
        marker.points = [_point(start), _point(start + length * direction)]
        marker.scale.x = SHAFT * length
        marker.scale.y = HEAD * length
        marker.color = _color(color)
        yield marker


def delete_all_markers() -> MarkerArray:
    """Return the message that removes all markers, as of another robot."""
    return MarkerArray(markers=[Marker(action=Marker.DELETEALL)])


def _new_marker(namespace: str, number: int, frame: str, kind: int, action: int = Marker.ADD) -> Marker:
    marker = Marker(ns=namespace, id=number, type=kind, action=action)
    marker.header.frame_id = frame
    marker.pose.orientation.w = 1.0
    return marker


def _point(values: Sequence[float] | Array) -> Point:
    x, y, z = map(float, values)
    return Point(x=x, y=y, z=z)


def _color(color: Color) -> ColorRGBA:
    red, green, blue = color
    return ColorRGBA(r=red, g=green, b=blue, a=OPACITY)
