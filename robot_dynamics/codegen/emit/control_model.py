"""The model of a robot for control laws as one C source: the table of robot_dynamics_control/model_abi.h.

The programs are static functions of the source; functions with the arguments of the table call them.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from robot_dynamics.codegen.emit.c_code import SIGN_FUNCTION, c_definition, c_literal
from robot_dynamics.codegen.emit.code_text import operations_used, sanitize_comment
from robot_dynamics.codegen.trace.scalar import SIGN

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike
    from robot_dynamics.codegen.trace.program import Program

ARGUMENTS = {
    "inverse": ("q", "qd", "qdd", "twist", "gravity", "payload"),
    "friction": ("q", "qd"),
    "closure": ("variables",),
}
"""Inputs of the functions of the table."""

INERTIA_SIZE = 10

HEADER = """\
/* {title} */

#ifndef {guard}
#define {guard}

#include <robot_dynamics_control/model_abi.h>

#ifdef __cplusplus
extern "C" {{
#endif

/* Sizes of the arrays of the model. */
enum {{
    {prefix}joint_count = {joint_count},
    {prefix}position_count = {position_count}
}};

/* The model; it is never NULL. */
const robot_dynamics_model *{prefix}control_model(void);

#ifdef __cplusplus
}}
#endif

#endif
"""

FOOTER = """\
const robot_dynamics_model *{prefix}control_model(void)
{{
    return &model;
}}

#ifdef ROBOT_DYNAMICS_SHARED_MODEL
/* The only symbol of a shared object. */
#ifdef _WIN32
__declspec(dllexport)
#else
__attribute__((visibility("default")))
#endif
const robot_dynamics_model *robot_dynamics_control_model(void);

const robot_dynamics_model *robot_dynamics_control_model(void)
{{
    return &model;
}}
#endif
"""


@dataclass(frozen=True)
class StateJoint:
    """A joint of the state, as robot_dynamics_joint has it."""

    name: str
    lower: float
    upper: float
    velocity: float
    effort: float
    load_friction: float
    actuated: bool
    prismatic: bool


@dataclass(frozen=True, eq=False)
class ControlLoops:
    """Closed loops, as robot_dynamics_loops has them.

    Attributes
    ----------
    closure : Program
        One step of Newton's method.
    independent, dependent : sequence of int
        Variables of the joints of the state, and variables that the loops determine.
    units, reference : array_like, shape (variables,)
    motion : sequence of int
        Of each joint of the state: 0 it moves no loop, 1 it moves loops, 2 periodically.
    attitudes : sequence of (int, int, int)
    positions : sequence of (str, int, float, float)
        Name, variable, multiplier and offset of each position of the models.
    """

    closure: Program
    independent: Sequence[int]
    dependent: Sequence[int]
    units: ArrayLike
    reference: ArrayLike
    motion: Sequence[int]
    attitudes: Sequence[tuple[int, int, int]]
    positions: Sequence[tuple[str, int, float, float]]


@dataclass(frozen=True)
class ControlSpring:
    """A spring between a motor and its link, as robot_dynamics_spring has it.

    Attributes
    ----------
    motor, joint : int
        Indices of the joints of motor and spring.
    stiffness, rest, damping : float
    """

    motor: int
    joint: int
    stiffness: float
    rest: float
    damping: float


@dataclass(frozen=True, eq=False)
class ControlModel:
    """The model of a robot for control laws, as robot_dynamics_model has it.

    Attributes
    ----------
    robot, generator : str
        Names of the robot, and of the program that writes the model.
    joints : sequence of StateJoint
    inverse : Program
    friction : Program or None
    loops : ControlLoops or None
    springs : sequence of ControlSpring
    springs_are_decoupled : bool
        Whether the torques that springs transmit do not depend on their deflections.
    gravity : array_like, shape (3,)
    payload_frame : str or None
        Frame of the payload that is an argument of `inverse`.
    moving_base : bool
    """

    robot: str
    generator: str
    joints: Sequence[StateJoint]
    inverse: Program
    friction: Program | None
    loops: ControlLoops | None
    springs: Sequence[ControlSpring]
    springs_are_decoupled: bool
    gravity: ArrayLike
    payload_frame: str | None
    moving_base: bool

    @property
    def programs(self) -> list[Program]:
        """The programs of the model."""
        programs = [self.inverse]
        if self.friction is not None:
            programs.append(self.friction)
        if self.loops is not None:
            programs.append(self.loops.closure)
        return programs


def control_model_source(model: ControlModel, prefix: str = "") -> tuple[str, str]:
    """The model as C.

    Parameters
    ----------
    model : ControlModel
    prefix : str
        Beginning of the names of the function and of the files, an identifier or empty.

    Returns
    -------
    header : str
        Text of <prefix>control_model.h, which C++ can include too.
    source : str
        Text of the source, which includes the header.
    """
    title = f"{sanitize_comment(model.robot)}: model for control laws, written by {sanitize_comment(model.generator)}."
    header = HEADER.format(
        title=title,
        guard=f"{prefix}control_model_h".upper(),
        prefix=prefix,
        joint_count=len(model.joints),
        position_count=model.inverse.inputs["q"],
    )
    includes = f'#include <math.h>\n#include <stddef.h>\n\n#include "{prefix}control_model.h"'
    parts = [f"/* {title} */", includes]
    if any(SIGN in operations_used(program) for program in model.programs):
        parts.append(SIGN_FUNCTION.strip("\n"))
    parts += [part for program in model.programs for part in (c_definition(program), _adapter(program))]
    parts.append(_joints(model.joints))
    if model.loops is not None:
        parts += _loops(model.loops)
    if model.springs:
        parts += _springs(model)
    parts += [_model(model), FOOTER.format(prefix=prefix)]
    return header, "\n\n".join(parts)


def c_string(text: str) -> str:
    """A text as a string literal of C, in UTF-8."""
    safe = re.compile(rb"[A-Za-z0-9 _.,:;()\[\]{}<>=+'/@#-]")
    letters = (bytes([byte]) for byte in text.encode("utf-8", "replace"))
    return '"' + "".join(letter.decode() if safe.match(letter) else f"\\{letter[0]:03o}" for letter in letters) + '"'


def _adapter(program: Program) -> str:
    """The function with the arguments of the table that calls the function of a program."""
    arguments = ARGUMENTS[program.name]
    passed = []
    for name in program.inputs:
        passed.append("payload" if name.startswith("payload on ") else arguments[0] if name == "q" else name)
    outputs = [output.name for output in program.outputs]
    is_closure = program.name == "closure"
    results = outputs if is_closure else ["efforts"]
    head = ", ".join([*(f"const double *{name}" for name in arguments), *(f"double *{name}" for name in results)])
    lines = [f"static void evaluate_{program.name}({head})", "{"]
    for output in program.outputs[len(results) :]:
        lines.append(f"    double {output.name}[{len(output.entries)}];")
    lines += [f"    (void){name};" for name in arguments if name not in passed]
    results = results + outputs[len(results) :]
    lines += [f"    {program.name}({', '.join([*passed, *results])});", "}"]
    return "\n".join(lines)


def _joints(joints: Iterable[StateJoint]) -> str:
    rows = []
    for joint in joints:
        numbers = (joint.lower, joint.upper, joint.velocity, joint.effort, joint.load_friction)
        flags = (int(joint.actuated), int(joint.prismatic))
        rows.append(f"{{{c_string(joint.name)}, {_list(map(c_literal, numbers))}, {_list(flags)}}}")
    return _array("robot_dynamics_joint", "joints", rows)


def _loops(loops: ControlLoops) -> list[str]:
    """The tables of the loops."""
    rows = [
        f"{{{c_string(name)}, {variable}, {c_literal(multiplier)}, {c_literal(offset)}}}"
        for name, variable, multiplier, offset in loops.positions
    ]
    parts = [_array("robot_dynamics_position", "positions", rows)]
    for name in ("independent", "dependent", "motion"):
        parts.append(_array("uint32_t", f"loop_{name}", getattr(loops, name)))
    for name in ("units", "reference"):
        parts.append(_array("double", f"loop_{name}", map(c_literal, getattr(loops, name))))
    if loops.attitudes:
        attitudes = [f"{{{_list(columns)}}}" for columns in loops.attitudes]
        parts.append(f"static const uint32_t loop_attitudes[][3] = {{\n{_rows(attitudes)}\n}};")
    fields = {
        "variable_count": loops.closure.inputs["q"],
        "dependent_count": len(loops.dependent),
        "row_count": len(loops.closure.outputs[0].entries),
        "attitude_count": len(loops.attitudes),
        **{name: f"loop_{name}" for name in ("independent", "dependent", "units", "reference", "motion")},
        "attitudes": "loop_attitudes" if loops.attitudes else "NULL",
        "positions": "positions",
        "step": "evaluate_closure",
    }
    return [*parts, _struct("robot_dynamics_loops", "loops", fields)]


def _springs(model: ControlModel) -> list[str]:
    """The tables of the springs."""
    rows = []
    for spring in model.springs:
        numbers = map(c_literal, (spring.stiffness, spring.rest, spring.damping))
        rows.append(f"{{{_list((spring.motor, spring.joint, *numbers))}}}")
    fields = {"count": len(rows), "decoupled": int(model.springs_are_decoupled), "springs": "spring_rows"}
    return [_array("robot_dynamics_spring", "spring_rows", rows), _struct("robot_dynamics_springs", "springs", fields)]


def _model(model: ControlModel) -> str:
    has_payload = model.payload_frame is not None
    fields = {
        "abi": "ROBOT_DYNAMICS_MODEL_ABI",
        "size": "(uint32_t)sizeof(robot_dynamics_model)",
        "robot": c_string(model.robot),
        "generator": c_string(model.generator),
        "joint_count": len(model.joints),
        "position_count": model.inverse.inputs["q"],
        "moving_base": int(model.moving_base),
        "payload_size": INERTIA_SIZE if has_payload else 0,
        "payload_frame": c_string(model.payload_frame or "") if has_payload else "NULL",
        "gravity": f"{{{_list(map(c_literal, model.gravity))}}}",  # type: ignore[arg-type]
        "joints": "joints",
        "loops": "NULL" if model.loops is None else "&loops",
        "springs": "&springs" if model.springs else "NULL",
        "inverse": "evaluate_inverse",
        "friction": "NULL" if model.friction is None else "evaluate_friction",
    }
    return _struct("robot_dynamics_model", "model", fields)


def _list(items: Iterable[Any]) -> str:
    return ", ".join(map(str, items))


def _rows(items: Iterable[Any]) -> str:
    return ",\n".join(f"    {item}" for item in items)


def _array(kind: str, name: str, items: Iterable[Any]) -> str:
    return f"static const {kind} {name}[] = {{\n{_rows(items)}\n}};"


def _struct(kind: str, name: str, fields: Mapping[str, Any]) -> str:
    return f"static const {kind} {name} = {{\n{_rows(f'.{key} = {value}' for key, value in fields.items())}\n}};"
