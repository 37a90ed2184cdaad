"""Show a robot in the browser, in three dimensions, and move it.

The page has a slider for each independent joint and for each coordinate of a platform; loops stay closed. It can show
names, frames, MDH parameters, masses, and the efforts that hold the robot. Robots without visual geometry are drawn as
bones and joint symbols. The page is served on this machine alone, until Ctrl-C.

--output writes a page as one file instead, which needs neither a server nor a network. It plays a motion: that of
--motion, or each joint through its range.
"""

from __future__ import annotations

import math
import signal
import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.cli.output_files import check_ending, check_writable, write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.viewing.played_motion import PlayedMotion

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
        "--reference",
        metavar="FILE",
        help="bag or CSV file with a second motion, such as the commanded one beside the measured one: a translucent "
        "robot. Times are those of one clock where the two overlap; else both begin at the same time",
    )
    parser.add_argument(
        "--reference-delay",
        metavar="SECONDS",
        type=float,
        help="time from the first sample of the motion to the first one of the reference",
    )
    parser.add_argument(
        "--package",
        metavar="NAME=FOLDER",
        action="append",
        default=[],
        help="folder of a package with mesh files; repeat for several (default: packages of the ROS environment, and "
        "the package around the description)",
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
    if arguments.reference is not None and arguments.motion is None:
        raise InvalidInputError("--reference is a second motion: give the first one with --motion")
    if arguments.reference_delay is not None and (
        arguments.reference is None or not math.isfinite(arguments.reference_delay)
    ):
        raise InvalidInputError("--reference-delay: a finite number of seconds, and a --reference, are needed")
    robot = load_robot_argument(arguments)
    from robot_dynamics.viewing.page import robot_page  # here, because viewing packages are slow to import
    from robot_dynamics.viewing.viewer import Viewer

    motion = None if arguments.motion is None else read_motion(robot, arguments)
    packages = parse_packages(arguments.package)
    if arguments.output is not None:
        page, warnings = robot_page(robot, motion, packages)
        print_warnings(arguments.robot, warnings)
        write_text(arguments.output, page)
        print(f"page: {arguments.output}")
        return
    viewer = Viewer(robot, port=arguments.port, motion=motion, packages=packages)
    try:
        print_warnings(arguments.robot, viewer.view.warnings)
        taken = "" if viewer.server.get_port() == arguments.port else f"port {arguments.port} is taken: "
        _wait_for_end(f"{taken}{robot.name} is at {viewer.url} until Ctrl-C")
    finally:
        viewer.close()


def read_motion(robot: Robot, arguments: Namespace) -> PlayedMotion:
    """Read the motion, and the reference that is drawn beside it."""
    from robot_dynamics.viewing.played_motion import recorded_motion

    dynamics = Dynamics(robot)
    motion = recorded_motion(dynamics, Path(arguments.motion))
    if arguments.reference is None:
        return motion
    return motion.beside(recorded_motion(dynamics, Path(arguments.reference)), arguments.reference_delay)


def parse_packages(settings: Iterable[str]) -> dict[str, Path]:
    """Return the folders of packages by name, from NAME=FOLDER. Raises InvalidInputError."""
    packages = {}
    for setting in settings:
        name, equals, folder = setting.partition("=")
        if not equals or not name or not Path(folder).is_dir():
            raise InvalidInputError(f"--package {setting}: NAME=FOLDER is needed, with a folder that exists")
        packages[name] = Path(folder)
    return packages


def print_warnings(robot: str, warnings: Iterable[str]) -> None:
    """Print what is not drawn to stderr."""
    for warning in warnings:
        print(f"WARNING: {robot}: {warning}", file=sys.stderr)


def _wait_for_end(message: str) -> None:
    """Print a message, and wait until the user or the system ends the program: how a viewer ends, and no error."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with suppress(KeyboardInterrupt):
        print(message, flush=True)
        signal.pause()
    for ending in (signal.SIGTERM, signal.SIGINT):  # another one must not interrupt the closing
        signal.signal(ending, signal.SIG_IGN)
