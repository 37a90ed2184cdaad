"""Turn a description into another: URDF, MDH table in YAML, SYMORO+ .par.

The robot stays the same; what the other format cannot say is refused, or left out and listed with --lossy. Of a table
the robot is kept, not the text: parameters and expressions become numbers, fixed rows are lumped, comments go.
"""

import sys
from pathlib import Path

from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.model.formats.par import writer as par_writer
from robot_dynamics.model.formats.urdf import writer as urdf_writer
from robot_dynamics.model.mdh_table import build_mdh_table

NAME = "convert"
WRITERS = {
    ".yaml": lambda robot, lossy: write_mdh_yaml(robot),
    ".yml": lambda robot, lossy: write_mdh_yaml(robot),
    ".urdf": lambda robot, lossy: urdf_writer.write_urdf(robot, lossy=lossy),
    ".par": lambda robot, lossy: par_writer.write_par(robot, lossy=lossy),
}
OMISSIONS = {
    ".urdf": urdf_writer.find_losses,
    ".par": lambda robot: [*par_writer.find_losses(robot), *par_writer.find_base_loss(robot)],
}


def add_arguments(parser):
    add_robot_arguments(parser)
    parser.add_argument("target", help=f"path to write; its ending says the format: {', '.join(WRITERS)}")
    parser.add_argument("--lossy", action="store_true", help="leave out what the format cannot say, and list it")


def run(arguments):
    target = Path(arguments.target)
    if target.suffix not in WRITERS:
        raise DescriptionError(f"{target}: the ending says the format, {', '.join(WRITERS)} are known")
    robot = load_robot_argument(arguments)
    text = WRITERS[target.suffix](robot, arguments.lossy)
    write_text(target, text)
    print(f"{target}: robot {robot.name!r}, {len(robot.joints)} joints, {len(robot.frames)} frames")
    for sentence in OMISSIONS.get(target.suffix, lambda robot: [])(robot):
        print(f"left out: {sentence}", file=sys.stderr)
    nearly = sum(row.joint is None for row in build_mdh_table(robot))
    if nearly and arguments.snap is None:
        print(
            f"note: {nearly} axes are nearly parallel to those before, and have two rows each in the table: "
            "--snap makes them parallel",
            file=sys.stderr,
        )
