"""Map the workspace of a platform over a grid of poses: reach, condition number and efforts.

One or two coordinates of the platform vary, the others are fixed. A pose is in reach if all legs close with the motors
within their limits. The condition number is that of the map from motor to platform velocities, with angles scaled by
the size of the robot: the larger it is, the worse the motors hold the platform. Poses with a very large condition
number count as singular. The efforts hold the platform at rest, or give it --acceleration.
"""

from __future__ import annotations

import csv
from argparse import ArgumentParser, Namespace
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.output_files import check_ending, check_writable, output_file, write_text
from robot_dynamics.cli.pose_arguments import parse_assignments, parse_grid, parse_scale
from robot_dynamics.cli.progress import progress_bar
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS, pose_map
from robot_dynamics.plots.colour_scale import CONDITION_SCALE

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.pose_map import PoseMap

NAME = "map"
ENDINGS = (".png", ".pdf", ".svg", ".jpg", ".html")


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument(
        "--over",
        required=True,
        metavar="NAME:FROM:TO:COUNT[,...]",
        help="grid over one or two of x, y, z [m], yaw, pitch, roll [rad]: x:-0.1:0.1:41,z:1:2:41",
    )
    parser.add_argument(
        "--at",
        default="",
        metavar="NAME=VALUE[,...]",
        help="values of the other coordinates (default: those of the initial pose)",
    )
    parser.add_argument(
        "--acceleration",
        type=float,
        nargs=6,
        metavar="A",
        help="acceleration of the platform in its own frame: x y z [m/s²], about x y z [rad/s²]",
    )
    parser.add_argument(
        "--output",
        metavar="FILE",
        default="map.png",
        help=f"output file: a picture, or a page with the values under the cursor: {', '.join(ENDINGS)} "
        "(default: %(default)s)",
    )
    parser.add_argument(
        "--condition-range", metavar="LOW:HIGH", help="colour scale of the condition number (default: 1:100)"
    )
    parser.add_argument(
        "--effort-range",
        metavar="LOW:HIGH",
        help="colour scale of the largest effort [N m or N], to compare maps (default: the efforts of the map)",
    )
    parser.add_argument("--csv", metavar="FILE", help="output file of a table of all poses")


def run(arguments: Namespace) -> None:
    """Compute the map, print a summary, and write the picture and the table."""
    axes = parse_grid("--over", arguments.over)
    fixed_coordinates = parse_assignments("--at", arguments.at)
    is_page = check_ending(arguments.output, ENDINGS, "--output") == ".html"
    scales = (
        parse_scale("--condition-range", arguments.condition_range) or CONDITION_SCALE,
        parse_scale("--effort-range", arguments.effort_range),
    )
    for path in filter(None, (arguments.output, arguments.csv)):
        check_writable(path)
    from robot_dynamics.plots import map_page, pose_map_plot  # here, because they take half a second to import

    if is_page:
        map_page.import_plotly()  # fails before the computation if plotly is missing
    dynamics = Dynamics(load_robot_argument(arguments))
    dynamics.platform  # noqa: B018 (raises before the computation if the robot has no platform)
    result = _compute_map(dynamics, axes, fixed_coordinates, arguments.acceleration)
    print("\n".join(_summary(result, dynamics.robot)))
    if is_page:
        write_text(arguments.output, map_page.pose_map_page(result, dynamics.robot, arguments.acceleration, *scales))
    else:
        with output_file(arguments.output) as file:
            pose_map_plot.draw_pose_map(file, result, dynamics.robot, arguments.acceleration, *scales)
    if arguments.csv:
        with output_file(arguments.csv) as file:
            _write_table(file, result, dynamics.robot)
    print(
        f"{'page' if is_page else 'picture'}: {arguments.output}"
        + (f", table: {arguments.csv}" if arguments.csv else "")
    )


def _compute_map(
    dynamics: Dynamics,
    axes: Mapping[str, Array],
    fixed_coordinates: Mapping[str, float],
    acceleration: Sequence[float] | None,
) -> PoseMap:
    """Compute the map with a progress bar."""
    poses = int(np.prod([len(values) for values in axes.values()]))
    with progress_bar(poses, dynamics.robot.name, " poses") as show_progress:
        return pose_map(
            dynamics, axes, fixed_coordinates, acceleration, lambda share: show_progress(round(share * poses))
        )


def _summary(result: PoseMap, robot: Robot) -> Iterator[str]:
    """Yield the lines of the summary."""
    yield f"{robot.name}: {result.within_limits.sum()} of {result.within_limits.size} poses are in reach"
    beyond_limits = (result.reachable & ~result.within_limits).sum()
    if beyond_limits:
        yield f"  {beyond_limits} more: the legs close, but motors are beyond their limits"
    singular = (result.within_limits & ~result.is_nonsingular).sum()
    if singular:
        yield f"  {singular} of those in reach: the motors do not hold the platform (singular)"
    if result.is_nonsingular.any():
        condition_numbers = result.condition_number[result.is_nonsingular]
        yield f"  condition number {condition_numbers.min():.4g} to {condition_numbers.max():.4g}"
        units = effort_units(result, robot)
        efforts = [
            f"{name} {np.nanmax(np.abs(result.efforts[..., k])):.4g} {unit}"
            for k, (name, unit) in enumerate(zip(result.joint_names, units, strict=True))
        ]
        yield f"  largest efforts: {', '.join(efforts)}"


def effort_units(result: PoseMap, robot: Robot) -> list[str]:
    """Return the unit of the effort of each motor."""
    return ["N" if robot.joints[robot.joint_numbers[name]].prismatic else "N m" for name in result.joint_names]


def _write_table(path: Path, result: PoseMap, robot: Robot) -> None:
    """Write one row for each pose; undefined values are empty."""
    units = effort_units(result, robot)
    header = [f"{name} [{COORDINATE_UNITS[name]}]" for name in result.axes]
    header += ["legs close", "in reach", "condition number"]
    for name, unit in zip(result.joint_names, units, strict=True):
        header.append(f"position {name} [{'m' if unit == 'N' else 'rad'}]")
    for name, unit in zip(result.joint_names, units, strict=True):
        header.append(f"effort {name} [{unit}]")
    axes = [np.asarray(values, dtype=float) for values in result.axes.values()]
    with path.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        for index in np.ndindex(result.within_limits.shape):
            pose = [coordinates[k] for coordinates, k in zip(axes, index, strict=True)]
            states = [int(result.reachable[index]), int(result.within_limits[index])]
            values = [result.condition_number[index], *result.positions[index], *result.efforts[index]]
            writer.writerow([*map(_format_value, pose), *states, *map(_format_value, values)])


def _format_value(value: float) -> str:
    return "" if np.isnan(value) else repr(float(value))
