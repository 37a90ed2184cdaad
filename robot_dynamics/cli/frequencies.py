"""Tell the natural frequencies of a robot whose links bend or whose joints are elastic, its motors and brakes holding.

At the pose where it begins, or at --pose of its platform, or at --joints. --mode K draws the K-th mode, moving. --map
draws the first frequencies over two coordinates of the platform. Pictures are HTML files that need nothing else; maps
may be PNG too.
"""

import os
from pathlib import Path

import numpy as np

from robot_dynamics.cli.output_files import check_writable, output_file, write_text
from robot_dynamics.cli.pose_arguments import parse_assignments, parse_grid
from robot_dynamics.cli.progress import progress_bar
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.cli.text_table import print_table
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.flexible.frequency_map import frequency_map
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.platform_dynamics import check_coordinate, coordinates_from_pose, pose_from_coordinates

NAME = "frequencies"


def add_arguments(parser):
    add_robot_arguments(parser)
    parser.add_argument("--pose", metavar="x=..,yaw=..", help="of the platform [m, rad]; default: where it begins")
    parser.add_argument("--joints", metavar="NAME=..,..", help="positions of joints [rad, m]; the rest is zero")
    parser.add_argument("--held", metavar="NAME,..", help="joints that do not move; default: with motors or brakes")
    parser.add_argument("--count", type=int, default=10, help="how many frequencies; default: 10")
    parser.add_argument("--mode", type=int, metavar="K", help="draw this mode into --output, an .html")
    parser.add_argument("--map", metavar="x:LOW:HIGH:N,y:..", help="draw a map into --output, an .html or .png")
    parser.add_argument("--output", metavar="FILE", help="default: mode.html or map.html")


def run(arguments):
    if arguments.count < 1:
        raise InvalidInputError(f"--count {arguments.count}: 1 or more is needed")
    dynamics = Dynamics(load_robot_argument(arguments))
    if arguments.map is not None:
        draw_map(arguments, dynamics)
        return
    held = None if arguments.held is None else [name for name in arguments.held.split(",") if name]
    elastodynamics = dynamics.elastodynamics if held is None else Elastodynamics(dynamics, held)
    q = parse_positions(arguments, dynamics)
    found = elastodynamics.natural_frequencies(q)
    if not len(found.frequencies):
        raise InvalidInputError(
            f"{dynamics.robot.name!r} has no natural frequencies: it has neither beams nor elastic joints"
        )
    rows = [
        [k + 1, float(f), dominant_coordinate(found, k)] for k, f in enumerate(found.frequencies[: arguments.count])
    ]
    title = f"Natural frequencies of {dynamics.robot.name!r}, {len(found.frequencies)} in all"
    print_table(["mode", "Hz", "moves most"], rows, title)
    if arguments.mode is not None:
        draw_mode(arguments, dynamics.robot.name, elastodynamics, q, found)


def dominant_coordinate(found, k):
    """Name of the coordinate that a mode moves most [rad or m]."""
    shape = np.abs(found.mode_shapes[k])
    return found.coordinates[int(np.argmax(shape))] if shape.any() else ""


def parse_positions(arguments, dynamics):
    """(all joints,) positions that --pose or --joints tell."""
    if arguments.pose is not None and arguments.joints is not None:
        raise InvalidInputError("--pose and --joints say the same twice: give one of the two")
    if arguments.joints is None and dynamics.robot.platforms:
        start = coordinates_from_pose(dynamics.platform.pose(dynamics.initial_joint_positions))
        for name, value in parse_assignments("--pose", arguments.pose).items():
            check_coordinate(name, dynamics.platform.free)
            start[COORDINATES.index(name)] = value
        return dynamics.platform.joint_positions(pose_from_coordinates(start))
    if arguments.pose is not None:
        raise InvalidInputError(f"{dynamics.robot.name!r} has no platform: ask by --joints")
    given = parse_assignments("--joints", arguments.joints, dynamics.joint_names, "joint")
    return dynamics.expand_positions(np.array([given.get(name, 0.0) for name in dynamics.joint_names]))


def draw_map(arguments, dynamics):
    from robot_dynamics.cli import frequency_plots  # what draws takes its time to be imported

    if arguments.joints is not None or arguments.held is not None:
        raise InvalidInputError(
            "--map goes with --pose, which tells the other coordinates: leave out --joints and --held"
        )
    path = output(arguments, "map.html", (".html", ".png"))
    axes, at = parse_grid("--map", arguments.map, counts=(2,)), parse_assignments("--pose", arguments.pose)
    if path.suffix == ".html":
        frequency_plots.import_plotly()  # missing, it stops the verb before the work
    threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with progress_bar(100, "poses", "%") as progress:
        found = frequency_map(dynamics, axes, at, arguments.count, threads, lambda share: progress(100 * share))
    if path.suffix == ".png":
        with output_file(path):
            frequency_plots.save_map_png(dynamics.robot.name, found, path)
    else:
        write_text(path, frequency_plots.map_html(dynamics.robot.name, found))
    print(f"{path}: {found.reachable.sum()} of {found.reachable.size} poses reached")
    if found.reachable.any():
        ranges = [(k + 1, *(float(of(found.frequencies[..., k])) for of in (np.nanmin, np.nanmax)))
                  for k in range(found.frequencies.shape[-1])]  # fmt: skip
        print_table(["mode", "least Hz", "greatest Hz"], ranges, f"Natural frequencies of {dynamics.robot.name!r}")


def draw_mode(arguments, name, elastodynamics, q, found):
    from robot_dynamics.cli import frequency_plots

    if not 1 <= arguments.mode <= len(found.frequencies):
        raise InvalidInputError(f"--mode {arguments.mode}: there are modes 1 to {len(found.frequencies)}")
    path = output(arguments, "mode.html", (".html",))
    rests, moves = elastodynamics.node_positions(q, found.mode_shapes[arguments.mode - 1])
    title = f"mode {arguments.mode}, {found.frequencies[arguments.mode - 1]:.4g} Hz"
    write_text(path, frequency_plots.mode_html(name, title, rests, moves, elastodynamics.segments))
    print(f"{path}: {title}")


def output(arguments, default, suffixes):
    path = Path(arguments.output or default)
    if path.suffix not in suffixes:
        raise InvalidInputError(f"--output {path}: a file that ends with {' or '.join(suffixes)} is written")
    check_writable(path)
    return path
