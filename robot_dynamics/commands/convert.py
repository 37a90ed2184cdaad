"""Turn a description into another: URDF, MDH table in YAML, SYMORO+ .par.

The robot stays the same; what the other format cannot say is refused, or left out and listed with --lossy. Of a table
the robot is kept, not the text: parameters and expressions become numbers, fixed rows are lumped, comments go.
"""

import sys
from pathlib import Path

from robot_dynamics.commands.robot_arguments import add_robot_arguments, robot_of
from robot_dynamics.commands.written import write_text
from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats import par_writer, urdf_writer
from robot_dynamics.model.formats.mdh_yaml_writer import write_mdh_yaml
from robot_dynamics.model.mdh_table import table

NAME = "convert"
WRITERS = {
    ".yaml": lambda robot, lossy: write_mdh_yaml(robot),
    ".yml": lambda robot, lossy: write_mdh_yaml(robot),
    ".urdf": lambda robot, lossy: urdf_writer.write_urdf(robot, lossy=lossy),
    ".par": lambda robot, lossy: par_writer.write_par(robot, lossy=lossy),
}
LOSSES = {
    ".urdf": urdf_writer.losses,
    ".par": lambda robot: [*par_writer.losses(robot), *par_writer.standing_base(robot)],
}


def add_arguments(parser):
    add_robot_arguments(parser)
    parser.add_argument("target", help=f"path to write; its ending says the format: {', '.join(WRITERS)}")
    parser.add_argument("--lossy", action="store_true", help="leave out what the format cannot say, and list it")


def run(told):
    target = Path(told.target)
    if target.suffix not in WRITERS:
        raise DescriptionError(f"{target}: the ending says the format, {', '.join(WRITERS)} are known")
    robot = robot_of(told)
    text = WRITERS[target.suffix](robot, told.lossy)
    write_text(target, text)
    print(f"{target}: robot {robot.name!r}, {len(robot.joints)} joints, {len(robot.frames)} frames")
    for sentence in LOSSES.get(target.suffix, lambda robot: [])(robot):
        print(f"left out: {sentence}", file=sys.stderr)
    nearly = sum(row.joint is None for row in table(robot))
    if nearly and told.snap is None:
        print(
            f"note: {nearly} axes are nearly parallel to those before, and have two rows each in the table: "
            "--snap makes them parallel",
            file=sys.stderr,
        )
