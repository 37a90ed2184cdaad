"""What the writers of Python and of C share: names, comments, numbers and expressions of a program as text.

Names come from descriptions of robots, which anyone may have written. As identifiers, nothing but ASCII letters, digits
and single underscores is left of them; in comments, nothing that could end a comment, a string or a line.
"""

import itertools
import math
import re
import textwrap

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

INFIX = {ADD: "+", SUBTRACT: "-", MULTIPLY: "*", DIVIDE: "/"}
FUNCTIONS = {SINE: "sin", COSINE: "cos", SQUARE_ROOT: "sqrt", SIGN: "sign"}
PREFIXES = {SINE: "s_", COSINE: "c_"}  # of the variables that hold a sine or a cosine
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
}
WRENCH_UNITS = "N, then N m"
MAX_IDENTIFIER_LENGTH = 100
MAX_COMMENT_LENGTH = 60


def identifier(text, fallback="x"):
    """What is left of a text as an identifier of C and Python; `fallback` where nothing is, and before a digit."""
    name = "_".join(re.findall("[A-Za-z0-9]+", str(text)[-MAX_IDENTIFIER_LENGTH:]))  # names differ at their end
    if not name:
        return fallback
    return f"{fallback}_{name}" if name[0].isdigit() else name


def sanitize_comment(text):
    """What is left of a text as part of a comment or docstring: one short line of plain ASCII."""
    return re.sub(r"[^A-Za-z0-9 _.,:;()\[\]{}<>=+'/@#-]", "_", str(text)[:MAX_COMMENT_LENGTH])


class UniqueNames:
    """The identifiers of one scope, each given once, none of the reserved ones."""

    def __init__(self, reserved):
        self._times = dict.fromkeys(reserved, 1)

    def take(self, wanted, fallback="x"):
        """An identifier that no one else has, as like `wanted` as can be."""
        name = stem = identifier(wanted, fallback)
        while name in self._times:
            self._times[stem] += 1
            name = f"{stem}_{self._times[stem]}"
        self._times[name] = 1
        return name


class VariableNames:
    """The names that stand for the parts of a program.

    function: of the model; inputs: {name of the input: identifier}; outputs: their identifiers, in order; nodes:
    {number: the text that stands for the node}, an identifier or, for constants, a number as `literal` writes it.
    """

    def __init__(self, program, names, literal, prefix=""):
        self.function = names.take(f"{prefix}{program.name}", "model")
        self.inputs = {name: names.take(name, "input") for name in program.inputs}
        self.outputs = [names.take(output.name, "output") for output in program.outputs]
        self.nodes = {number: literal(value) for number, value in constant_values(program).items()}
        for number, operation, operands in program.leaves:
            if operation == INPUT:
                name, place = operands
                stem = self.inputs[name] + "_" * self.inputs[name][-1].isdigit()
                self.nodes[number] = names.take(f"{stem}{place + 1}")
            elif operation == PARAMETER:
                self.nodes[number] = names.take(operands[0], "parameter")
        temporary = itertools.count(1)
        for number, operation, operands in program.setup + program.statements:
            wanted = PREFIXES[operation] + self.nodes[operands[0]] if operation in PREFIXES else f"t{next(temporary)}"
            self.nodes[number] = names.take(wanted)

    def expression(self, statement):
        """The right side of a statement."""
        return expression(statement.operation, [self.nodes[operand] for operand in statement.operands])

    def entries(self, output):
        """The texts of the entries of an output, row by row."""
        return [signed(self.nodes[node], sign) for node, sign in output.entries]

    def used_entries(self, program, name):
        """{place: identifier} of the entries of an input that the program reads."""
        return {
            leaf.operands[1]: self.nodes[leaf.number]
            for leaf in program.leaves
            if leaf.operation == INPUT and leaf.operands[0] == name
        }


def expression(operation, texts):
    """An operation on operands, names or what may stand for one, as Python and C write it."""
    if operation in INFIX:
        return f"{texts[0]} {INFIX[operation]} {texts[1]}"
    return f"{FUNCTIONS[operation]}({texts[0]})"


def signed(text, sign):
    return f"-{text}" if sign < 0 else text


def float_literal(value, infinity_text, nan_text):
    """A float in the fewest digits that are exactly it, in parentheses where it is negative.

    infinite, undefined: what an infinity and NaN are called.
    """
    value = float(value)
    if math.isnan(value):
        return nan_text
    text = infinity_text if math.isinf(value) else repr(abs(value))
    return text if math.copysign(1.0, value) > 0 else f"(-{text})"


def setup_nodes(program):
    """Numbers of the parameters, and of what follows from them, that statements or outputs read, in order."""
    read = {operand for statement in program.statements for operand in statement.operands}
    read.update(node for output in program.outputs for node, _ in output.entries)
    given = [leaf.number for leaf in program.leaves if leaf.operation == PARAMETER]
    return [number for number in given + [statement.number for statement in program.setup] if number in read]


def operations_used(program):
    """The operations among the setup and the statements."""
    return {statement.operation for statement in program.setup + program.statements} - set(LEAVES)


def input_comment(name, size):
    """A line about an input: how many numbers, in which unit."""
    return _array_comment(name, size, {name: WRENCH_UNITS} if name.startswith("wrench on ") else INPUT_UNITS)


def output_comment(output):
    """A line about an output: how many numbers, in which shape and unit."""
    rows = f", row by row of an array {output.shape}" if len(output.shape) > 1 else ""
    return _array_comment(output.name, len(output.entries), OUTPUT_UNITS, rows)


def _array_comment(name, size, units, rows=""):
    unit = f" [{units[name]}]" if name in units else ""
    return f"{sanitize_comment(name)}: {size} number{'s' * (size != 1)}{rows}{unit}"


def joints_comment(joint_names, other_vectors=()):
    """Lines that tell which entry of a joint vector belongs to which joint.

    others: (sentence, names), of vectors that have other joints.
    """
    lines = []
    for sentence, names in (("Joints, by the place of their entry", joint_names), *other_vectors):
        told = ", ".join(f"{place} {sanitize_comment(name)}" for place, name in enumerate(names))
        lines += textwrap.wrap(f"{sentence}: {told}.", 100) if names else []
    return lines
