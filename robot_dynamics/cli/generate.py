"""Generate a model of a robot as straight-line code: C99 for a controller, or Python to read.

The code needs only <math.h> or `math`, allocates no memory and keeps no state. The models are inverse, direct,
inertia_matrix, gravity, coriolis, bias (gravity and Coriolis together), friction, regressor, inverse_derivatives,
direct_derivatives, momentum (with its rate, for observers of external torques), pose (of --frame), and for robots with
loops closure (one step that closes them) and state_derivative. The top of the file describes the inputs and outputs.
Two robots in one program need two prefixes. With --control it writes the model for the control laws in C++ of the
package robot_dynamics_control instead.
"""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from robot_dynamics.cli.output_files import write_text
from robot_dynamics.cli.robot_arguments import add_robot_arguments, load_robot_argument
from robot_dynamics.codegen.emit.c_code import c_name, c_source
from robot_dynamics.codegen.emit.code_text import identifier
from robot_dynamics.codegen.emit.control_model import control_model_source
from robot_dynamics.codegen.emit.cpp_header import cpp_header, cpp_namespace
from robot_dynamics.codegen.emit.python_source import python_source
from robot_dynamics.codegen.jit.compiled_models import FRAME_MODEL_TRACERS, LOOP_MODELS, MODELS, available_models
from robot_dynamics.codegen.jit.program_key import PAYLOAD_MODELS, SOLVING_MODELS
from robot_dynamics.control.exported_model import export_control_model, state_joints
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
    parser.add_argument(
        "--model",
        choices=(*MODELS, *FRAME_MODEL_TRACERS),
        action="append",
        default=[],
        help="default: inverse; repeat for several models",
    )
    parser.add_argument(
        "--lang",
        choices=("c", "cpp", "python"),
        default="c",
        help="cpp: C, and one header for C++ with functions of std::array and the joints; default: c",
    )
    parser.add_argument(
        "--control",
        action="store_true",
        help="write the model for the control laws of robot_dynamics_control: one C source with names and limits of "
        "joints, instead of --model",
    )
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
    parser.add_argument(
        "--payload",
        metavar="FRAME",
        action="append",
        default=[],
        help="add an argument for the inertia of a payload on this frame: mass, first moments, second moments (models "
        f"{', '.join(PAYLOAD_MODELS)}, and --control); repeat for several frames",
    )


def run(arguments: Namespace) -> None:
    """Write the code of the models."""
    prefix = arguments.prefix
    if prefix and (arguments.control or arguments.lang == "cpp") and identifier(f"{prefix}x") != f"{prefix}x":
        raise DescriptionError(f"--prefix {prefix}: letters, digits and single underscores are needed")
    robot = load_robot_argument(arguments)
    if arguments.control:
        _write_control_model(arguments, robot)
        return
    models = list(dict.fromkeys(arguments.model or ["inverse"]))
    programs = [_build_program(arguments, model, robot) for model in models]
    for model, program in zip(models, programs, strict=True):
        joint_names, named_vectors = _entry_names(model, robot)
        file_name = c_name(program, arguments.prefix)
        if arguments.lang == "python":
            texts = {f"{file_name}.py": python_source(program, joint_names, named_vectors)}
        else:
            header, source = c_source(program, arguments.prefix, joint_names, named_vectors)
            texts = {f"{file_name}.h": header, f"{file_name}.c": source}
        for name, text in texts.items():
            _write(arguments, name, text, f"{program.name} of {robot.name!r}, {program.operations}")
    if arguments.lang == "cpp":
        namespace = cpp_namespace(arguments.prefix, robot.name)
        text = cpp_header(programs, state_joints(Dynamics(robot)), namespace, arguments.prefix)
        _write(arguments, f"{arguments.prefix}models.hpp", text, f"namespace {namespace}")


def _write(arguments: Namespace, name: str, text: str, description: str) -> None:
    """Write a file into the output folder, and print what it is."""
    path = Path(arguments.output) / name
    write_text(path, text)
    print(f"{path}: {description}")


def _write_control_model(arguments: Namespace, robot: Robot) -> None:
    """Write the model for control laws. Raises DescriptionError if the options do not fit it."""
    for option in ("model", "frame", "wrench"):
        if getattr(arguments, option):
            raise DescriptionError(f"--control and --{option} exclude each other: call generate once for each")
    if arguments.lang == "python":
        raise DescriptionError("--control is C: --lang python does not apply")
    if len(arguments.payload) > 1:
        raise DescriptionError("--control takes one --payload: the sum of all payloads, in one frame")
    model = export_control_model(robot, arguments.payload[0] if arguments.payload else None)
    header, source = control_model_source(model, arguments.prefix)
    operations = ", ".join(f"{program.name} {program.operations}" for program in model.programs)
    for ending, text in (("h", header), ("c", source)):
        _write(arguments, f"{arguments.prefix}control_model.{ending}", text, f"{robot.name!r}, {operations}")


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


def _build_program(arguments: Namespace, model: str, robot: Robot) -> Program:
    """Trace a model. Raises DescriptionError if the options do not fit it."""
    if arguments.payload and model not in PAYLOAD_MODELS:
        raise DescriptionError(f"--payload applies to {', '.join(PAYLOAD_MODELS)}, not to {model}")
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
    for frame in arguments.payload:
        if robot.frame(frame).link == 0 and not robot.moving_base:
            raise DescriptionError(f"--payload {frame}: it is fixed to the base, and no joint carries it")
    options = {"wrenches": arguments.wrench} if model in SOLVING_MODELS else {}
    if arguments.payload:
        options["payloads"] = arguments.payload
    return MODELS[model](robot, **options)
