"""Tell the natural frequencies of a robot whose links bend or whose joints are elastic, its motors and brakes holding.

At the pose where it begins, or at --pose of its platform, or at --joints. --mode K draws the K-th mode, moving. --map
draws the first frequencies over two coordinates of the platform. Pictures are HTML files that need nothing else; maps
may be PNG too.
"""

import os
from pathlib import Path

import numpy as np

from robot_dynamics.commands.pose_arguments import assignments, grid
from robot_dynamics.commands.progress import bar
from robot_dynamics.commands.robot_arguments import add_robot_arguments, robot_of
from robot_dynamics.commands.text_table import print_table
from robot_dynamics.commands.written import check_writable, write_text, writing
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import QuestionError
from robot_dynamics.frequency_map import frequency_map
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.natural_frequencies import Elastodynamics
from robot_dynamics.platform import check_coordinate, coordinates, pose_of

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


def run(told):
    if told.count < 1:
        raise QuestionError(f"--count {told.count}: 1 or more is needed")
    dynamics = Dynamics(robot_of(told))
    if told.map is not None:
        draw_map(told, dynamics)
        return
    held = None if told.held is None else [name for name in told.held.split(",") if name]
    elastodynamics = dynamics.elastodynamics if held is None else Elastodynamics(dynamics, held)
    q = positions(told, dynamics)
    found = elastodynamics.natural_frequencies(q)
    if not len(found.frequencies):
        raise QuestionError(
            f"{dynamics.robot.name!r} has no natural frequencies: it has neither beams nor elastic joints"
        )
    rows = [[k + 1, float(f), mostly(found, k)] for k, f in enumerate(found.frequencies[: told.count])]
    title = f"Natural frequencies of {dynamics.robot.name!r}, {len(found.frequencies)} in all"
    print_table(["mode", "Hz", "moves most"], rows, title)
    if told.mode is not None:
        draw_mode(told, dynamics.robot.name, elastodynamics, q, found)


def mostly(found, k):
    """Name of the coordinate that a mode moves most [rad or m]."""
    shape = np.abs(found.mode_shapes[k])
    return found.coordinates[int(np.argmax(shape))] if shape.any() else ""


def positions(told, dynamics):
    """(all joints,) positions that --pose or --joints tell."""
    if told.pose is not None and told.joints is not None:
        raise QuestionError("--pose and --joints say the same twice: give one of the two")
    if told.joints is None and dynamics.robot.platforms:
        start = coordinates(dynamics.platform.pose(dynamics.closed_positions))
        for name, value in assignments("--pose", told.pose).items():
            check_coordinate(name, dynamics.platform.free)
            start[COORDINATES.index(name)] = value
        return dynamics.platform.joints(pose_of(start))
    if told.pose is not None:
        raise QuestionError(f"{dynamics.robot.name!r} has no platform: ask by --joints")
    given = assignments("--joints", told.joints, dynamics.joint_names, "joint")
    return dynamics.expand(np.array([given.get(name, 0.0) for name in dynamics.joint_names]))


def draw_map(told, dynamics):
    from robot_dynamics.commands import frequency_pictures  # what draws takes its time to be imported

    if told.joints is not None or told.held is not None:
        raise QuestionError("--map goes with --pose, which tells the other coordinates: leave out --joints and --held")
    path = output(told, "map.html", (".html", ".png"))
    axes, at = grid("--map", told.map, counts=(2,)), assignments("--pose", told.pose)
    if path.suffix == ".html":
        frequency_pictures.graph_objects()  # missing, it stops the verb before the work
    threads = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    with bar(100, "poses", "%") as progress:
        found = frequency_map(dynamics, axes, at, told.count, threads, lambda share: progress(100 * share))
    if path.suffix == ".png":
        with writing(path):
            frequency_pictures.map_picture(dynamics.robot.name, found, path)
    else:
        write_text(path, frequency_pictures.map_page(dynamics.robot.name, found))
    print(f"{path}: {found.reached.sum()} of {found.reached.size} poses reached")
    if found.reached.any():
        ranges = [(k + 1, *(float(of(found.frequencies[..., k])) for of in (np.nanmin, np.nanmax)))
                  for k in range(found.frequencies.shape[-1])]  # fmt: skip
        print_table(["mode", "least Hz", "greatest Hz"], ranges, f"Natural frequencies of {dynamics.robot.name!r}")


def draw_mode(told, name, elastodynamics, q, found):
    from robot_dynamics.commands import frequency_pictures

    if not 1 <= told.mode <= len(found.frequencies):
        raise QuestionError(f"--mode {told.mode}: there are modes 1 to {len(found.frequencies)}")
    path = output(told, "mode.html", (".html",))
    rests, moves = elastodynamics.node_positions(q, found.mode_shapes[told.mode - 1])
    title = f"mode {told.mode}, {found.frequencies[told.mode - 1]:.4g} Hz"
    write_text(path, frequency_pictures.mode_page(name, title, rests, moves, elastodynamics.segments))
    print(f"{path}: {title}")


def output(told, default, suffixes):
    path = Path(told.output or default)
    if path.suffix not in suffixes:
        raise QuestionError(f"--output {path}: a file that ends with {' or '.join(suffixes)} is written")
    check_writable(path)
    return path
