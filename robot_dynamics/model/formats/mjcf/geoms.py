"""Geoms of an MJCF as shapes that a viewer draws: boxes, cylinders, spheres and capsules."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.placement import placement, rotation_from_quaternion
from robot_dynamics.model.visual import BoxShape, CylinderShape, HullShape, SphereShape, Visual

if TYPE_CHECKING:
    from robot_dynamics.model.visual import Shape

LAST_SHOWN_GROUP = 2  # MuJoCo's viewer hides later groups at first: most models have their collision shapes there
DEFAULT_COLOUR = (0.5, 0.5, 0.5, 1.0)


def read_geoms(model: dict[str, Any], body_names: list[str]) -> tuple[Visual, ...]:
    """Return the shapes of all bodies but the world: those of the groups that MuJoCo shows at first.

    A body with none of these has its hidden ones: its meshes are not read.
    """
    shown: dict[int, list[Visual]] = {}
    hidden: dict[int, list[Visual]] = {}
    for number, body in enumerate(model["geom_bodyid"]):
        shape = _shape(model["geom_type"][number], model["geom_size"][number])
        if body == 0 or shape is None:
            continue
        is_shown = model["geom_group"][number] <= LAST_SHOWN_GROUP
        frame = placement(rotation_from_quaternion(model["geom_quat"][number]), model["geom_pos"][number])
        visual = Visual(body_names[body], frame, shape, _colour(model["geom_rgba"][number]))
        (shown if is_shown else hidden).setdefault(body, []).append(visual)
    return tuple(visual for body in range(len(body_names)) for visual in shown.get(body, hidden.get(body, [])))


def _shape(kind: str, size: list[float]) -> Shape | None:
    """Return the shape of a geom, whose sizes are radii and halves of lengths; None of one that is not drawn."""
    if kind == "mjGEOM_BOX":
        return BoxShape(2 * np.array(size))
    if kind == "mjGEOM_SPHERE":
        return SphereShape(size[0])
    if kind == "mjGEOM_CYLINDER":
        return CylinderShape(size[0], 2 * size[1])
    if kind == "mjGEOM_CAPSULE":
        return HullShape(np.array([[0.0, 0.0, -size[1]], [0.0, 0.0, size[1]]]), size[0])
    return None


def _colour(rgba: list[float]) -> tuple[float, float, float, float] | None:
    """Return a colour; None for that of a geom without one, or with a material."""
    red, green, blue, opacity = (min(max(float(part), 0.0), 1.0) for part in rgba)
    colour = (red, green, blue, opacity)
    return None if np.allclose(colour, DEFAULT_COLOUR) else colour
