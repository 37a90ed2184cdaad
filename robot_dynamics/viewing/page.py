"""A page with a robot as one file, which opens without a network and without a server."""

from __future__ import annotations

import re
from html import escape
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.viewing.mode_geometry import ModeGeometry
from robot_dynamics.viewing.mode_view import ModeView
from robot_dynamics.viewing.page_server import HOST, MOTION_DISTANCE, frame_camera, make_server, stop_server
from robot_dynamics.viewing.played_motion import sweep_joints
from robot_dynamics.viewing.robot_view import RobotView

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from robot_dynamics.array_types import Array
    from robot_dynamics.flexible.elastodynamics import Elastodynamics
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.played_motion import PlayedMotion

FRAME_RATE = 24.0
MODE_FRAMES = 36
MODE_AMPLITUDE = 0.1


def robot_page(
    robot: Robot, motion: PlayedMotion | None = None, packages: Mapping[str, Path] | None = None
) -> tuple[str, tuple[str, ...]]:
    """Return the HTML page of a robot, with a motion that is played.

    Parameters
    ----------
    robot : Robot
    motion : PlayedMotion, optional
        Default: each joint moves through its range.
    packages : mapping of str to Path, optional
        Folders of packages by name, which mesh files may be in.

    Returns
    -------
    page : str
        The text of the page.
    warnings : tuple of str
        A sentence for each mesh that is missing or refused.

    Raises
    ------
    MissingPackageError
        viser is not installed.
    """
    server = make_server(robot.name, 0, HOST)
    try:
        view = RobotView(server, robot, packages)
        view.draw_efforts()
        motion = sweep_joints(view.configuration, view.extent) if motion is None else motion
        frame_camera(server, view.bounds_along(motion.some_positions()), MOTION_DISTANCE)
        if motion.reference is not None:
            view.add_reference()
        recorder = server.get_scene_serializer()
        for number in range(max(1, int(motion.duration * FRAME_RATE))):
            view.configuration.q = motion.at(number / FRAME_RATE)
            view.reference = motion.reference_at(number / FRAME_RATE)
            view.draw()
            recorder.insert_sleep(1 / FRAME_RATE)
        page = str(recorder.as_html())
        view.close()
    finally:
        stop_server(server)
    return titled(page, robot.name), view.warnings


def mode_page(elastodynamics: Elastodynamics, q: Array, title: str, mode_shape: Array) -> str:
    """Return the HTML page of a mode that oscillates.

    Parameters
    ----------
    elastodynamics : Elastodynamics
    q : ndarray, shape (all joints,)
        Positions that close the loops [rad or m].
    title : str
        Text above the picture.
    mode_shape : ndarray, shape (g,)
        A row of `NaturalFrequencies.mode_shapes`.

    Raises
    ------
    MissingPackageError
        viser is not installed.
    """
    name = elastodynamics.robot.name
    server = make_server(name, 0, HOST)
    try:
        geometry = ModeGeometry(elastodynamics, q)
        view = ModeView(server.scene, geometry)
        frame_camera(server, geometry.bounds)
        server.scene.add_label("/title", title, position=geometry.bounds.max(axis=0))
        view.choose(mode_shape, MODE_AMPLITUDE)
        recorder = server.get_scene_serializer()
        for number in range(MODE_FRAMES):
            with server.atomic():
                view.draw(2 * np.pi * number / MODE_FRAMES)
            recorder.insert_sleep(1 / FRAME_RATE)
        page = str(recorder.as_html())
    finally:
        stop_server(server)
    return titled(page, f"{name}: {title}")


def titled(page: str, title: str) -> str:
    """Return a page with another title."""
    return re.sub("<title>.*?</title>", lambda _: f"<title>{escape(title)}</title>", page, count=1)
