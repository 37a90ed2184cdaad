"""List the robots that ship with the package."""

import sys
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from robot_dynamics.cli.text_table import print_table
from robot_dynamics.errors import MissingPackageError
from robot_dynamics.model.loading import load_robot, shipped_robots

if TYPE_CHECKING:
    from robot_dynamics.cli.text_table import Cell

NAME = "robots"


def add_arguments(parser: ArgumentParser) -> None:
    """Add no arguments."""


def run(arguments: Namespace) -> None:
    """Print the table of robots; robots whose format needs a missing package are listed by name."""
    rows: list[list[Cell]] = []
    missing: MissingPackageError | None = None
    for name, path in shipped_robots().items():
        try:
            robot = load_robot(name)
        except MissingPackageError as error:
            rows.append([name, None, None, path.name])
            missing = error
        else:
            rows.append([name, len(robot.joints), "moving" if robot.moving_base else "fixed", path.name])
    print_table(["name", "joints", "base", "file"], rows)
    if missing is not None:
        print(f"robot-dynamics {NAME}: {missing}", file=sys.stderr)
