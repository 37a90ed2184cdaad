"""What every verb that takes a robot asks for: which one, and how it is to be read."""

from pathlib import Path

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument
from robot_dynamics.model.loading import has_urdf, read_description, read_robot
from robot_dynamics.model.minimal_frames import minimal_frames, snap_angles

MOVING_BASE_CHOICES = {"fixed": False, "moving": True, None: None}


def add_robot_arguments(parser):
    parser.add_argument("robot", help="path of a URDF, MDH table or .par, or the name of a robot that ships")
    add_description_arguments(parser)


def add_description_arguments(parser):
    """How the description of the robot is to be read."""
    parser.add_argument(
        "--values", metavar="FILE", help="YAML with `name: value` lines, for names that the description leaves open"
    )
    parser.add_argument(
        "--set", metavar="NAME=VALUE", action="append", default=[], help="one such value; comes before --values"
    )
    parser.add_argument("--base", choices=("fixed", "moving"), help="default: as the description says")
    parser.add_argument(
        "--snap",
        type=float,
        metavar="RAD",
        help="make angles that are this near to a multiple of 15 degrees that multiple (1.5708: pi/2)",
    )
    parser.add_argument(
        "--frames",
        choices=("minimal", "given"),
        help="those with the fewest numbers (default for a URDF) or those of the description (default for a table)",
    )


def load_robot_argument(arguments):
    """The Robot that parsed arguments name, in the frames that they ask for. Raises DescriptionError."""
    text, source = read_description(arguments.robot)
    robot = read_robot(text, source=source, values=_values(arguments), moving_base=MOVING_BASE_CHOICES[arguments.base])
    if arguments.snap is not None:
        if not 0 < arguments.snap < 0.1:
            raise DescriptionError(f"--snap {arguments.snap:g}: an angle between 0 and 0.1 rad is needed")
        robot = snap_angles(robot, arguments.snap)
    frames = arguments.frames or ("minimal" if has_urdf(text) else "given")
    return minimal_frames(robot) if frames == "minimal" else robot


def _values(arguments):
    values = {}
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
