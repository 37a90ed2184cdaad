"""Arguments of the verbs that read a robot description."""

from __future__ import annotations

import sys
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument
from robot_dynamics.model.loading import has_urdf, read_description, read_robot
from robot_dynamics.model.locked_joints import lock_joints, lock_massless_joints
from robot_dynamics.model.minimal_frames import minimal_frames, snap_angles
from robot_dynamics.model.robot_warnings import find_lock_warnings, find_missing_inertials

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot

MOVING_BASE_CHOICES: dict[str | None, bool | None] = {"fixed": False, "moving": True, None: None}
MAX_SNAP_ANGLE = 0.1  # [rad]
ROBOT_HELP = (
    "path of a URDF, a xacro, an SDF, an MJCF, an MDH table or a .par, or the name of a robot that ships with the "
    "package"
)


def add_robot_arguments(parser: ArgumentParser) -> None:
    """Add the positional argument `robot` and those of `add_description_arguments`."""
    parser.add_argument("robot", help=ROBOT_HELP)
    add_description_arguments(parser)


def add_description_arguments(parser: ArgumentParser) -> None:
    """Add the options for reading a description."""
    parser.add_argument(
        "--values",
        metavar="FILE",
        help="YAML with `name: value` lines for the open parameters of the description or arguments of a xacro",
    )
    parser.add_argument(
        "--set", metavar="NAME=VALUE", action="append", default=[], help="one such value; it overrides --values"
    )
    parser.add_argument("--base", choices=("fixed", "moving"), help="default: as in the description")
    parser.add_argument(
        "--snap",
        type=float,
        metavar="RAD",
        help="round angles to a multiple of 15 degrees if they are this near to it (1.5708: pi/2)",
    )
    parser.add_argument(
        "--frames",
        choices=("minimal", "given"),
        help="frames with the fewest parameters (default for a URDF) or those of the description (default for a table)",
    )
    parser.add_argument(
        "--lock",
        metavar="JOINT=POSITION",
        action="append",
        default=[],
        help="lock a joint at a position [rad or m]: the robot is then one without it; repeat for several",
    )
    parser.add_argument(
        "--lock-massless",
        action="store_true",
        help="lock the joints outside loops that move nothing with inertia, such as a finger without mass",
    )


def load_robot_argument(arguments: Namespace) -> Robot:
    """Load the robot as `read_robot_argument` does, and print what its description lacks or what is ignored of it."""
    robot = read_robot_argument(arguments)
    for warning in (*robot.reader_warnings, *find_missing_inertials(robot), *find_lock_warnings(robot)):
        print(f"WARNING: {arguments.robot}: {warning}", file=sys.stderr)
    return robot


def read_robot_argument(arguments: Namespace) -> Robot:
    """Load the robot of parsed arguments, with its frames as the options require. Raises DescriptionError."""
    text, source = read_description(arguments.robot)
    moving_base = MOVING_BASE_CHOICES[arguments.base]
    robot = read_robot(text, source=source, values=_parameter_values(arguments), moving_base=moving_base)
    robot = lock_joints(robot, _locked_positions(arguments.lock))
    if arguments.lock_massless:
        robot = lock_massless_joints(robot)
    if arguments.snap is not None:
        if not 0 < arguments.snap < MAX_SNAP_ANGLE:
            raise DescriptionError(f"--snap {arguments.snap:g}: an angle between 0 and {MAX_SNAP_ANGLE} rad is needed")
        robot = snap_angles(robot, arguments.snap)
    frames = arguments.frames or ("minimal" if has_urdf(text) else "given")
    return minimal_frames(robot) if frames == "minimal" else robot


def _locked_positions(settings: Iterable[str]) -> dict[str, float]:
    """Return the positions of the joints of --lock, by name. Raises DescriptionError."""
    positions: dict[str, float] = {}
    for setting in settings:
        name, _, text = setting.rpartition("=")
        try:
            position = float(text)
        except ValueError:
            position = None
        if not name.strip() or position is None:
            raise DescriptionError(f"--lock {setting}: JOINT=POSITION is needed, such as finger_joint=0.02")
        if name.strip() in positions:
            raise DescriptionError(f"--lock {setting}: joint {name.strip()!r} is locked twice")
        positions[name.strip()] = position
    return positions


def _parameter_values(arguments: Namespace) -> dict[str, int | float | str]:
    """Collect the parameter values of --values and --set."""
    values: dict[str, int | float | str] = {}
    if arguments.values is not None:
        text, source = read_description(Path(arguments.values))
        document = YamlDocument(text, source, "a YAML file of `name: value` lines")
        if not isinstance(document.data, dict):
            document.fail((), "`name: value` lines are needed")
        for name, value in document.data.items():
            if isinstance(value, bool) or not isinstance(value, int | float | str):
                document.fail((name,), f"{name} is {value!r:.60}: a number or an expression is needed")
        values.update(document.data)
    for setting in arguments.set:
        name, equals, value = setting.partition("=")
        if not equals or not name.strip():
            raise DescriptionError(f"--set {setting}: NAME=VALUE is needed")
        values[name.strip()] = value
    return values
