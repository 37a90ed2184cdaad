"""Gradients of the outputs of a straight-line program, by reverse accumulation over its statements.

    s = Σ w y(x),   ds/dx by one sweep through the statements and one back

for weights w of the outputs y, at about four times the cost of y, for any number of inputs x. All samples of a batch
are computed together, as arrays. Source: Griewank and Walther, "Evaluating Derivatives", chapter 3.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from robot_dynamics.codegen.jit.compiled_program import fold_finite_constants
from robot_dynamics.codegen.trace.scalar import (
    ADD,
    COSINE,
    DIVIDE,
    INPUT,
    MULTIPLY,
    SIGN,
    SINE,
    SQUARE_ROOT,
    SUBTRACT,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.codegen.trace.scalar import (
        Operands,
        Operation,
    )


class Evaluation(NamedTuple):
    """The result of DifferentiableProgram.evaluate.

    Attributes
    ----------
    outputs : (N, entries)
    values : dict of int to (N,) or float
        Value of each node, for `gradient`.
    """

    outputs: Array
    values: dict[int, Array | float]


class DifferentiableProgram:
    """Entries of the outputs of a Program, and gradients of weighted sums of them.

    Parameters
    ----------
    program : Program
        A program without parameters.
    entries : sequence of int, optional
        Numbers of the entries to compute, of all outputs in order, row by row. Default: all.
    smoothing_widths : mapping of str to (size,), optional
        For each named input, widths over which the signs of its entries are smoothed, x / √(x² + width²), so that they
        have a derivative. The sign of any other expression has derivative zero, as where the width is 0.

    Raises
    ------
    InvalidInputError
        If the program has parameters without a value.
    """

    def __init__(
        self,
        program: Program,
        entries: Sequence[int] | None = None,
        smoothing_widths: Mapping[str, ArrayLike] | None = None,
    ) -> None:
        all_entries = [entry for output in program.outputs for entry in output.entries]
        selected = all_entries if entries is None else [all_entries[number] for number in entries]
        self._nodes = [node for node, _ in selected]
        self._signs = np.array([sign for _, sign in selected], dtype=float)
        self._inputs = dict(program.inputs)
        self._constants = fold_finite_constants(program, {})
        self._input_entries: dict[int, tuple[str, int]] = {
            leaf.number: (leaf.operands[0], leaf.operands[1]) for leaf in program.leaves if leaf.operation == INPUT
        }
        used = set(self._nodes)
        for number, _, operands in reversed(program.statements):
            if number in used:
                used.update(operands)
        self._statements = [statement for statement in program.statements if statement.number in used]
        widths = {name: np.asarray(values) for name, values in (smoothing_widths or {}).items()}
        self._widths = {
            number: float(widths[name][position])
            for number, (name, position) in self._input_entries.items()
            if name in widths
        }

    def evaluate(self, *arrays: ArrayLike) -> Evaluation:
        """The Evaluation at N samples of the inputs (N, size), in the order of the program."""
        inputs = dict(zip(self._inputs, map(np.asarray, arrays), strict=True))
        values: dict[int, Array | float] = dict(self._constants)
        for number, (name, position) in self._input_entries.items():
            values[number] = np.ascontiguousarray(inputs[name][:, position])
        for number, operation, operands in self._statements:
            values[number] = self._value(operation, operands, values)
        samples = len(next(iter(inputs.values())))
        outputs = np.empty((samples, len(self._nodes)))
        for column, node in enumerate(self._nodes):
            outputs[:, column] = values[node]
        return Evaluation(outputs * self._signs, values)

    def gradient(self, evaluation: Evaluation, weights: Array) -> dict[str, Array]:
        """Derivatives of Σ weights * outputs by each input, (N, size), for weights (N, entries)."""
        adjoints: dict[int, Array | float] = {}
        for node, column in zip(self._nodes, (weights * self._signs).T, strict=True):
            if node not in self._constants:
                adjoints[node] = adjoints[node] + column if node in adjoints else column
        for number, operation, operands in reversed(self._statements):
            if number in adjoints:
                contributions = self._contributions(
                    operation, operands, evaluation.values, number, adjoints.pop(number)
                )
                for operand, contribution in contributions:
                    if operand not in self._constants:
                        adjoints[operand] = adjoints[operand] + contribution if operand in adjoints else contribution
        gradients = {name: np.zeros((len(weights), size)) for name, size in self._inputs.items()}
        for number, (name, position) in self._input_entries.items():
            if number in adjoints:
                gradients[name][:, position] = adjoints[number]
        return gradients

    def _value(self, operation: Operation, operands: Operands, values: dict[int, Array | float]) -> Array | float:
        """The result of a statement."""
        x = values[operands[0]]
        if operation == MULTIPLY:
            return x * values[operands[1]]
        if operation == ADD:
            return x + values[operands[1]]
        if operation == SUBTRACT:
            return x - values[operands[1]]
        if operation == DIVIDE:
            return x / values[operands[1]]
        if operation == SIGN:
            width = self._widths.get(operands[0], 0.0)
            return x / np.sqrt(x * x + width**2) if width else np.sign(x)
        return {SINE: np.sin, COSINE: np.cos, SQUARE_ROOT: np.sqrt}[operation](x)

    def _contributions(
        self,
        operation: Operation,
        operands: Operands,
        values: dict[int, Array | float],
        number: int,
        adjoint: Array | float,
    ) -> tuple[tuple[int, Array | float], ...]:
        """(operand, its part of the derivative) for each operand of a statement, from the derivative by its result."""
        x = values[operands[0]]
        if operation == MULTIPLY:
            return (operands[0], adjoint * values[operands[1]]), (operands[1], adjoint * x)
        if operation == ADD:
            return (operands[0], adjoint), (operands[1], adjoint)
        if operation == SUBTRACT:
            return (operands[0], adjoint), (operands[1], -adjoint)
        if operation == DIVIDE:
            quotient = adjoint / values[operands[1]]
            return (operands[0], quotient), (operands[1], -quotient * values[number])
        if operation == SINE:
            return ((operands[0], adjoint * np.cos(x)),)
        if operation == COSINE:
            return ((operands[0], -adjoint * np.sin(x)),)
        if operation == SQUARE_ROOT:
            return ((operands[0], 0.5 * adjoint / values[number]),)
        width = self._widths.get(operands[0], 0.0)
        return ((operands[0], adjoint * width**2 / (x * x + width**2) ** 1.5),) if width else ()
