"""A robot that is drawn and moved: its positions, its shapes in the scene, and what is drawn over them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.viewing.configuration import Configuration
from robot_dynamics.viewing.latest_task import LatestTask
from robot_dynamics.viewing.link_poses import link_matrices
from robot_dynamics.viewing.mass_overlays import InertiaOverlay, MassOverlay
from robot_dynamics.viewing.overlays import EffortOverlay, FrameOverlay, MDHOverlay, NameOverlay
from robot_dynamics.viewing.robot_bodies import robot_bodies
from robot_dynamics.viewing.scene import RobotScene
from robot_dynamics.viewing.skeleton import BONE_RADIUS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from pathlib import Path

    from viser import ViserServer

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.overlays import Overlay

FOLLOW_SECONDS = 0.1
"""Least time between updates of panels and efforts while a robot moves: they take more time than to draw it."""
REFERENCE_COLOUR = (230, 120, 30)
REFERENCE_OPACITY = 0.4


class RobotView:
    """A robot in the scene of a server.

    Motions are drawn in a thread of their own, the newest one first; efforts and singular positions are computed when
    no motion waits.

    Parameters
    ----------
    server : viser.ViserServer
    robot : Robot

    packages : mapping of str to Path, optional
        Folders of packages by name, which mesh files may be in.

    Attributes
    ----------
    configuration : Configuration
        Positions of the robot.
    bounds : ndarray, shape (2, 3)
        Least and greatest coordinates of the shapes at the first positions [m], in frame 0.
    warnings : tuple of str
        A sentence for each mesh that is missing or refused.
    external_wrenches : dict of str to ndarray
        Wrenches (6,) on links that the efforts counter [N, N m], in the link frames.
    reference : ndarray, shape (all joints,), or None
        Positions of the reference, which is drawn as a second robot after `add_reference`.
    reference_scene : RobotScene or None
        Its shapes.
    on_draw, on_move, on_efforts : list of callable
        Called with poses (links, 4, 4) where the robot is drawn; after motions, at most once in FOLLOW_SECONDS;
        and with new efforts (n,) of the independent joints and whether the robot is drawn red.
    """

    def __init__(self, server: ViserServer, robot: Robot, packages: Mapping[str, Path] | None = None) -> None:
        self.robot = robot
        self.configuration = Configuration(robot)
        self.external_wrenches: dict[str, Array] = {}
        self.reference: Array | None = None
        self.reference_scene: RobotScene | None = None
        self._payload: tuple[str, Inertia] | None = None
        self.on_draw: list[Callable[[Array], None]] = []
        self.on_move: list[Callable[[], None]] = []
        self.on_efforts: list[Callable[[Array, bool], None]] = []
        self._server = server
        self._bodies, self.warnings = robot_bodies(robot, self.configuration.q, packages)
        self.bounds = self._bounds(self.configuration.link_poses())
        self.scene = RobotScene(server.scene, robot, self._bodies)
        radius = BONE_RADIUS * self.extent
        self._efforts = EffortOverlay(server.scene, self.scene, radius, self.configuration.independent)
        self.overlays: list[Overlay] = [
            NameOverlay(server.scene, self.scene),
            FrameOverlay(server.scene, self.scene, radius),
            MDHOverlay(server.scene, self.scene, radius),
            MassOverlay(server.scene, self.scene, radius),
            InertiaOverlay(server.scene, self.scene),
            self._efforts,
        ]
        self.tasks = LatestTask(self._follow, FOLLOW_SECONDS)
        self.draw()

    def move(self, motion: Callable[[Configuration], bool]) -> None:
        """Move the robot soon, and draw it; a motion that waits is replaced.

        Parameters
        ----------
        motion : callable
            Moves a Configuration, and returns whether that was possible.
        """
        self.tasks.submit(lambda: self._move(motion))

    def add_reference(self) -> None:
        """Add a second, translucent robot, which is drawn at the positions `reference`."""
        bodies = [replace(body, colour=REFERENCE_COLOUR) for body in self._bodies]
        self.reference_scene = RobotScene(self._server.scene, self.robot, bodies, "/reference", REFERENCE_OPACITY)

    def refresh(self) -> None:
        """Compute and draw the efforts again soon."""
        self.tasks.submit(lambda: None)

    def carry(self, frame: str, inertia: Inertia) -> None:
        """Carry a payload soon, as `Configuration.carry` does."""
        self._payload = (frame, inertia)  # no task of its own: the next motion could replace it
        self.refresh()

    def _move(self, motion: Callable[[Configuration], bool]) -> None:
        motion(self.configuration)
        self.draw()

    def _follow(self) -> None:
        """Set the panels to where the robot is."""
        for callback in self.on_move:
            callback()
        self.draw_efforts()

    def draw(self) -> None:
        """Draw the robot where it is."""
        poses = self.configuration.link_poses()
        with self._server.atomic():
            self.scene.move(poses)
            if self.reference_scene is not None and self.reference is not None:
                self.reference_scene.move(link_matrices(self.robot, self.reference))
            for overlay in self.overlays:
                overlay.update(self.configuration, poses)
            for callback in self.on_draw:
                callback(poses)
        self._server.flush()

    def draw_efforts(self) -> None:
        """Draw the efforts that hold the robot where it is with its payload, and draw it red where it is singular."""
        payload, self._payload = self._payload, None
        if payload is not None:
            self.configuration.carry(*payload)
            self.draw()
        efforts = self.configuration.holding_efforts(self.external_wrenches or None)
        is_singular = bool(self.configuration.problem) or self.configuration.is_singular
        with self._server.atomic():
            self._efforts.draw(efforts, self.configuration.link_poses())
            self.scene.mark_singular(is_singular)
        for callback in self.on_efforts:
            callback(efforts, is_singular)
        self._server.flush()

    def close(self) -> None:
        """End the thread that draws."""
        self.tasks.close()

    def bounds_along(self, positions: Array) -> Array:
        """Return the bounds (2, 3) [m] of the robot at positions (N, all joints)."""
        bounds = np.array([self._bounds(link_matrices(self.robot, q)) for q in positions])
        return np.array([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])

    def _bounds(self, poses: Array) -> Array:
        """Return the bounds (2, 3) of the shapes at poses (links, 4, 4)."""
        corners = [
            body.mesh.bounding_box.vertices @ poses[body.link, :3, :3].T + poses[body.link, :3, 3]
            for body in self._bodies
        ] or [poses[:, :3, 3]]
        points = np.concatenate(corners)
        return np.array([points.min(axis=0), points.max(axis=0)])

    @property
    def extent(self) -> float:
        """Largest extent of the robot [m] along x, y or z of frame 0, at the first positions."""
        return float(np.ptp(self.bounds, axis=0).max()) or self.robot.characteristic_length

    @property
    def centre(self) -> Array:
        """(3,) centre of the robot at the first positions [m]."""
        return np.asarray(self.bounds.mean(axis=0))
