"""A mode shape in a scene: its bodies at rest and displaced."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from viser import SceneApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.viewing.mode_geometry import AttachedMesh, ModeGeometry

COLOURS = {"beams": (42, 111, 187), "arms": (96, 104, 116), "joints": (208, 112, 42)}
REST_COLOUR = (120, 126, 138)
REST_OPACITY = 0.35


class ModeView:
    """The nodes of the scene that draw a mode shape.

    Parameters
    ----------
    scene : viser.SceneApi
    geometry : ModeGeometry
    root : str
        Name of the node that carries them. Default: ``"/mode"``.
    """

    def __init__(self, scene: SceneApi, geometry: ModeGeometry, root: str = "/mode") -> None:
        self._geometry = geometry
        self._parts: list[tuple[AttachedMesh, Any]] = []
        self._directions: list[Array] = []
        self._root = scene.add_frame(root, show_axes=False)
        for name, colour in COLOURS.items():
            mesh: AttachedMesh = getattr(geometry, name)
            if not len(mesh.faces):
                continue
            _add_mesh(scene, f"{root}/{name}_at_rest", mesh, REST_COLOUR, REST_OPACITY)
            self._parts.append((mesh, _add_mesh(scene, f"{root}/{name}", mesh, colour, None)))

    def choose(self, mode_shape: Array, share: float) -> None:
        """Draw another mode: a row of `mode_shapes`, its largest displacement a share of the robot's extent."""
        displacements = self._geometry.displacements(mode_shape)
        displacements = displacements * self._geometry.scale(displacements, share)
        self._directions = [self._geometry.vertex_displacements(mesh, displacements) for mesh, _ in self._parts]

    def draw(self, phase: float) -> None:
        """Draw the mode at a phase of its oscillation [rad]: 0 at rest, π/2 at its largest displacement."""
        for (mesh, handle), directions in zip(self._parts, self._directions, strict=True):
            handle.vertices = (mesh.vertices + np.sin(phase) * directions).astype(np.float32)

    def remove(self) -> None:
        """Take it out of the scene."""
        self._root.remove()


def _add_mesh(
    scene: SceneApi, name: str, mesh: AttachedMesh, colour: tuple[int, int, int], opacity: float | None
) -> Any:
    return scene.add_mesh_simple(
        name,
        mesh.vertices.astype(np.float32),
        mesh.faces.astype(np.uint32),
        color=colour,
        opacity=opacity,
        flat_shading=True,
        side="double",
    )
