"""A robot in a viser scene: a node for each link, and below it the shapes that move with the link."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.viewing.body import LINK_COLOUR, SINGULAR_COLOUR
from robot_dynamics.viewing.viewer_quaternions import quaternions_wxyz

if TYPE_CHECKING:
    from collections.abc import Iterable

    from viser import FrameHandle, MeshHandle, SceneApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.body import Body

MAX_COLOURS = 32
"""Most colours of a shape that are drawn."""
MAX_SMOOTH_FACES = 2000
"""Faces of a shape up to which its edges are looked for, so that only round surfaces are shaded as round."""
INSIDE_OPACITY = 0.35
"""Opacity of a robot of which the inside is shown."""


class RobotScene:
    """The shapes of a robot in a scene.

    Parameters
    ----------
    scene : viser.SceneApi
    robot : Robot
    bodies : iterable of Body
    root : str
        Name of the node that carries the robot. Default: ``"/robot"``.
    opacity : float, optional
        Of the shapes, 0 to 1. Default: opaque.

    Attributes
    ----------
    bodies : list of Body
        The shapes.
    link_frames : dict of int to viser.FrameHandle
        The node of each link that has shapes or that carries another node, by number of the link.
    meshes : list of tuple of Body and viser.MeshHandle
        Shapes of one colour and their nodes.
    """

    def __init__(
        self,
        scene: SceneApi,
        robot: Robot,
        bodies: Iterable[Body],
        root: str = "/robot",
        opacity: float | None = None,
    ) -> None:
        self.robot = robot
        self.root = root
        self._scene = scene
        self.bodies = list(bodies)
        self.link_frames: dict[int, FrameHandle] = {}
        self.meshes: list[tuple[Body, Any]] = []
        self._is_singular = False
        self._root = scene.add_frame(root, show_axes=False)
        for number, body in enumerate(self.bodies):
            node = f"{self.link_node(body.link)}/{number}"
            for part_number, part in enumerate(parts_by_colour(body)):
                self.meshes.append((part, self._add_mesh(scene, f"{node}_{part_number}", part, opacity)))

    def _add_mesh(self, scene: SceneApi, node: str, body: Body, opacity: float | None) -> MeshHandle:
        """Add the node of a shape of one colour below that of its link."""
        name = f"{node}_{node_name(body.name)}"
        surface = body.mesh.smooth_shaded if len(body.mesh.faces) < MAX_SMOOTH_FACES else body.mesh
        opacity = body.opacity if opacity is None else opacity * body.opacity
        return scene.add_mesh_simple(
            name,
            np.asarray(surface.vertices, dtype=np.float32),
            np.asarray(surface.faces, dtype=np.uint32),
            color=body.colour or LINK_COLOUR,
            opacity=None if opacity >= 1 else opacity,
            side="double",
        )

    def link_node(self, number: int) -> str:
        """Return the name of the node that moves with a link. The node is added if there is none."""
        name = f"{self.root}/{number}_{node_name(self.robot.links[number].name)}"
        if number not in self.link_frames:
            self.link_frames[number] = self._scene.add_frame(name, show_axes=False)
        return name

    def move(self, link_poses: Array) -> None:
        """Move the links to poses (links, 4, 4) [m]."""
        numbers = list(self.link_frames)
        quaternions = quaternions_wxyz(link_poses[numbers, :3, :3])
        for number, quaternion in zip(numbers, quaternions, strict=True):
            frame = self.link_frames[number]
            position = link_poses[number, :3, 3]
            if np.array_equal(frame.position, position) and np.array_equal(frame.wxyz, quaternion):
                continue  # it has not moved, and need not be sent
            frame.wxyz = quaternion
            frame.position = position

    def show(self, is_visible: bool) -> None:
        """Show or hide the robot."""
        self._root.visible = is_visible

    def make_translucent(self, is_translucent: bool) -> None:
        """Draw all shapes translucent, so that what is inside of them is seen, or with their own opacity."""
        for body, handle in self.meshes:
            opacity = body.opacity * (INSIDE_OPACITY if is_translucent else 1.0)
            handle.opacity = None if opacity >= 1 else opacity

    def mark_singular(self, is_singular: bool) -> None:
        """Draw all shapes in red, or in their own colours."""
        if is_singular == self._is_singular:
            return
        self._is_singular = is_singular
        for body, handle in self.meshes:
            handle.color = SINGULAR_COLOUR if is_singular else body.colour or LINK_COLOUR


def parts_by_colour(body: Body) -> list[Body]:
    """Return a shape as one for each colour of its faces; a shape with a colour is one part.

    Faces with other than the MAX_COLOURS colours of most faces get the one of these that is nearest.
    """
    if body.colour is not None:
        return [body]
    whole: Any = body.mesh
    colours, numbers, counts = np.unique(whole.visual.face_colors, axis=0, return_inverse=True, return_counts=True)
    kept = np.argsort(-counts, kind="stable")[:MAX_COLOURS]
    distances = np.linalg.norm(colours[:, None, :].astype(float) - colours[kept].astype(float), axis=-1)
    numbers = np.argmin(distances, axis=1)[numbers.reshape(-1)]
    parts = []
    for number in np.unique(numbers):
        red, green, blue, opacity = colours[kept[number]].tolist()
        mesh = whole.submesh([np.flatnonzero(numbers == number)], append=True, repair=False)
        parts.append(replace(body, mesh=mesh, colour=(red, green, blue), opacity=body.opacity * opacity / 255))
    return parts


def node_name(name: str) -> str:
    """Return a name as part of the name of a node: letters, digits, and underscores for all else."""
    return re.sub(r"[^\w.-]", "_", name)[:80]
