"""Straight-line programs: the nodes of a trace on which an output depends, and how many operations they take."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias

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

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.scalar import (
        Operands,
        Operation,
        Trace,
    )

ProgramResult: TypeAlias = Any
"""The outputs of a program: one array, or a tuple of arrays where it has several outputs."""


class OperationCount(NamedTuple):
    """The number of operations in a call: ×, + and -, ÷, sines and cosines, √, signs. Unary minus is free."""

    multiplications: int
    additions: int
    divisions: int
    trigonometric: int
    square_roots: int
    signs: int

    def __str__(self) -> str:
        text = f"{self.multiplications} × / {self.additions} +"
        counts = ((self.divisions, "÷"), (self.trigonometric, "sin/cos"), (self.square_roots, "√"))
        return text + "".join(f" / {count} {name}" for count, name in counts if count)


class Statement(NamedTuple):
    """Node `number` is `operation` of `operands`, numbers of earlier nodes; operands of leaves are those of Trace."""

    number: int
    operation: Operation
    operands: Operands


class Output(NamedTuple):
    """An array that a program computes: its name, its shape, and (node, sign) of each entry, row by row."""

    name: str
    shape: tuple[int, ...]
    entries: tuple[tuple[int, int], ...]


class Interface(NamedTuple):
    """The part of a program that its callers need.

    Attributes
    ----------
    name : str
        Name of the model.
    inputs : dict of str to int
        Size of each input, in the order of the arguments.
    outputs : tuple of (str, tuple of int)
        Name and shape of each output.
    operations : OperationCount
        Operations of a call.
    """

    name: str
    inputs: dict[str, int]
    outputs: tuple[tuple[str, tuple[int, ...]], ...]
    operations: OperationCount


@dataclass(frozen=True, eq=False)
class Program:
    """A model as a list of statements.

    Attributes
    ----------
    name : str
        Name of the model.
    inputs : dict of str to int
        Size of each array that a call takes, in the order of its arguments.
    parameters : tuple of str
        Names of the numbers of the robot that have no value yet.
    leaves : tuple of Statement
        The inputs, parameters and constants that are used.
    setup : tuple of Statement
        Statements that depend on parameters and constants alone, computed once.
    statements : tuple of Statement
        Statements computed in each call.
    outputs : tuple of Output
        Arrays that a call returns.
    """

    name: str
    inputs: dict[str, int]
    parameters: tuple[str, ...]
    leaves: tuple[Statement, ...]
    setup: tuple[Statement, ...]
    statements: tuple[Statement, ...]
    outputs: tuple[Output, ...]

    @cached_property
    def operations(self) -> OperationCount:
        """The OperationCount of a call: each binary +, -, × and ÷ of `statements` counts, 2x and squares too."""
        return count_operations(self.statements)

    @property
    def interface(self) -> Interface:
        """The Interface of the program."""
        outputs = tuple((output.name, output.shape) for output in self.outputs)
        return Interface(self.name, self.inputs, outputs, self.operations)


def count_operations(statements: Iterable[Statement]) -> OperationCount:
    """The OperationCount of some statements."""
    counts = Counter(statement.operation for statement in statements)
    return OperationCount(
        multiplications=counts[MULTIPLY],
        additions=counts[ADD] + counts[SUBTRACT],
        divisions=counts[DIVIDE],
        trigonometric=counts[SINE] + counts[COSINE],
        square_roots=counts[SQUARE_ROOT],
        signs=counts[SIGN],
    )


def build_program(trace: Trace, name: str, inputs: Mapping[str, int], outputs: Mapping[str, ScalarArray]) -> Program:
    """The Program that computes some arrays of a trace.

    Parameters
    ----------
    trace : Trace
        The recorded nodes.
    name : str
        Name of the program.
    inputs : mapping of str to int
        Size of each input of the trace, in the order of the arguments.
    outputs : mapping of str to array of any shape
        Arrays of Scalars of the trace, or of numbers.

    Returns
    -------
    Program
        Without the nodes on which no output depends.
    """
    traced_outputs = tuple(_output(trace, key, np.asarray(array)) for key, array in outputs.items())
    is_used = _mark_used_nodes(trace, [node for output in traced_outputs for node, _ in output.entries])
    depends_on_input = [False] * len(trace.nodes)
    leaves, setup, statements = [], [], []
    parameters = []
    for number, (operation, operands) in enumerate(trace.nodes):
        if operation == INPUT:
            depends_on_input[number] = True
        elif operation not in LEAVES:
            depends_on_input[number] = any(depends_on_input[operand] for operand in operands)
        if not is_used[number]:
            continue
        statement = Statement(number, operation, operands)
        if operation in LEAVES:
            leaves.append(statement)
            if operation == PARAMETER:
                parameters.append(operands[0])
        elif depends_on_input[number]:
            statements.append(statement)
        else:
            setup.append(statement)
    return Program(
        name, dict(inputs), tuple(parameters), tuple(leaves), tuple(setup), tuple(statements), traced_outputs
    )


def _output(trace: Trace, name: str, array: ScalarArray) -> Output:
    entries = []
    for entry in array.ravel():
        scalar = entry if isinstance(entry, Scalar) else trace.constant(entry)
        entries.append((scalar.node, scalar.sign))
    return Output(name, array.shape, tuple(entries))


def _mark_used_nodes(trace: Trace, output_nodes: Iterable[int]) -> list[bool]:
    """For each node whether an output depends on it."""
    is_used = [False] * len(trace.nodes)
    for node in output_nodes:
        is_used[node] = True
    for number in range(len(trace.nodes) - 1, -1, -1):
        operation, operands = trace.nodes[number]
        if is_used[number] and operation not in LEAVES:
            for operand in operands:
                is_used[operand] = True
    return is_used


def order_by_use(program: Program) -> Program:
    """The same Program with each statement shortly before the first one that reads it.

    Outputs are computed column by column. Few values are then in use at a time: machine code keeps more of them in
    registers, and passes fewer of them between the parts of a long program.
    """
    statements = {statement.number: statement for statement in program.statements}
    ordered: dict[int, Statement] = {}
    for output in program.outputs:
        numbers = np.arange(len(output.entries)).reshape(output.shape)
        for entry in numbers.T.ravel():
            _append_with_operands(output.entries[entry][0], statements, ordered)
    return replace(program, statements=tuple(ordered.values()))


def _append_with_operands(node: int, statements: Mapping[int, Statement], ordered: dict[int, Statement]) -> None:
    """Append a statement to `ordered` after those that it needs, unless they are there."""
    pending = [node]
    while pending:
        number = pending[-1]
        missing = []
        if number in statements and number not in ordered:
            missing = [k for k in statements[number].operands if k in statements and k not in ordered]
            if not missing:
                ordered[number] = statements[number]
        if missing:
            pending += missing[::-1]
        else:
            pending.pop()


def constant_values(program: Program) -> dict[int, float]:
    """The value of each constant among the leaves, by node number."""
    return {leaf.number: leaf.operands[0] for leaf in program.leaves if leaf.operation == CONSTANT}
