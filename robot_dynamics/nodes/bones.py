"""Shapes for a robot whose description has none: a rod from the frame of each link to the joints that it carries."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.model.placement import invert_placement, placement, rotation_with_z_along
from robot_dynamics.model.visual import CylinderShape, SphereShape, Visual

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot

Colour: TypeAlias = tuple[float, float, float, float]

THICKNESS = 0.02  # radius of rods, as part of the mean distance between joints
BALL = 1.6  # radius of balls, as a multiple of that of rods
BASE_COLOUR: Colour = (0.35, 0.35, 0.38, 1.0)
LINK_COLOUR: Colour = (0.75, 0.77, 0.8, 1.0)
PLATFORM_COLOUR: Colour = (0.9, 0.75, 0.2, 1.0)
BALL_COLOUR: Colour = (0.2, 0.35, 0.6, 1.0)


def with_bones(robot: Robot) -> Robot:
    """Return the robot with rods and balls as visual geometry, in place of what it has.

    Rods lead to the joints that a link carries, and to the cut joints of loops on it; of a link without any, to its
    centre of mass. A ball is at each end of a rod.
    """
    points = [list(_points_on_link(robot, number)) for number in range(len(robot.links))]
    lengths = [length for on_link in points for point in on_link if (length := np.linalg.norm(point)) > 0]
    radius = THICKNESS * float(np.mean(lengths)) if lengths else THICKNESS
    visuals = [visual for number, on_link in enumerate(points) for visual in _bones(robot, number, on_link, radius)]
    return replace(robot, visuals=tuple(visuals))


def _points_on_link(robot: Robot, number: int) -> Iterator[Array]:
    """Yield points (3,) in the frame of a link at which it is joined to others, or else its centre of mass."""
    ends = [end.placement for loop in robot.loops for end in loop.ends if end.link == number]
    joints = [joint.placement for joint in robot.joints if joint.antecedent == number]
    for matrix in [*joints, *ends]:
        yield np.asarray(matrix[:3, 3], dtype=float)
    inertia = robot.links[number].inertia
    if not ends and not joints and inertia.mass > 0:
        yield np.asarray(inertia.first_moments / inertia.mass, dtype=float)


def _bones(robot: Robot, number: int, points: list[Array], radius: float) -> Iterator[Visual]:
    name = robot.links[number].name
    colour = LINK_COLOUR
    if number == 0:
        colour = BASE_COLOUR
    elif name in robot.platform_links:
        colour = PLATFORM_COLOUR
    to_named = invert_placement(robot.frame(name).placement)  # of frame j in the frame of the name
    for point in points:
        length = float(np.linalg.norm(point))
        if length > radius:
            yield Visual(name, to_named @ _along(point), CylinderShape(radius, length), colour)
        yield Visual(name, to_named @ placement(translation=point), SphereShape(BALL * radius), BALL_COLOUR)


def _along(point: Array) -> Array:
    """Return the placement (4, 4) of a cylinder from the origin to a point (3,), which is not zero."""
    return placement(rotation_with_z_along(point), point / 2)
