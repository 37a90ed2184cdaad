"""Show a robot in the browser, in three dimensions, and move it.

The page has a slider for each independent joint and for each coordinate of a platform; loops stay closed. It can show
names, frames, MDH parameters, masses, and the efforts that hold the robot. Robots without visual geometry are drawn as
bones and joint symbols. The page is served on this machine alone, until Ctrl-C.

--output writes a page as one file instead, which needs neither a server nor a network. It plays a motion: that of
--motion, or each joint through its range.
"""

from __future__ import annotations

import signal
from argparse import ArgumentParser, Namespace
from contextlib import suppress
from pathlib import Path

from robot_dynamics.cli.output_files import check_ending, check_writable, write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError

NAME = "view"
ENDINGS = (".html",)
DEFAULT_PORT = 8080
MAX_PORT = 65535


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument("--output", metavar="FILE.html", help="write the page as one file instead of serving it")
    parser.add_argument(
        "--motion", metavar="FILE", help="bag or CSV file with the positions of the joints, which the page plays"
    )
    parser.add_argument(
        "--port", type=int, default=DEFAULT_PORT, help="TCP port, or the next free one (default: %(default)s)"
    )


def run(arguments: Namespace) -> None:
    """Serve the page until an interruption, or write it into a file."""
    if not 0 < arguments.port <= MAX_PORT:
        raise InvalidInputError(f"--port {arguments.port}: a number from 1 to {MAX_PORT} is needed")
    if arguments.output is not None:
        check_ending(arguments.output, ENDINGS, "--output")
        check_writable(arguments.output)
    robot = load_robot_argument(arguments)
    from robot_dynamics.viewing.page import robot_page
    from robot_dynamics.viewing.played_motion import (
        recorded_motion,  # here, because viewing packages are slow to import
    )
    from robot_dynamics.viewing.viewer import Viewer

    motion = None if arguments.motion is None else recorded_motion(Dynamics(robot), Path(arguments.motion))
    if arguments.output is not None:
        write_text(arguments.output, robot_page(robot, motion))
        return
    viewer = Viewer(robot, port=arguments.port, motion=motion)
    try:
        print(f"{robot.name} is at {viewer.url} until Ctrl-C", flush=True)
        _wait_for_end()
    finally:
        viewer.close()


def _wait_for_end() -> None:
    """Wait until the user or the system ends the program: how a viewer ends, and no error."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        signal.pause()
