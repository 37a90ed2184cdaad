"""What can be drawn over a robot of its masses: centres of mass, and ellipsoids of inertia."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from robot_dynamics.model.placement import placement

if TYPE_CHECKING:
    from viser import SceneApi

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.configuration import Configuration
    from robot_dynamics.viewing.scene import RobotScene

MASS_COLOUR = (40, 40, 48)
TOTAL_MASS_COLOUR = (230, 150, 20)
INERTIA_COLOUR = (120, 90, 200)


class MassOverlay:
    """Centres of mass: a ball for each link with its payload, its volume as its mass, and one for the whole robot."""

    title = "Centres of mass (whole robot: orange)"
    is_inside = True

    def __init__(self, scene: SceneApi, drawn: RobotScene, radius: float) -> None:
        self._scene = scene
        self._drawn = drawn
        self._radius = radius
        self._nodes: dict[int, Any] = {}
        self._total = scene.add_icosphere(
            f"{drawn.root}_mass", radius=2.5 * radius, color=TOTAL_MASS_COLOUR, visible=False
        )
        self._read(drawn.robot)
        self._largest = float(self._masses.max())
        self._draw_links()

    def _read(self, robot: Robot) -> None:
        """Read the masses of a robot, which may carry a payload."""
        self._robot = robot
        self._masses = np.array([float(link.inertia.mass) for link in robot.links])
        self._first_moments = np.array([np.asarray(link.inertia.first_moments, float) for link in robot.links])

    def _draw_links(self) -> None:
        """Put a ball at the centre of mass of each link."""
        for number in np.flatnonzero(self._masses > 0).tolist():
            mass = self._masses[number]
            size = max(0.5, 3.0 * np.cbrt(mass / (self._largest or mass))) * self._radius
            if number not in self._nodes:
                self._nodes[number] = self._scene.add_icosphere(
                    f"{self._drawn.link_node(number)}/mass", radius=size, color=MASS_COLOUR, visible=self._total.visible
                )
            self._nodes[number].radius = size
            self._nodes[number].position = self._first_moments[number] / mass

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""
        for node in (*self._nodes.values(), self._total):
            node.visible = is_visible

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Move the centre of mass of the whole robot, and those of links that carry another payload now."""
        if configuration.robot is not self._robot:
            self._read(configuration.robot)
            self._draw_links()
        total = self._masses.sum()
        if total > 0:
            moments = self._masses[:, None] * link_poses[:, :3, 3]
            moments = moments + np.einsum("nij,nj->ni", link_poses[:, :3, :3], self._first_moments)
            self._total.position = moments.sum(axis=0) / total


class InertiaOverlay:
    """The ellipsoids of uniform density that have the mass and the inertia of the links."""

    title = "Inertia ellipsoids"
    is_inside = True

    def __init__(self, scene: SceneApi, drawn: RobotScene) -> None:
        self._nodes = []
        for number, link in enumerate(drawn.robot.links):
            ellipsoid = inertia_ellipsoid(link.inertia)
            if ellipsoid is None:
                continue
            axes, pose = ellipsoid
            sphere = trimesh.creation.icosphere(2, 1.0)
            vertices = (sphere.vertices * axes) @ pose[:3, :3].T + pose[:3, 3]
            self._nodes.append(
                scene.add_mesh_simple(
                    f"{drawn.link_node(number)}/inertia",
                    vertices,
                    sphere.faces,
                    color=INERTIA_COLOUR,
                    opacity=0.45,
                    visible=False,
                )
            )

    def show(self, is_visible: bool) -> None:
        """Show or hide it."""
        for node in self._nodes:
            node.visible = is_visible

    def update(self, configuration: Configuration, link_poses: Array) -> None:
        """Do nothing: the ellipsoids move with their links."""


def inertia_ellipsoid(inertia: Inertia) -> tuple[Array, Array] | None:
    """Return the solid ellipsoid with the inertia of a body: semi-axes (3,) [m], and pose (4, 4) in its frame.

    None where no physical body has this inertia, or where it has no extent.
    """
    mass = float(inertia.mass)
    if not mass > 0:
        return None
    centre = np.asarray(inertia.first_moments, dtype=float) / mass
    about_centre = np.asarray(inertia.second_moments, dtype=float)
    about_centre = about_centre - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    moments, directions = np.linalg.eigh(about_centre)
    squares = 2.5 / mass * (moments.sum() - 2 * moments)
    if not (squares > 0).all():
        return None
    if np.linalg.det(directions) < 0:
        directions[:, 0] *= -1
    return np.sqrt(squares), placement(directions, centre)
