"""Convert a description to another format: URDF, MDH table in YAML, or SYMORO+ .par.

The robot stays the same. Properties that the target format cannot express are errors, or are left out and listed with
--lossy. From a table only the robot is kept: parameters and expressions become numbers, fixed rows are merged into
their links, and comments are dropped.

A URDF shows in RViz: a robot without visual shapes is drawn with rods and joint symbols.
"""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.cli.output_files import check_ending, write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.par import writer as par_writer
from robot_dynamics.model.formats.urdf import writer as urdf_writer
from robot_dynamics.model.mdh_table import build_mdh_table

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot

NAME = "convert"
WRITERS: dict[str, Callable[[Robot, bool], str]] = {
    ".yaml": lambda robot, lossy: write_mdh_yaml(robot),
    ".yml": lambda robot, lossy: write_mdh_yaml(robot),
    ".urdf": lambda robot, lossy: urdf_writer.write_urdf(robot, lossy=lossy),
    ".par": lambda robot, lossy: par_writer.write_par(robot, lossy=lossy),
}
OMISSIONS: dict[str, Callable[[Robot], list[str]]] = {
    ".urdf": urdf_writer.find_losses,
    ".par": lambda robot: [*par_writer.find_losses(robot), *par_writer.find_harmless_losses(robot)],
}


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument("target", help=f"output path; its ending selects the format: {', '.join(WRITERS)}")
    parser.add_argument(
        "--lossy", action="store_true", help="leave out properties that the format cannot express, and list them"
    )
    parser.add_argument(
        "--no-visuals", action="store_true", help="write a URDF without visual shapes; neither keep nor draw any"
    )


def run(arguments: Namespace) -> None:
    """Write the robot in the format of the target."""
    target = Path(arguments.target)
    ending = check_ending(target, WRITERS)
    robot = load_robot_argument(arguments)
    if ending == ".urdf":
        robot = _with_visuals(robot, arguments)
    text = WRITERS[ending](robot, arguments.lossy)
    write_text(target, text)
    print(f"{target}: robot {robot.name!r}, {len(robot.joints)} joints, {len(robot.frames)} frames")
    for omission in OMISSIONS.get(ending, lambda robot: [])(robot):
        print(f"left out: {omission}", file=sys.stderr)
    if ending == ".urdf":
        shapes = "" if arguments.no_visuals else " and visual shapes"
        print(
            f"note: the URDF has what the dynamics need{shapes}, without collision shapes, transmissions and "
            "elements of simulators",
            file=sys.stderr,
        )
    offset_rows = sum(row.joint is None for row in build_mdh_table(robot))
    if offset_rows and arguments.snap is None:
        print(
            f"note: {offset_rows} axes are nearly parallel to the previous axis and need two rows of the table each: "
            "--snap makes them parallel",
            file=sys.stderr,
        )


def _with_visuals(robot: Robot, arguments: Namespace) -> Robot:
    """Return the robot with the shapes that its URDF has."""
    if arguments.no_visuals:
        return replace(robot, visuals=())
    from robot_dynamics.viewing.skeleton import add_skeleton  # here, because other formats do not need it

    return add_skeleton(robot)
