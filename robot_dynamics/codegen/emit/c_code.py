"""Programs as C99: a header and a source that need only math.h, compile as C++ too, and keep no state.

The functions allocate no memory and read all inputs before they write outputs, so that outputs may overlap inputs.
Several threads may call them at once.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from robot_dynamics.codegen.emit.c_reserved_names import RESERVED_NAMES
from robot_dynamics.codegen.emit.code_text import (
    UniqueNames,
    VariableNames,
    float_literal,
    input_comment,
    joints_comment,
    operations_used,
    output_comment,
    sanitize_comment,
    setup_nodes,
)
from robot_dynamics.codegen.trace.scalar import PARAMETER, SIGN

if TYPE_CHECKING:
    from robot_dynamics.codegen.emit.code_text import (
        NamedVectors,
    )
    from robot_dynamics.codegen.trace.program import Program, Statement

OPERATION_LABELS = ("multiplications", "additions", "divisions", "sines and cosines", "square roots", "signs")
WIDTH = 110
SIGN_FUNCTION = """
/* 1, -1 or 0; NaN of NaN */
static double sign_of(double x)
{
    return x > 0.0 ? 1.0 : (x < 0.0 ? -1.0 : x + 0.0);
}
"""


def c_name(program: Program, prefix: str = "") -> str:
    """The name of the function that computes a program; the source includes its header as <name>.h."""
    return _Emitter(program, prefix).function


def c_source(
    program: Program, prefix: str = "", joint_names: Sequence[str] = (), other_vectors: NamedVectors = ()
) -> tuple[str, str]:
    """A program as C.

    Parameters
    ----------
    program : Program
    prefix : str
        Precedes the name of the program in the name of the function, <name> below.
    joint_names : sequence of str
        Names of the entries of joint vectors, for comments.
    other_vectors : sequence of (str, sequence of str)
        (sentence, names) of vectors that have other joints.

    Returns
    -------
    header : str
        Text of <name>.h, which C++ can include too.
    source : str
        Text of the source, which includes the header.

    Notes
    -----
    The source defines `void <name>(const double q[7], ..., double efforts[7])`. An output with several axes is written
    row by row. If the program has parameters, `void <name>_setup(<name>_constants *constants, const double
    parameters[])` fills a struct with the values that depend on them alone, and the last argument of <name> before the
    outputs points to that struct.
    """
    emitter = _Emitter(program, prefix)
    return emitter.header(joints_comment(joint_names, other_vectors)), emitter.source()


def c_definition(program: Program) -> str:
    """A program without parameters as a static function, in a source that defines SIGN_FUNCTION where it needs it."""
    return _Emitter(program, "").definition("static ")


def c_literal(value: float) -> str:
    """A number as C, with math.h."""
    return float_literal(value, "(double)INFINITY", "(double)NAN")


class _Emitter:
    """A program and the names of its parts in C."""

    def __init__(self, program: Program, prefix: str) -> None:
        name = UniqueNames(RESERVED_NAMES).take(f"{prefix}{program.name}", "model")
        self.program = program
        self.guard = f"{name.upper()}_H"
        self.struct = f"{name}_constants"
        self.setup = f"{name}_setup"
        scope = UniqueNames(RESERVED_NAMES | {self.guard, self.struct, self.setup})
        self.variables = VariableNames(program, scope, c_literal, prefix)
        self.nodes = self.variables.nodes
        self.function = self.variables.function
        self.constants = setup_nodes(program)

    def header(self, joints: Sequence[str]) -> str:
        """The text of the header; `joints` are the lines about joint vectors."""
        declarations = [f"{self._signature()};"]
        if self.program.parameters:
            # a struct of C has at least one member
            fields = [f"double {self.nodes[node]};" for node in self.constants] or ["double unused;"]
            struct = f"typedef struct {{\n{_indent(fields)}\n}} {self.struct};"
            declarations = [struct, f"{self._setup_signature()};", *declarations]
        parts = [
            _comment(self._description(joints)),
            f"#ifndef {self.guard}\n#define {self.guard}",
            '#ifdef __cplusplus\nextern "C" {\n#endif',
            *declarations,
            "#ifdef __cplusplus\n}\n#endif",
            "#endif",
        ]
        return "\n\n".join(parts) + "\n"

    def source(self) -> str:
        """The text of the source."""
        parts = [_comment([self._title()]), f'#include <math.h>\n\n#include "{self.function}.h"']
        if SIGN in operations_used(self.program):
            parts.append(SIGN_FUNCTION.strip("\n"))
        if self.program.parameters:
            parts.append(f"{self._setup_signature()}\n{{\n{_indent(self._setup_body())}\n}}")
        parts.append(self.definition())
        return "\n\n".join(parts) + "\n"

    def definition(self, storage: str = "") -> str:
        """The definition of the function; storage: its storage class, with a space."""
        return f"{storage}{self._signature()}\n{{\n{_indent(self._body())}\n}}"

    def _title(self) -> str:
        return f"{sanitize_comment(self.program.name)}: straight-line model of a robot, generated by robot_dynamics."

    def _description(self, joints: Sequence[str]) -> list[str]:
        """Lines about the model."""
        program = self.program
        labelled_counts = zip(OPERATION_LABELS, program.operations, strict=True)
        counts = [f"{label} {count}" for label, count in labelled_counts if count]
        lines = [self._title(), ""]
        lines += [*joints, ""] if joints else []
        lines += ["Inputs:", *(f"    {input_comment(*pair)}" for pair in program.inputs.items())]
        lines += ["Outputs, which may overlap inputs but not other outputs:"]
        lines += [f"    {output_comment(output)}" for output in program.outputs]
        if program.parameters:
            lines += [f"Parameters, arguments of {self.setup}:"]
            lines += [f"    {position}: {sanitize_comment(name)}" for position, name in enumerate(program.parameters)]
        lines.append(f"Operations of a call: {', '.join(counts) or 'none'}.")
        return lines

    def _signature(self) -> str:
        names = self.variables
        arguments = [_array("const double", names.inputs[name], size) for name, size in self.program.inputs.items()]
        if self.program.parameters:
            arguments.append(f"const {self.struct} *constants")
        for name, output in zip(names.outputs, self.program.outputs, strict=True):
            arguments.append(_array("double", name, len(output.entries)))
        return _function_head(f"void {self.function}", arguments)

    def _setup_signature(self) -> str:
        parameters = _array("const double", "parameters", len(self.program.parameters))
        return _function_head(f"void {self.setup}", [f"{self.struct} *constants", parameters])

    def _setup_body(self) -> list[str]:
        positions = {name: position for position, name in enumerate(self.program.parameters)}
        lines = []
        for number, operation, operands in self.program.leaves:
            if operation == PARAMETER:
                lines.append(f"const double {self.nodes[number]} = parameters[{positions[operands[0]]}];")
        lines += self._statements(self.program.setup)
        lines += [f"constants->{self.nodes[node]} = {self.nodes[node]};" for node in self.constants]
        return lines if self.constants else [*lines, "(void)constants;"]

    def _body(self) -> list[str]:
        program, names = self.program, self.variables
        lines = []
        for name in program.inputs:
            entries = names.used_entries(program, name)
            array = names.inputs[name]
            lines += [f"const double {entry} = {array}[{position}];" for position, entry in sorted(entries.items())]
            lines += [f"(void){array};"] * (not entries)
        if program.parameters:
            lines += [f"const double {self.nodes[node]} = constants->{self.nodes[node]};" for node in self.constants]
            lines += ["(void)constants;"] * (not self.constants)
        else:
            lines += self._statements(program.setup)
        lines += self._statements(program.statements)
        for name, output in zip(names.outputs, program.outputs, strict=True):
            lines += [f"{name}[{position}] = {entry};" for position, entry in enumerate(names.entries(output))]
            lines += [f"(void){name};"] * (not output.entries)
        return lines

    def _statements(self, statements: Iterable[Statement]) -> list[str]:
        lines = []
        for statement in statements:
            right = self.variables.expression(statement)
            if statement.operation == SIGN:
                right = f"sign_of({self.nodes[statement.operands[0]]})"
            lines.append(f"const double {self.nodes[statement.number]} = {right};")
        return lines


def _array(element: str, name: str, size: int) -> str:
    """The declaration of an array parameter; C has no arrays without entries."""
    return f"{element} {name}[{size}]" if size else f"{element} *{name}"


def _function_head(name: str, arguments: Sequence[str]) -> str:
    """The head of a function, in lines of limited length that break between arguments."""
    unbroken = [argument.replace(" ", "\0") for argument in arguments or ["void"]]
    text = f"{name.replace(' ', chr(0))}({', '.join(unbroken)})"
    wrapped = textwrap.fill(text, WIDTH, subsequent_indent="    ", break_long_words=False, break_on_hyphens=False)
    return wrapped.replace("\0", " ")


def _indent(lines: Iterable[str]) -> str:
    return "\n".join(f"    {line}" for line in lines)


def _comment(lines: Iterable[str]) -> str:
    """A C comment; the lines must not contain its end."""
    return "/*\n" + "\n".join(f" * {line}".rstrip() for line in lines) + "\n */"
