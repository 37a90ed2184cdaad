"""Primitives that stand for the convex hull of balls, for formats that have cylinders and spheres only."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.placement import placement, rotation_with_z_along
from robot_dynamics.model.visual import CylinderShape, HullShape, SphereShape

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.visual import Visual

COINCIDENCE_TOLERANCE = 1e-9  # relative to the radius of the balls: distance at which two points count as one
RIGHT_ANGLE_TOLERANCE = 1e-9  # relative, of squared lengths
MAX_PLATE_POINTS = 100  # a description can have thousands of joints on a link, and the time grows with their cube


def primitive_visuals(visuals: tuple[Visual, ...]) -> tuple[Visual, ...]:
    """Return visuals with the primitives of each hull in its place; all others stay as they are."""
    return tuple(
        primitive
        for visual in visuals
        for primitive in (hull_primitives(visual, visual.shape) if isinstance(visual.shape, HullShape) else (visual,))
    )


def hull_primitives(visual: Visual, hull: HullShape) -> Iterator[Visual]:
    """Yield the balls of a hull, and a cylinder along each of its rods.

    Parameters
    ----------
    visual : Visual
        Whose frame, placement, colour and name the primitives have.
    hull : HullShape
        Its shape.
    """
    points = _distinct_points(hull)
    for point in points:
        yield _primitive(visual, placement(translation=point), SphereShape(hull.radius))
    for first, second in rods_between(points):
        middle, along = (points[first] + points[second]) / 2, points[second] - points[first]
        shape = CylinderShape(hull.radius, float(np.linalg.norm(along)))
        yield _primitive(visual, placement(rotation_with_z_along(along), middle), shape)


def rods_between(points: Array) -> list[tuple[int, int]]:
    """Return the pairs of distinct points (n, 3) that rods connect: all points hang together, and few rods cross.

    Two points are connected if no other one is in the ball that has their distance as its diameter (the Gabriel graph,
    which contains the shortest tree through all points). From more than MAX_PLATE_POINTS points rods lead to the first.
    """
    if len(points) > MAX_PLATE_POINTS:
        return [(0, number) for number in range(1, len(points))]
    squares = ((points[:, None] - points) ** 2).sum(axis=-1)
    pairs = []
    for first, second in zip(*np.triu_indices(len(points), 1), strict=True):
        through = np.delete(squares[first] + squares[second], [first, second])
        if not (through < (1 - RIGHT_ANGLE_TOLERANCE) * squares[first, second]).any():
            pairs.append((int(first), int(second)))
    return pairs


def _distinct_points(hull: HullShape) -> Array:
    """Return the points (n, 3) of a hull without those that coincide with an earlier one."""
    tolerance = COINCIDENCE_TOLERANCE * hull.radius
    points = hull.points
    is_new = [
        bool((np.abs(points[:number] - point).max(axis=1) > tolerance).all()) for number, point in enumerate(points)
    ]
    return points[is_new]


def _primitive(visual: Visual, pose: Array, shape: CylinderShape | SphereShape) -> Visual:
    """Return a visual like another one with a shape at a pose (4, 4) in that one."""
    return replace(visual, placement=visual.placement @ pose, shape=shape)
