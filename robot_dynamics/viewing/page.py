"""A page with a robot as one file, which opens without a network and without a server."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

from robot_dynamics.viewing.page_server import HOST, frame_camera, make_server, stop_server
from robot_dynamics.viewing.played_motion import sweep_joints
from robot_dynamics.viewing.robot_view import RobotView

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.played_motion import PlayedMotion

FRAME_RATE = 24.0


def robot_page(robot: Robot, motion: PlayedMotion | None = None) -> str:
    """Return the HTML page of a robot, with a motion that is played.

    Parameters
    ----------
    robot : Robot
    motion : PlayedMotion, optional
        Default: each joint moves through its range.

    Raises
    ------
    MissingPackageError
        viser is not installed.
    """
    server = make_server(robot.name, 0, HOST)
    try:
        view = RobotView(server, robot)
        frame_camera(server, view)
        motion = sweep_joints(view.configuration, view.extent) if motion is None else motion
        recorder = server.get_scene_serializer()
        for number in range(max(1, int(motion.duration * FRAME_RATE))):
            view.configuration.q = motion.at(number / FRAME_RATE)
            view.draw()
            recorder.insert_sleep(1 / FRAME_RATE)
        page = str(recorder.as_html())
        view.close()
    finally:
        stop_server(server)
    return re.sub("<title>.*?</title>", lambda _: f"<title>{escape(robot.name)}</title>", page, count=1)
