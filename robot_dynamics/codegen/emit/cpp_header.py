"""A header for C++17 beside generated C: functions whose arguments are std::array, and a table of the joints.

A wrong size is an error of the compiler. The functions allocate nothing and throw nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from robot_dynamics.codegen.emit.c_code import c_name
from robot_dynamics.codegen.emit.c_reserved_names import RESERVED_NAMES
from robot_dynamics.codegen.emit.code_text import UniqueNames, float_literal, identifier
from robot_dynamics.codegen.emit.control_model import c_string
from robot_dynamics.errors import DescriptionError

if TYPE_CHECKING:
    from robot_dynamics.codegen.emit.control_model import StateJoint
    from robot_dynamics.codegen.trace.program import Program

HEADER = """\
// Models for C++17 around the generated C: arguments are std::array, joints have names and limits.

#ifndef {guard}
#define {guard}

#include <array>
#include <cstddef>
#include <limits>
#include <string_view>

{includes}

namespace {namespace} {{

struct Joint {{
    std::string_view name;
    bool actuated;
    bool prismatic;
    double lower, upper; // limits of the position [rad or m], infinite where the description has none
    double velocity; // maximum speed [rad/s or m/s]
    double effort; // maximum effort [N m or N]
}};

inline constexpr std::size_t joint_count = {joint_count};

inline constexpr std::array<Joint, joint_count> joints{{{{
{joints}
}}}};

{functions}

}} // namespace {namespace}

#endif
"""


def cpp_namespace(prefix: str, robot: str) -> str:
    """The namespace of the models of a robot: the prefix without its last underscore, or the name of the robot."""
    name = identifier(prefix.rstrip("_") or robot, "robot")
    return f"{name}_models" if name in RESERVED_NAMES or name == "std" else name


def cpp_header(programs: Sequence[Program], joints: Sequence[StateJoint], namespace: str, prefix: str = "") -> str:
    """The header of some models of a robot.

    Parameters
    ----------
    programs : sequence of Program
        Programs without parameters.
    joints : sequence of StateJoint
        Of the joint vectors.
    namespace : str
    prefix : str
        That of the generated C.

    Returns
    -------
    str

    Raises
    ------
    DescriptionError
        A number of the robot has no value.
    """
    for program in programs:
        if program.parameters:
            raise DescriptionError(f"--lang cpp: set the open parameters, {', '.join(program.parameters)}")
    return HEADER.format(
        guard=f"{identifier(f'{prefix}models')}_hpp".upper(),
        includes="\n".join(f'#include "{c_name(program, prefix)}.h"' for program in programs),
        namespace=namespace,
        joint_count=len(joints),
        joints="\n".join(_joint(joint) for joint in joints),
        functions="\n\n".join(_function(program, prefix) for program in programs),
    )


def _joint(joint: StateJoint) -> str:
    infinity = "std::numeric_limits<double>::infinity()"
    limits = (joint.lower, joint.upper, joint.velocity, joint.effort)
    numbers = ", ".join(float_literal(limit, infinity, "0.0") for limit in limits)
    flags = ", ".join(str(flag).lower() for flag in (joint.actuated, joint.prismatic))
    return f"    {{{c_string(joint.name)}, {flags}, {numbers}}},"


def _function(program: Program, prefix: str) -> str:
    """The inline function of a program."""
    names = UniqueNames([*RESERVED_NAMES, "joints", "joint_count"])
    function = names.take(program.name, "model")
    arguments: list[str] = []
    declarations: list[str] = []
    for name, size in program.inputs.items():
        arguments.append(names.take(name, "input"))
        declarations.append(f"const std::array<double, {size}> &{arguments[-1]}")
    for output in program.outputs:
        arguments.append(names.take(output.name, "output"))
        declarations.append(f"std::array<double, {len(output.entries)}> &{arguments[-1]}")
    passed = ", ".join(f"{argument}.data()" for argument in arguments)
    return (
        f"inline void {function}({_wrapped(declarations)}) noexcept\n{{\n    ::{c_name(program, prefix)}({passed});\n}}"
    )


def _wrapped(declarations: Iterable[str]) -> str:
    return ",\n    ".join(declarations)
