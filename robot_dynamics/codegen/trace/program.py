"""A straight-line program: what a trace leaves when all is dropped that no output reads, and how much it computes."""

from collections import Counter
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robot_dynamics.codegen.trace.scalar import (
    ADD,
    CONSTANT,
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
    Scalar,
)


class OperationCount(NamedTuple):
    """How many operations a call takes: ×, + and -, ÷, sines and cosines, √, signs. Unary minus is free."""

    multiplications: int
    additions: int
    divisions: int
    trigonometric: int
    square_roots: int
    signs: int

    def __str__(self):
        told = f"{self.multiplications} × / {self.additions} +"
        others = zip((self.divisions, self.trigonometric, self.square_roots), ("÷", "sin/cos", "√"), strict=True)
        return told + "".join(f" / {count} {name}" for count, name in others if count)


class Statement(NamedTuple):
    """Node `number` is `operation` of `operands`, numbers of nodes before it; leaves as in Trace."""

    number: int
    operation: str
    operands: tuple


class Output(NamedTuple):
    """An array that the program gives: its name, its shape, and for each entry, row by row, (node, sign)."""

    name: str
    shape: tuple
    entries: tuple


class Interface(NamedTuple):
    """What callers need to know of a program.

    name: of the model; inputs: {name: size}, in the order of the arguments; outputs: (name, shape) of each;
    operations: the Operations of a call.
    """

    name: str
    inputs: dict
    outputs: tuple
    operations: OperationCount


@dataclass(frozen=True, eq=False)
class Program:
    """A model as a list of statements.

    name: of the model. inputs: {name: size} of the arrays that a call is given, in the order of its arguments;
    outputs: those that it gives. parameters: names of the numbers that are given once. setup: statements that depend
    on parameters and constants alone, computed once; statements: computed in each call. Leaves are among `leaves`.
    """

    name: str
    inputs: dict
    parameters: tuple
    leaves: tuple
    setup: tuple
    statements: tuple
    outputs: tuple

    @cached_property
    def operations(self):
        """The Operations of one call: every binary +, -, × and ÷ of `statements` counts, 2x and squares too."""
        return count_operations(self.statements)

    @property
    def interface(self):
        """The Interface of the program."""
        return Interface(
            self.name, self.inputs, tuple((output.name, output.shape) for output in self.outputs), self.operations
        )


def count_operations(statements):
    """The Operations of some statements."""
    times = Counter(statement.operation for statement in statements)
    return OperationCount(
        times[MULTIPLY],
        times[ADD] + times[SUBTRACT],
        times[DIVIDE],
        times[SINE] + times[COSINE],
        times[SQUARE_ROOT],
        times[SIGN],
    )


def build_program(trace, name, inputs, outputs):
    """The Program that computes arrays of Scalars (or numbers) {name: array} from inputs {name: size} of a Trace."""
    told = tuple(_output(trace, key, np.asarray(value)) for key, value in outputs.items())
    read = _read(trace, [node for output in told for node, _ in output.entries])
    varies = [False] * len(trace.nodes)
    leaves, setup, statements, parameters = [], [], [], []
    for number, (operation, operands) in enumerate(trace.nodes):
        if operation == INPUT:
            varies[number] = True
        elif operation not in LEAVES:
            varies[number] = any(varies[operand] for operand in operands)
        if not read[number]:
            continue
        statement = Statement(number, operation, operands)
        if operation in LEAVES:
            leaves.append(statement)
            if operation == PARAMETER:
                parameters.append(operands[0])
        else:
            (statements if varies[number] else setup).append(statement)
    return Program(name, dict(inputs), tuple(parameters), tuple(leaves), tuple(setup), tuple(statements), told)


def _output(trace, name, array):
    entries = []
    for entry in array.ravel():
        scalar = entry if isinstance(entry, Scalar) else trace.constant(entry)
        entries.append((scalar.node, scalar.sign))
    return Output(name, array.shape, tuple(entries))


def _read(trace, nodes):
    """For each node whether an output depends on it."""
    read = [False] * len(trace.nodes)
    for node in nodes:
        read[node] = True
    for number in range(len(trace.nodes) - 1, -1, -1):
        operation, operands = trace.nodes[number]
        if read[number] and operation not in LEAVES:
            for operand in operands:
                read[operand] = True
    return read


def constant_values(program):
    """{number: value} of the constants among the leaves."""
    return {leaf.number: leaf.operands[0] for leaf in program.leaves if leaf.operation == CONSTANT}
