"""Write a model of a robot as straight-line code: C99 for a controller, or Python to read.

The code needs nothing but <math.h> or `math`, allocates nothing and keeps no state. inverse, direct, inertia_matrix,
gravity, coriolis, bias (gravity and Coriolis together), regressor, pose (of --frame). What each takes and gives stands
at the top of the file. Code of two robots in one program needs two prefixes.
"""

from pathlib import Path

from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.codegen.emit.c_code import c_name, c_source
from robot_dynamics.codegen.emit.python_source import python_source
from robot_dynamics.codegen.jit.compiled_models import MODELS, available_models
from robot_dynamics.codegen.trace.models import pose_model
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import DescriptionError

NAME = "generate"


def add_arguments(parser):
    add_robot_arguments(parser)
    parser.add_argument("--model", choices=(*MODELS, "pose"), default="inverse", help="default: inverse")
    parser.add_argument("--lang", choices=("c", "python"), default="c", help="default: c")
    parser.add_argument("--output", metavar="DIR", default=".", help="folder to write into; default: here")
    parser.add_argument("--prefix", default="", help="in front of the names of functions and files, such as left_")
    parser.add_argument("--frame", help="the frame of --model pose")
    parser.add_argument(
        "--wrench", metavar="LINK", action="append", default=[],
        help="take the external wrench on this link as an argument, in its own frame (inverse, direct); any number",
    )  # fmt: skip


def run(arguments):
    robot = load_robot_argument(arguments)
    program = _program(arguments, robot)
    names, others = _joints(arguments, robot)
    if arguments.lang == "c":
        header, source = c_source(program, arguments.prefix, names, others)
        texts = {f"{c_name(program, arguments.prefix)}.h": header, f"{c_name(program, arguments.prefix)}.c": source}
    else:
        texts = {f"{c_name(program, arguments.prefix)}.py": python_source(program, names, others)}
    for name, text in texts.items():
        path = Path(arguments.output) / name
        write_text(path, text)
        print(f"{path}: {program.name} of {robot.name!r}, {program.operations}")


def _joints(arguments, robot):
    """The names of the joints of joint vectors, and (sentence, names) of vectors that have other ones."""
    dynamics = Dynamics(robot)
    if not robot.loops:
        return dynamics.joint_names, ()
    if arguments.model == "closure":
        leading = tuple(joint.name for joint in robot.joints if joint.mimic is None)
        placed = tuple(name for name in leading if name in dynamics.dependent_joint_names)
        return (), (("Joints of q, by the place of their entry", leading), ("Joints of step", placed))
    return dynamics.joint_names, (("q has all joints, at positions that close the loops", dynamics.all_joint_names),)


def _program(arguments, robot):
    if arguments.model == "pose":
        if arguments.frame is None:
            raise DescriptionError("--model pose needs --frame, the name of a frame of the robot")
        robot.frame(arguments.frame)
        return pose_model(robot, arguments.frame)
    if arguments.wrench and arguments.model not in ("inverse", "direct"):
        raise DescriptionError(f"--wrench has a meaning for inverse and direct, not for {arguments.model}")
    for link in arguments.wrench:
        robot.frame(link)
    if arguments.model not in available_models(robot):
        raise DescriptionError(f"{robot.name!r} has no loops: it has the models {', '.join(available_models(robot))}")
    options = {"wrenches": arguments.wrench} if arguments.model in ("inverse", "direct") else {}
    return MODELS[arguments.model](robot, **options)
