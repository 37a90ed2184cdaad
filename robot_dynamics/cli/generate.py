"""Generate a model of a robot as straight-line code: C99 for a controller, or Python to read.

The code needs only <math.h> or `math`, allocates no memory and keeps no state. The models are inverse, direct,
inertia_matrix, gravity, coriolis, bias (gravity and Coriolis together), friction, regressor, inverse_derivatives,
direct_derivatives, momentum (with its rate, for observers of external torques), pose (of --frame), and for robots with
loops closure (one step that closes them) and state_derivative. The top of the file describes the inputs and outputs.
Two robots in one program need two prefixes.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.codegen.emit.c_code import c_name, c_source
from robot_dynamics.codegen.emit.python_source import python_source
from robot_dynamics.codegen.jit.compiled_models import FRAME_MODEL_TRACERS, LOOP_MODELS, MODELS, available_models
from robot_dynamics.codegen.jit.program_key import SOLVING_MODELS
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import DescriptionError

if TYPE_CHECKING:
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.model.robot import Robot

NAME = "generate"
NamedVectors: TypeAlias = tuple[tuple[str, Sequence[str]], ...]
"""Sentences about vectors, each with the names of the entries."""


def add_arguments(parser: ArgumentParser) -> None:
    """Add the arguments of the verb."""
    add_robot_arguments(parser)
    parser.add_argument("--model", choices=(*MODELS, *FRAME_MODEL_TRACERS), default="inverse", help="default: inverse")
    parser.add_argument("--lang", choices=("c", "python"), default="c", help="default: c")
    parser.add_argument("--output", metavar="DIR", default=".", help="output folder (default: the current folder)")
    parser.add_argument("--prefix", default="", help="prefix of the names of functions and files, such as left_")
    parser.add_argument("--frame", help="frame of --model pose, jacobian or bias_acceleration")
    parser.add_argument(
        "--wrench",
        metavar="LINK",
        action="append",
        default=[],
        help="add an argument for the external wrench on this link, in its own frame (inverse, direct and their "
        "derivatives); repeat for several links",
    )


def run(arguments: Namespace) -> None:
    """Write the code of the model."""
    robot = load_robot_argument(arguments)
    program = _build_program(arguments, robot)
    joint_names, named_vectors = _entry_names(arguments.model, robot)
    file_name = c_name(program, arguments.prefix)
    if arguments.lang == "c":
        header, source = c_source(program, arguments.prefix, joint_names, named_vectors)
        texts = {f"{file_name}.h": header, f"{file_name}.c": source}
    else:
        texts = {f"{file_name}.py": python_source(program, joint_names, named_vectors)}
    for name, text in texts.items():
        path = Path(arguments.output) / name
        write_text(path, text)
        print(f"{path}: {program.name} of {robot.name!r}, {program.operations}")


def _entry_names(model: str, robot: Robot) -> tuple[Sequence[str], NamedVectors]:
    """Return the joint names of joint vectors, and sentences with the names of vectors with other entries."""
    dynamics = Dynamics(robot)
    if not robot.loops:
        return dynamics.joint_names, ()
    if model == "closure":
        variables = tuple(joint.name for joint in robot.joints if joint.mimic is None)
        dependent = tuple(name for name in variables if name in dynamics.dependent_joint_names)
        return (), (("Joints of q, by index", variables), ("Joints of step", dependent))
    return dynamics.joint_names, (("q has all joints, at positions that close the loops", dynamics.all_joint_names),)


def _build_program(arguments: Namespace, robot: Robot) -> Program:
    """Trace the model. Raises DescriptionError if the options do not fit it."""
    model = arguments.model
    if model in FRAME_MODEL_TRACERS:
        if arguments.frame is None:
            raise DescriptionError(f"--model {model} needs --frame with the name of a frame of the robot")
        robot.frame(arguments.frame)
        return FRAME_MODEL_TRACERS[model](robot, arguments.frame)
    if arguments.wrench and model not in SOLVING_MODELS:
        raise DescriptionError(f"--wrench applies to inverse, direct and their derivatives, not to {model}")
    for link in arguments.wrench:
        robot.frame(link)
    if model not in available_models(robot):
        reason = "loops" if model in LOOP_MODELS else "mass that can move"
        raise DescriptionError(f"{robot.name!r} has no {reason}: its models are {', '.join(available_models(robot))}")
    options = {"wrenches": arguments.wrench} if model in SOLVING_MODELS else {}
    return MODELS[model](robot, **options)
