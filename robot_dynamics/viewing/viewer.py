"""The page that shows a robot and moves it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.viewing.assembly_panel import AssemblyPanel
from robot_dynamics.viewing.load_panels import PayloadPanel, WrenchPanel
from robot_dynamics.viewing.mode_panel import ModePanel
from robot_dynamics.viewing.motion_panel import MotionPanel
from robot_dynamics.viewing.name_panel import NamePanel
from robot_dynamics.viewing.page_server import HOST, MOTION_DISTANCE, frame_camera, make_server, stop_server
from robot_dynamics.viewing.panels import JointPanel, OverlayPanel, PlatformPanel, StatusPanel
from robot_dynamics.viewing.robot_view import RobotView

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.played_motion import PlayedMotion

PORT = 8080


class Viewer:
    """Serves the page of a robot until it is closed.

    Parameters
    ----------
    robot : Robot
    port : int
        TCP port; the next free one if it is taken. Default: 8080.
    host : str
        Address to listen on. Default: this machine alone. The page has no password.
    motion : PlayedMotion, optional
        A motion to play.
    packages : mapping of str to Path, optional
        Folders of packages by name, which mesh files may be in.

    Attributes
    ----------
    view : RobotView
        The robot in the page.

    Raises
    ------
    MissingPackageError
        viser is not installed.
    """

    def __init__(
        self,
        robot: Robot,
        port: int = PORT,
        host: str = HOST,
        motion: PlayedMotion | None = None,
        packages: Mapping[str, Path] | None = None,
    ) -> None:
        self.server = make_server(robot.name, port, host)
        try:
            self.view = RobotView(self.server, robot, packages)
        except BaseException:
            stop_server(self.server)
            raise
        if motion is None:
            frame_camera(self.server, self.view.bounds)
        else:
            frame_camera(self.server, self.view.bounds_along(motion.some_positions()), MOTION_DISTANCE)
        gui = self.server.gui
        StatusPanel(gui, self.view)
        self.name_panel = NamePanel(gui, self.server.scene, self.view)
        self.platform_panels = [
            PlatformPanel(gui, self.view, link, platform.free)
            for link, platform in zip(robot.platform_links, robot.platforms, strict=True)
        ]
        self.joint_panel = JointPanel(gui, self.view)
        self.assembly_panel = AssemblyPanel(gui, self.view) if robot.loops else None
        self.motion_panel = None if motion is None else MotionPanel(gui, self.view, motion)
        self._mode_panel = ModePanel(self.server, self.view) if is_elastic(robot) else None
        self.overlay_panel = OverlayPanel(gui, self.view)
        self.wrench_panel = WrenchPanel(gui, self.server.scene, self.view)
        self.payload_panel = PayloadPanel(gui, self.view)
        self.view.draw()
        self.view.draw_efforts()
        if self.motion_panel is not None:
            self.motion_panel.move_to(0.0)

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{self.server.get_host()}:{self.server.get_port()}"

    def close(self) -> None:
        """Stop serving."""
        for panel in (self.assembly_panel, self.motion_panel, self._mode_panel):
            if panel is not None:
                panel.close()
        self.view.close()
        stop_server(self.server)


def is_elastic(robot: Robot) -> bool:
    """Return whether a robot has natural frequencies: beams, or joints with springs."""
    return any(link.flexibility is not None for link in robot.links) or any(
        joint.spring is not None for joint in robot.joints
    )
