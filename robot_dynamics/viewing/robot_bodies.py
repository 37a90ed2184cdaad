"""Shapes of a robot: the visual geometry of its description, else bones and joint symbols."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import trimesh

from robot_dynamics.model.visual import BoxShape, CylinderShape, MeshShape, SphereShape
from robot_dynamics.viewing.body import LINK_COLOUR, Body
from robot_dynamics.viewing.mesh_loading import load_visual_meshes
from robot_dynamics.viewing.skeleton import Skeleton

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from trimesh import Trimesh

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.model.visual import HullShape, Shape, Visual
    from robot_dynamics.viewing.body import Colour

SEGMENTS = 40  # of a circle


def robot_bodies(
    robot: Robot, q: Array, packages: Mapping[str, Path] | None = None
) -> tuple[list[Body], tuple[str, ...]]:
    """Return the shapes of a robot in the frames of its links.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (all joints,)
        Positions that close the loops [rad or m], for the size of joint symbols.
    packages : mapping of str to Path, optional
        Folders of packages by name, which mesh files may be in.

    Returns
    -------
    bodies : list of Body
        The visual geometry of the description. Bones and joint symbols where it has none, or none that can be read.
    warnings : tuple of str
        A sentence for each mesh that is missing or refused.
    """
    meshes, warnings = load_visual_meshes(robot, packages)
    bodies = _draw(robot, robot.visuals, meshes)
    return bodies or _draw(robot, Skeleton(robot, q).visuals(), {}), warnings


def _draw(robot: Robot, visuals: Sequence[Visual], meshes: Mapping[int, Trimesh]) -> list[Body]:
    """Return the shapes of visuals; meshes: those that were loaded, by the index of their visual."""
    bodies = []
    for number, visual in enumerate(visuals):
        mesh = _mesh(visual.shape, meshes.get(number))
        if mesh is None:
            continue
        frame = robot.frame(visual.frame)
        mesh.apply_transform(frame.placement @ visual.placement)
        colour, opacity = _colour(visual.colour, mesh)
        bodies.append(Body(visual.name or visual.frame, frame.link, mesh, colour, opacity))
    return bodies


def _mesh(shape: Shape, loaded: Trimesh | None) -> Trimesh | None:
    """Return the surface of a shape in its own frame, None for a mesh that was not loaded."""
    mesh: Trimesh | None
    if isinstance(shape, MeshShape):
        mesh = None if loaded is None else loaded.copy()
        if mesh is not None:
            mesh.apply_transform(np.diag([*shape.scale, 1.0]))  # turns the faces round where a factor mirrors
    elif isinstance(shape, BoxShape):
        mesh = trimesh.creation.box(shape.size)
    elif isinstance(shape, CylinderShape):
        mesh = trimesh.creation.cylinder(shape.radius, shape.length, sections=SEGMENTS)
    elif isinstance(shape, SphereShape):
        mesh = trimesh.creation.icosphere(3, shape.radius)
    else:
        mesh = hull_of_balls(shape)
    return mesh


def hull_of_balls(shape: HullShape) -> Trimesh:
    """Return the convex hull of balls: a rod with round ends for two points, a plate for more."""
    ball = trimesh.creation.icosphere(1, shape.radius).vertices
    hull: Trimesh = trimesh.convex.convex_hull((shape.points[:, None, :] + ball).reshape(-1, 3))
    return hull


def _colour(colour: tuple[float, float, float, float] | None, mesh: Trimesh) -> tuple[Colour | None, float]:
    """Return the colour of a shape, None where its faces have their own, and its opacity."""
    if colour is not None:
        red, green, blue, opacity = colour
        return (round(255 * red), round(255 * green), round(255 * blue)), opacity
    has_face_colours = mesh.visual is not None and mesh.visual.kind == "face"
    return (None if has_face_colours else LINK_COLOUR), 1.0
