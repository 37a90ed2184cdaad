"""A robot that is drawn and moved: its positions, its shapes in the scene, and what is drawn over them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.viewing.configuration import Configuration
from robot_dynamics.viewing.latest_task import LatestTask
from robot_dynamics.viewing.overlays import (
    EffortOverlay,
    FrameOverlay,
    InertiaOverlay,
    MassOverlay,
    MDHOverlay,
    NameOverlay,
)
from robot_dynamics.viewing.robot_bodies import robot_bodies
from robot_dynamics.viewing.scene import RobotScene
from robot_dynamics.viewing.skeleton import Skeleton

if TYPE_CHECKING:
    from collections.abc import Callable

    from viser import ViserServer

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.overlays import Overlay


class RobotView:
    """A robot in the scene of a server.

    Motions are drawn in a thread of their own, the newest one first; efforts and singular positions are computed when
    no motion waits.

    Parameters
    ----------
    server : viser.ViserServer
    robot : Robot

    Attributes
    ----------
    configuration : Configuration
        Positions of the robot.
    external_wrenches : dict of str to ndarray
        Wrenches (6,) on links that the efforts counter [N, N m], in the link frames.
    on_move, on_efforts : list of callable
        Called after the robot moved, and with new efforts (n,) of the independent joints.
    """

    def __init__(self, server: ViserServer, robot: Robot) -> None:
        self.robot = robot
        self.configuration = Configuration(robot)
        self.external_wrenches: dict[str, Array] = {}
        self.on_move: list[Callable[[], None]] = []
        self.on_efforts: list[Callable[[Array], None]] = []
        self._server = server
        skeleton = Skeleton(robot, self.configuration.q)
        self.extent = skeleton.extent
        self.origins = skeleton.origins
        self.scene = RobotScene(server.scene, robot, robot_bodies(robot, skeleton))
        self._efforts = EffortOverlay(server.scene, self.scene, skeleton.radius, self.configuration.independent)
        self.overlays: list[Overlay] = [
            NameOverlay(server.scene, self.scene),
            FrameOverlay(server.scene, self.scene, skeleton.radius),
            MDHOverlay(server.scene, self.scene, skeleton.radius),
            MassOverlay(server.scene, self.scene, skeleton.radius),
            InertiaOverlay(server.scene, self.scene),
            self._efforts,
        ]
        self.tasks = LatestTask(self.draw_efforts)
        self.draw()
        self.draw_efforts()

    def move(self, motion: Callable[[Configuration], bool]) -> None:
        """Move the robot soon, and draw it; a motion that waits is replaced.

        Parameters
        ----------
        motion : callable
            Moves a Configuration, and returns whether that was possible.
        """
        self.tasks.submit(lambda: self._move(motion))

    def refresh(self) -> None:
        """Compute and draw the efforts again soon."""
        self.tasks.submit(lambda: None)

    def _move(self, motion: Callable[[Configuration], bool]) -> None:
        motion(self.configuration)
        self.draw()
        for callback in self.on_move:
            callback()

    def draw(self) -> None:
        """Draw the robot where it is."""
        poses = self.configuration.link_poses()
        with self._server.atomic():
            self.scene.move(poses)
            for overlay in self.overlays:
                overlay.update(self.configuration, poses)
        self._server.flush()

    def draw_efforts(self) -> None:
        """Draw the efforts that hold the robot where it is, and draw it red where it is singular."""
        efforts = self.configuration.holding_efforts(self.external_wrenches or None)
        is_singular = bool(self.configuration.problem) or self.configuration.is_singular
        with self._server.atomic():
            self._efforts.draw(efforts, self.configuration.link_poses())
            self.scene.mark_singular(is_singular)
        for callback in self.on_efforts:
            callback(efforts)
        self._server.flush()

    def close(self) -> None:
        """End the thread that draws."""
        self.tasks.close()

    @property
    def centre(self) -> Array:
        """(3,) centre of the robot at its initial positions [m]."""
        return np.asarray((self.origins.min(axis=0) + self.origins.max(axis=0)) / 2)
