"""Map what a platform can do over a grid of its poses: where it can be, how well the motors hold it, what it takes.

One or two coordinates of the platform vary, the others stay. A pose is in reach where all legs close with the motors
within their limits. The condition number is that between motors and platform, angles counted by the size of the robot:
the larger, the worse the motors hold it, and where it is too large the pose counts as singular. Efforts hold the
platform at rest, or give it --acceleration.
"""

import csv
from pathlib import Path

import numpy as np

from robot_dynamics.cli.output_files import check_writable, output_file
from robot_dynamics.cli.pose_arguments import parse_assignments, parse_grid
from robot_dynamics.cli.progress import progress_bar
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS, pose_map

NAME = "map"
IMAGE_SUFFIXES = (".png", ".pdf", ".svg", ".jpg")


def add_arguments(parser):
    add_robot_arguments(parser)
    parser.add_argument("--over", required=True, metavar="NAME:FROM:TO:COUNT[,...]",
                        help="one or two of x, y, z [m], yaw, pitch, roll [rad]: x:-0.1:0.1:41,z:1:2:41")  # fmt: skip
    parser.add_argument("--at", default="", metavar="NAME=VALUE[,...]",
                        help="where other coordinates stay (default: where the robot begins)")  # fmt: skip
    parser.add_argument("--acceleration", type=float, nargs=6, metavar="A",
                        help="of the platform, in its own frame: x y z [m/s²], about x y z [rad/s²]")  # fmt: skip
    parser.add_argument("--output", metavar="FILE", default="map.png",
                        help=f"the picture: {', '.join(IMAGE_SUFFIXES)} (default: %(default)s)")  # fmt: skip
    parser.add_argument("--csv", metavar="FILE", help="a table of all poses beside it")


def run(told):
    axes, at = parse_grid("--over", told.over), parse_assignments("--at", told.at)
    if Path(told.output).suffix.lower() not in IMAGE_SUFFIXES:
        raise InvalidInputError(f"--output {told.output}: a picture is one of {', '.join(IMAGE_SUFFIXES)}")
    for path in filter(None, (told.output, told.csv)):
        check_writable(path)
    dynamics = Dynamics(load_robot_argument(told))
    dynamics.platform  # noqa: B018 (refused before anything is computed or drawn where there is none)
    found = _computed(dynamics, axes, at, told.acceleration)
    print("\n".join(_summary(found, dynamics.robot)))
    from robot_dynamics.cli.map_plot import draw_pose_map  # takes half a second, which other verbs need not wait

    with output_file(told.output):
        draw_pose_map(told.output, found, dynamics.robot, told.acceleration)
    if told.csv:
        with output_file(told.csv):
            _write(told.csv, found, dynamics.robot)
    print(f"picture: {told.output}" + (f", table: {told.csv}" if told.csv else ""))


def _computed(dynamics, axes, at, acceleration):
    """The PoseMap, with a bar on a terminal that tells how far it is."""
    poses = int(np.prod([len(values) for values in axes.values()]))
    with progress_bar(poses, dynamics.robot.name, " poses") as progress:
        return pose_map(dynamics, axes, at, acceleration, lambda share: progress(round(share * poses)))


def _summary(found, robot):
    """What there is to say in some lines."""
    yield f"{robot.name}: {found.within_limits.sum()} of {found.within_limits.size} poses are in reach"
    beyond, singular = (
        (found.reachable & ~found.within_limits).sum(),
        (found.within_limits & ~found.is_nonsingular).sum(),
    )
    if beyond:
        yield f"  at {beyond} more the legs close, but with motors beyond their limits"
    if singular:
        yield f"  at {singular} of them the motors do not hold the platform (singular)"
    if found.is_nonsingular.any():
        held = found.condition_number[found.is_nonsingular]
        yield f"  condition number {held.min():.4g} to {held.max():.4g}"
        yield "  largest efforts: " + ", ".join(
            f"{name} {np.nanmax(np.abs(found.efforts[..., k])):.4g} {unit}"
            for k, (name, unit) in enumerate(zip(found.joint_names, effort_units(found, robot), strict=True))
        )


def effort_units(found, robot):
    """The unit of the effort of each motor."""
    return ["N" if robot.joints[robot.joint_numbers[name]].prismatic else "N m" for name in found.joint_names]


def _write(path, found, robot):
    """A row for each pose; what has no meaning there is left empty."""
    units = effort_units(found, robot)
    head = [
        *(f"{name} [{COORDINATE_UNITS[name]}]" for name in found.axes),
        "legs close",
        "in reach",
        "condition number",
    ]
    head += [f"position {name} [{'m' if unit == 'N' else 'rad'}]"
             for name, unit in zip(found.joint_names, units, strict=True)]  # fmt: skip
    head += [f"effort {name} [{unit}]" for name, unit in zip(found.joint_names, units, strict=True)]
    with Path(path).open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(head)
        for place in np.ndindex(found.within_limits.shape):
            pose = [values[k] for values, k in zip(found.axes.values(), place, strict=True)]
            told = [*pose, found.condition_number[place], *found.positions[place], *found.efforts[place]]
            told = ["" if np.isnan(value) else repr(float(value)) for value in told]
            state = [int(found.reachable[place]), int(found.within_limits[place])]
            writer.writerow([*told[: len(pose)], *state, *told[len(pose) :]])
