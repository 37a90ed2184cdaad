"""Names, comments, numbers and expressions of a program as text, for the emitters of Python and of C.

Names come from robot descriptions of unknown origin. Identifiers keep only their ASCII letters, digits and single
underscores; comments keep nothing that could end a comment, a string or a line.
"""

from __future__ import annotations

import itertools
import math
import re
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

from robot_dynamics.codegen.trace.program import constant_values
from robot_dynamics.codegen.trace.scalar import (
    ADD,
    COSINE,
    DIVIDE,
    INPUT,
    LEAVES,
    MULTIPLY,
    PARAMETER,
    SIGN,
    SINE,
    SQUARE_ROOT,
    SUBTRACT,
)

if TYPE_CHECKING:
    from robot_dynamics.codegen.trace.program import Output, Program, Statement
    from robot_dynamics.codegen.trace.scalar import (
        Operation,
    )

NamedVectors: TypeAlias = Sequence[tuple[str, Sequence[str]]]
"""(sentence, joint names) of vectors that have other joints than the rest."""

INFIX: dict[Operation, str] = {ADD: "+", SUBTRACT: "-", MULTIPLY: "*", DIVIDE: "/"}
FUNCTIONS: dict[Operation, str] = {SINE: "sin", COSINE: "cos", SQUARE_ROOT: "sqrt", SIGN: "sign"}
PREFIXES: dict[Operation, str] = {SINE: "s_", COSINE: "c_"}
"""Prefixes of the variables that hold a sine or a cosine."""

INPUT_UNITS = {
    "q": "rad or m",
    "qd": "rad/s or m/s",
    "qdd": "rad/s^2 or m/s^2",
    "efforts": "N m or N",
    "twist": "m/s, then rad/s",
    "gravity": "m/s^2",
    "base_acceleration": "m/s^2, then rad/s^2",
}
OUTPUT_UNITS = {
    "efforts": "N m or N",
    "accelerations": "rad/s^2 or m/s^2",
    "base_acceleration": "m/s^2, then rad/s^2",
    "inertia_matrix": "kg m^2, kg m or kg",
    "gravity": "N m or N",
    "coriolis": "N m or N",
    "bias": "N m or N",
    "by_positions": "derivatives, per rad or m",
    "by_velocities": "derivatives, per rad/s or m/s",
    "by_accelerations": "derivatives, per rad/s^2 or m/s^2",
    "by_efforts": "derivatives, per N m or N",
    "by_base_acceleration": "derivatives, per m/s^2, then rad/s^2",
}
WRENCH_UNITS = "N, then N m"
PAYLOAD_UNITS = "mass kg, first moments x y z kg m, second moments xx xy xz yy yz zz kg m^2"
MAX_IDENTIFIER_LENGTH = 100
MAX_COMMENT_LENGTH = 60


def identifier(text: object, fallback: str = "x") -> str:
    """A text as an identifier of C and Python; `fallback` replaces an empty result and precedes a digit."""
    name = "_".join(re.findall("[A-Za-z0-9]+", str(text)[-MAX_IDENTIFIER_LENGTH:]))  # long names differ at their end
    if not name:
        return fallback
    return f"{fallback}_{name}" if name[0].isdigit() else name


def sanitize_comment(text: object) -> str:
    """A text as part of a comment or docstring: one short line of plain ASCII."""
    return re.sub(r"[^A-Za-z0-9 _.,:;()\[\]{}<>=+'/@#-]", "_", str(text)[:MAX_COMMENT_LENGTH])


class UniqueNames:
    """The identifiers of one scope: no two are equal, none is reserved."""

    def __init__(self, reserved: Iterable[str]) -> None:
        self._counts = dict.fromkeys(reserved, 1)

    def take(self, text: object, fallback: str = "x") -> str:
        """An unused identifier that resembles a text."""
        name = stem = identifier(text, fallback)
        while name in self._counts:
            self._counts[stem] += 1
            name = f"{stem}_{self._counts[stem]}"
        self._counts[name] = 1
        return name


class VariableNames:
    """The names of the parts of a program.

    Parameters
    ----------
    program : Program
    names : UniqueNames
        The scope from which the names are taken.
    literal : callable
        Returns the text of a number.
    prefix : str
        Precedes the name of the function.

    Attributes
    ----------
    function : str
        Name of the function that computes the program.
    inputs : dict of str to str
        Identifier of each input.
    outputs : list of str
        Identifiers of the outputs, in order.
    nodes : dict of int to str
        Text of each node: an identifier, or a literal for a constant.
    """

    def __init__(self, program: Program, names: UniqueNames, literal: Callable[[float], str], prefix: str = "") -> None:
        self.function = names.take(f"{prefix}{program.name}", "model")
        self.inputs = {name: names.take(name, "input") for name in program.inputs}
        self.outputs = [names.take(output.name, "output") for output in program.outputs]
        self.nodes = {number: literal(value) for number, value in constant_values(program).items()}
        for number, operation, operands in program.leaves:
            if operation == INPUT:
                name, position = operands
                stem = self.inputs[name] + "_" * self.inputs[name][-1].isdigit()
                self.nodes[number] = names.take(f"{stem}{position + 1}")
            elif operation == PARAMETER:
                self.nodes[number] = names.take(operands[0], "parameter")
        temporary = itertools.count(1)
        for number, operation, operands in program.setup + program.statements:
            if operation in PREFIXES:
                name = PREFIXES[operation] + self.nodes[operands[0]]
            else:
                name = f"t{next(temporary)}"
            self.nodes[number] = names.take(name)

    def expression(self, statement: Statement) -> str:
        """The right side of a statement."""
        return expression(statement.operation, [self.nodes[operand] for operand in statement.operands])

    def entries(self, output: Output) -> list[str]:
        """The texts of the entries of an output, row by row."""
        return [signed(self.nodes[node], sign) for node, sign in output.entries]

    def used_entries(self, program: Program, name: str) -> dict[int, str]:
        """Identifiers of the entries of an input that the program reads, by position."""
        return {
            leaf.operands[1]: self.nodes[leaf.number]
            for leaf in program.leaves
            if leaf.operation == INPUT and leaf.operands[0] == name
        }


def expression(operation: Operation, texts: Sequence[str]) -> str:
    """An operation on the texts of its operands, in Python and C."""
    if operation in INFIX:
        return f"{texts[0]} {INFIX[operation]} {texts[1]}"
    return f"{FUNCTIONS[operation]}({texts[0]})"


def signed(text: str, sign: int) -> str:
    """A text, negated where the sign is negative."""
    return f"-{text}" if sign < 0 else text


def float_literal(value: float, infinity_text: str, nan_text: str) -> str:
    """A float with the fewest digits that represent it exactly, in parentheses where it is negative."""
    value = float(value)
    if math.isnan(value):
        return nan_text
    text = infinity_text if math.isinf(value) else repr(abs(value))
    return text if math.copysign(1.0, value) > 0 else f"(-{text})"


def setup_nodes(program: Program) -> list[int]:
    """Numbers of the parameters and setup statements that statements or outputs read, in order."""
    read = {operand for statement in program.statements for operand in statement.operands}
    read.update(node for output in program.outputs for node, _ in output.entries)
    parameters = [leaf.number for leaf in program.leaves if leaf.operation == PARAMETER]
    return [number for number in parameters + [statement.number for statement in program.setup] if number in read]


def operations_used(program: Program) -> set[Operation]:
    """The operations of the setup and the statements."""
    return {statement.operation for statement in program.setup + program.statements} - set(LEAVES)


def input_comment(name: str, size: int) -> str:
    """A line about an input: its size and unit."""
    for beginning, unit in (("wrench on ", WRENCH_UNITS), ("payload on ", PAYLOAD_UNITS)):
        if name.startswith(beginning):
            return _array_comment(name, size, {name: unit})
    return _array_comment(name, size, INPUT_UNITS)


def output_comment(output: Output) -> str:
    """A line about an output: its size, shape and unit."""
    rows = f", row by row of an array {output.shape}" if len(output.shape) > 1 else ""
    return _array_comment(output.name, len(output.entries), OUTPUT_UNITS, rows)


def _array_comment(name: str, size: int, units: Mapping[str, str], rows: str = "") -> str:
    unit = f" [{units[name]}]" if name in units else ""
    return f"{sanitize_comment(name)}: {size} number{'s' * (size != 1)}{rows}{unit}"


def joints_comment(joint_names: Sequence[str], other_vectors: NamedVectors = ()) -> list[str]:
    """Lines with the joint of each entry of the joint vectors."""
    lines: list[str] = []
    for sentence, names in (("Joints, by index", joint_names), *other_vectors):
        joints = ", ".join(f"{position} {sanitize_comment(name)}" for position, name in enumerate(names))
        lines += textwrap.wrap(f"{sentence}: {joints}.", 100) if names else []
    return lines
