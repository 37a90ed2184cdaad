"""Compute the natural frequencies of a robot with flexible links or elastic joints, with motors and brakes holding.

The pose is the initial one, --pose of the platform, or --joints. --mode K draws the K-th mode as an animation. --map
draws the lowest frequencies over two coordinates of the platform, all in one colour scale. Drawings are self-contained
HTML files; maps can be pictures too.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.output_files import check_ending, check_writable, output_file, write_text
from robot_dynamics.cli.pose_arguments import parse_assignments, parse_grid, parse_scale
from robot_dynamics.cli.progress import progress_bar
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.cli.text_table import print_table
from robot_dynamics.codegen.jit.threads import available_processors
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.flexible.frequency_map import frequency_map
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.platform_dynamics import check_coordinate, coordinates_from_pose, pose_from_coordinates

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.flexible.elastodynamics import NaturalFrequencies

NAME = "frequencies"
MODE_ENDINGS = (".html",)
MAP_ENDINGS = (".html", ".png", ".pdf", ".svg")


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument(
        "--pose", metavar="x=..,yaw=..", help="pose of the platform [m, rad] (default: its initial pose)"
    )
    parser.add_argument("--joints", metavar="NAME=..,..", help="joint positions [rad, m]; other joints are at zero")
    parser.add_argument(
        "--held", metavar="NAME,..", help="joints that do not move (default: joints with motors or brakes)"
    )
    parser.add_argument("--count", type=int, default=10, help="number of frequencies (default: %(default)s)")
    parser.add_argument("--mode", type=int, metavar="K", help="draw this mode into --output, an .html file")
    parser.add_argument("--map", metavar="x:LOW:HIGH:N,y:..", help="draw a map into --output")
    parser.add_argument(
        "--range",
        metavar="LOW:HIGH",
        help="colour scale of --map [Hz], to compare maps (default: the frequencies of the map)",
    )
    parser.add_argument("--output", metavar="FILE", help="output file of the drawing (default: mode.html or map.html)")


def run(arguments: Namespace) -> None:
    """Print the frequencies, or draw a mode or a map."""
    if arguments.count < 1:
        raise InvalidInputError(f"--count {arguments.count}: 1 or more is needed")
    dynamics = Dynamics(load_robot_argument(arguments))
    if arguments.map is not None:
        draw_map(arguments, dynamics)
        return
    held = None if arguments.held is None else [name for name in arguments.held.split(",") if name]
    elastodynamics = dynamics.elastodynamics if held is None else Elastodynamics(dynamics, held)
    q = parse_positions(arguments, dynamics)
    natural = elastodynamics.natural_frequencies(q)
    if not len(natural.frequencies):
        raise InvalidInputError(
            f"{dynamics.robot.name!r} has no natural frequencies: it has neither beams nor elastic joints"
        )
    rows: list[list[Cell]] = [
        [k + 1, float(frequency), dominant_coordinate(natural, k)]
        for k, frequency in enumerate(natural.frequencies[: arguments.count])
    ]
    title = f"Natural frequencies of {dynamics.robot.name!r}, {len(natural.frequencies)} in all"
    print_table(["mode", "Hz", "moves most"], rows, title)
    if arguments.mode is not None:
        draw_mode(arguments, elastodynamics, q, natural)


def dominant_coordinate(natural: NaturalFrequencies, k: int) -> str:
    """Return the name of the coordinate with the largest amplitude [rad or m] in mode k."""
    shape = np.abs(natural.mode_shapes[k])
    return natural.coordinates[int(np.argmax(shape))] if shape.any() else ""


def parse_positions(arguments: Namespace, dynamics: Dynamics) -> Array:
    """Compute the positions (all joints,) of --pose or --joints. Raises InvalidInputError."""
    if arguments.pose is not None and arguments.joints is not None:
        raise InvalidInputError("--pose and --joints set the same positions twice: give one of the two")
    if arguments.joints is None and dynamics.robot.platforms:
        pose = dynamics.platform.pose(dynamics.initial_joint_positions)
        if isinstance(pose, dict):
            raise InvalidInputError(
                f"{dynamics.robot.name!r} has the platforms {', '.join(pose)}: --pose is for one platform, use --joints"
            )
        coordinates = coordinates_from_pose(pose)
        for name, value in parse_assignments("--pose", arguments.pose).items():
            check_coordinate(name, dynamics.platform.free)
            coordinates[COORDINATES.index(name)] = value
        return dynamics.platform.joint_positions(pose_from_coordinates(coordinates))
    if arguments.pose is not None:
        raise InvalidInputError(f"{dynamics.robot.name!r} has no platform: use --joints")
    positions = parse_assignments("--joints", arguments.joints, dynamics.joint_names, "joint")
    return dynamics.expand_positions(np.array([positions.get(name, 0.0) for name in dynamics.joint_names]))


def draw_map(arguments: Namespace, dynamics: Dynamics) -> None:
    """Compute a map of the frequencies, draw it into a file, and print the range of each frequency."""
    from robot_dynamics.plots import frequency_map_plot, map_page  # here, because plotting packages are slow to import

    if arguments.joints is not None or arguments.held is not None:
        raise InvalidInputError(
            "--map cannot be combined with --joints and --held: set the other coordinates with --pose"
        )
    path = _output_path(arguments, "map.html", MAP_ENDINGS)
    axes = parse_grid("--map", arguments.map, counts=(2,))
    fixed_coordinates = parse_assignments("--pose", arguments.pose)
    scale = parse_scale("--range", arguments.range)
    is_html = path.suffix.lower() == ".html"
    if is_html:
        map_page.import_plotly()  # fails before the computation if plotly is missing
    threads = available_processors()
    with progress_bar(100, "poses", "%") as show_progress:
        result = frequency_map(
            dynamics, axes, fixed_coordinates, arguments.count, threads, lambda share: show_progress(100 * share)
        )
    if is_html:
        write_text(path, map_page.frequency_map_page(result, dynamics.robot.name, scale))
    else:
        with output_file(path) as file:
            frequency_map_plot.draw_frequency_map(file, result, dynamics.robot.name, scale)
    print(f"{path}: {result.reachable.sum()} of {result.reachable.size} poses reached")
    if result.reachable.any():
        rows: list[list[Cell]] = []
        for k in range(result.frequencies.shape[-1]):
            frequencies = result.frequencies[..., k]
            rows.append([k + 1, float(np.nanmin(frequencies)), float(np.nanmax(frequencies))])
        print_table(["mode", "least Hz", "greatest Hz"], rows, f"Natural frequencies of {dynamics.robot.name!r}")


def draw_mode(arguments: Namespace, elastodynamics: Elastodynamics, q: Array, natural: NaturalFrequencies) -> None:
    """Draw a mode of a robot at joint positions q (all joints,) into an HTML file."""
    from robot_dynamics.viewing.page import mode_page  # here, because viewing packages are slow to import

    if not 1 <= arguments.mode <= len(natural.frequencies):
        raise InvalidInputError(f"--mode {arguments.mode}: the robot has modes 1 to {len(natural.frequencies)}")
    path = _output_path(arguments, "mode.html", MODE_ENDINGS)
    title = f"mode {arguments.mode}, {natural.frequencies[arguments.mode - 1]:.4g} Hz"
    write_text(path, mode_page(elastodynamics, q, title, natural.mode_shapes[arguments.mode - 1]))
    print(f"{path}: {title}")


def _output_path(arguments: Namespace, default: str, endings: Sequence[str]) -> Path:
    """Return the path of --output, checked to be writable and to have one of the endings."""
    path = Path(arguments.output or default)
    check_ending(path, endings, "--output")
    check_writable(path)
    return path
