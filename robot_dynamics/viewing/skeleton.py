"""Bones and joint symbols of a robot whose description has no shapes.

A link is the convex hull of balls at the joints that it carries: a rod between two joints, a plate between more. A
revolute joint is a cylinder about its axis. A prismatic joint is a tube in which a rod slides, or a carriage on a rail.
A ball is where a loop closes at a ball joint. All are visuals, which viewers draw and `write_urdf` writes.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.model.placement import invert_placement, placement
from robot_dynamics.model.visual import BoxShape, CylinderShape, HullShape, SphereShape, Visual
from robot_dynamics.newton_euler.kinematics import link_placements
from robot_dynamics.viewing.body import (
    ACTUATED_COLOUR,
    BASE_COLOUR,
    ELASTIC_COLOUR,
    LINK_COLOUR,
    PASSIVE_COLOUR,
    PLATFORM_COLOUR,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.model.visual import Shape
    from robot_dynamics.viewing.body import Colour

BONE_RADIUS = 0.014  # relative to the extent of the robot, like all lengths below relative to this radius
JOINT_RADIUS = 1.9
JOINT_LENGTH = 4.4
CARRIAGE_SIZE = 4.0
PLATFORM_RADIUS = 3.0
TUBE_RADIUS = 1.5
ROD_RADIUS = 0.75
TUBE_SHARE = 0.6  # of a leg's length at the initial positions: the tube, and the rod in it


def add_skeleton(robot: Robot) -> Robot:
    """Return a robot that has shapes to draw: its own visuals, or else bones and joint symbols.

    Parameters
    ----------
    robot : Robot
        Any robot with numbers. The dynamics stay the same.

    Returns
    -------
    Robot
        The same robot with `visuals`. The size of the symbols is chosen at the initial positions.

    Examples
    --------
    >>> from robot_dynamics import add_skeleton, load_robot, write_urdf
    >>> robot = load_robot("delta")
    >>> len(robot.visuals)
    0
    >>> "<visual>" in write_urdf(add_skeleton(robot), lossy=True)
    True
    """
    if robot.visuals:
        return robot
    return replace(robot, visuals=tuple(Skeleton(robot, _initial_positions(robot)).visuals()))


def _initial_positions(robot: Robot) -> Array:
    """Return positions (all joints,) that close the loops, or those of the description where none do."""
    try:
        topology = build_topology(robot)
    except RobotDynamicsError:  # the loops do not close, or cannot be solved
        return np.array([joint.initial_position for joint in robot.joints])
    return topology.joint_positions(topology.reference_positions)


class Skeleton:
    """Shapes of a robot without visual geometry.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (all joints,)
        Positions that close the loops [rad or m]; the size of the symbols, and the length of tubes, is chosen there.
    """

    def __init__(self, robot: Robot, q: Array) -> None:
        self.robot = robot
        self._q = q

    @cached_property
    def origins(self) -> Array:
        """(links, 3) origins of the link frames [m], in frame 0."""
        return np.array([P for _, P in link_placements(self.robot, self._q)])

    @cached_property
    def extent(self) -> float:
        """Largest extent of the robot [m]: along x, y or z of frame 0."""
        extent = float(np.ptp(self.origins, axis=0).max())
        return extent if extent > 0 else self.robot.characteristic_length

    @property
    def radius(self) -> float:
        """Radius of the bones [m]."""
        return BONE_RADIUS * self.extent

    @cached_property
    def coordinate_joints(self) -> frozenset[int]:
        """Indices of the joints that are coordinates of platforms: no hardware, so that nothing is drawn."""
        return frozenset(index for platform in self.robot.platforms for index in platform.joints)

    def visuals(self) -> list[Visual]:
        """Return the shapes of all links and joints: those of joints have the names of the joints."""
        bones = (self._bone(number) for number in range(len(self.robot.links)))
        joints = [
            visual
            for index, joint in enumerate(self.robot.joints)
            if index not in self.coordinate_joints
            for visual in self._joint(index, joint)
        ]
        ball = SphereShape(JOINT_RADIUS * self.radius)
        balls = [
            self._visual(end.link, ball, PASSIVE_COLOUR, placement(translation=end.placement[:3, 3]), loop.name)
            for loop in self.robot.loops
            if loop.is_spherical
            for end in [loop.closed_on]
        ]
        return [bone for bone in bones if bone is not None] + joints + balls

    def _visual(self, number: int, shape: Shape, colour: Colour, pose: Array, name: str | None = None) -> Visual:
        """Return a shape at a pose (4, 4) in frame j of a link."""
        link = self.robot.links[number].name
        red, green, blue = (round(level / 255, 3) for level in colour)
        to_named = invert_placement(self.robot.frame(link).placement)
        return Visual(link, to_named @ pose, shape, (red, green, blue, 1.0), name)

    def _bone(self, number: int) -> Visual | None:
        """Return the shape of a link; None where its joints are all at one point."""
        points = self._points(number)
        is_platform = number in {platform.link for platform in self.robot.platforms}
        radius = self.radius
        if np.linalg.norm(points - points[0], axis=1).max() < radius:
            if not is_platform:
                return None
            radius *= PLATFORM_RADIUS  # all legs end at one point: a ball
        colour = BASE_COLOUR if number == 0 else PLATFORM_COLOUR if is_platform else LINK_COLOUR
        return self._visual(number, HullShape(points, radius), colour, np.eye(4))

    def _points(self, number: int) -> Array:
        """Return the points (N, 3) that the shape of a link contains, in its frame."""
        starts = [
            joint.placement[:3, 3]
            for index, joint in enumerate(self.robot.joints)
            if joint.antecedent == number and index not in self.coordinate_joints
        ]
        ends = [end.placement[:3, 3] for loop in self.robot.loops for end in loop.ends if end.link == number]
        points = starts + ends
        has_own_joint = number > 0 and number - 1 not in self.coordinate_joints
        if has_own_joint or len(points) < 2:
            points = [np.zeros(3), *points]  # the link's own joint
        if len(points) == 1:
            points += self._tip(number)
        return np.array(points)

    def _tip(self, number: int) -> list[Array]:
        """Return the farthest frame that is fixed to the last link of a branch, or its centre of mass."""
        frames = [frame.placement[:3, 3] for frame in self.robot.frames if frame.link == number]
        inertia = self.robot.links[number].inertia
        if not any(np.any(point) for point in frames) and inertia.mass > 0:
            frames = [inertia.first_moments / inertia.mass]
        return sorted(frames, key=lambda point: float(np.linalg.norm(point)))[-1:]

    def _joint(self, index: int, joint: Joint) -> list[Visual]:
        """Return the symbols of a joint: of its own link, and of its antecedent."""
        colour = joint_colour(joint)
        if joint.prismatic:
            return self._slide(index, joint, colour)
        symbol = CylinderShape(JOINT_RADIUS * self.radius, JOINT_LENGTH * self.radius)
        return [self._visual(index + 1, symbol, colour, np.eye(4), joint.name)]

    def _slide(self, index: int, joint: Joint, colour: Colour) -> list[Visual]:
        """Return tube and rod of a leg, or carriage and rail of a slide that starts near its zero."""
        length = float(self._q[index])
        carriage = CARRIAGE_SIZE * self.radius
        if abs(length) > 2 * carriage:
            share = TUBE_SHARE * length
            tube, tube_pose = self._rod(0.0, share, TUBE_RADIUS)
            rod, rod_pose = self._rod(-share, 0.0, ROD_RADIUS)
            return [
                self._visual(joint.antecedent, tube, colour, joint.placement @ tube_pose, joint.name),
                self._visual(index + 1, rod, PASSIVE_COLOUR, rod_pose, joint.name),
            ]
        limits = np.array([joint.limits.lower, joint.limits.upper])
        ends = np.where(np.isfinite(limits), limits, length + 0.15 * self.extent * np.array([-1.0, 1.0]))
        rail, rail_pose = self._rod(float(ends[0]), float(ends[1]), ROD_RADIUS)
        box = BoxShape(carriage * np.array([1.0, 1.0, 1.4]))
        return [
            self._visual(joint.antecedent, rail, BASE_COLOUR, joint.placement @ rail_pose, joint.name),
            self._visual(index + 1, box, colour, np.eye(4), joint.name),
        ]

    def _rod(self, start: float, end: float, radius: float) -> tuple[CylinderShape, Array]:
        """Return a cylinder along z, from z = `start` to z = `end`, and its pose (4, 4)."""
        shape = CylinderShape(radius * self.radius, abs(end - start))
        return shape, placement(translation=[0.0, 0.0, (start + end) / 2])


def joint_colour(joint: Joint) -> Colour:
    """Return the colour of a joint: of one with a motor, with a spring, or with neither."""
    if joint.actuated:
        return ACTUATED_COLOUR
    return ELASTIC_COLOUR if joint.spring is not None else PASSIVE_COLOUR
