"""Gradients of what a straight-line program computes, by reverse accumulation over its statements.

    s = Σ w y(x),   ds/dx by one sweep through the statements and one back

for weights w of the outputs y, at about four times the cost of y itself, however many inputs x there are. Source:
Griewank and Walther, "Evaluating Derivatives", chapter 3. All samples of a batch go through together, as arrays.
"""

from typing import NamedTuple

import numpy as np

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


class Evaluation(NamedTuple):
    """outputs (N, entries) that a DifferentiableProgram gives; values: of its nodes, for `gradient`."""

    outputs: np.ndarray
    values: dict


class DifferentiableProgram:
    """Some of the entries of the outputs of a Program, and gradients of weighted sums of them.

    entries: numbers of the entries wanted, row by row, of all outputs one after the other; None: all. widths: {name of
    an input: (size,)}: signs of inputs of this name are smoothed over such a width, x / √(x² + width²), so that they
    have a derivative; the sign of anything else has derivative zero, as where width is 0.

    Raises QuestionError where the program has parameters without a value.
    """

    def __init__(self, program, entries=None, smoothing_widths=None):
        read = [entry for output in program.outputs for entry in output.entries]
        read = read if entries is None else [read[number] for number in entries]
        self._nodes, self._signs = [node for node, _ in read], np.array([sign for _, sign in read], dtype=float)
        self._inputs, self._known = dict(program.inputs), fold_finite_constants(program, {})
        self._places = {leaf.number: leaf.operands for leaf in program.leaves if leaf.operation == INPUT}
        needed = set(self._nodes)
        for number, _, operands in reversed(program.statements):
            if number in needed:
                needed.update(operands)
        self._statements = [statement for statement in program.statements if statement.number in needed]
        self._widths = {number: float(smoothing_widths[name][place]) for number, (name, place) in self._places.items()
                        if smoothing_widths and name in smoothing_widths}  # fmt: skip

    def evaluate(self, *arrays):
        """The Evaluation at inputs (N, size), in the order of the program's."""
        given = dict(zip(self._inputs, map(np.asarray, arrays), strict=True))
        values = dict(self._known)
        for number, (name, place) in self._places.items():
            values[number] = np.ascontiguousarray(given[name][:, place])
        for number, operation, operands in self._statements:
            values[number] = self._value(operation, operands, values)
        samples = len(next(iter(given.values())))
        outputs = np.empty((samples, len(self._nodes)))
        for column, node in enumerate(self._nodes):
            outputs[:, column] = values[node]
        return Evaluation(outputs * self._signs, values)

    def gradient(self, evaluation, weights):
        """{name of an input: (N, size)}: derivatives of Σ weights * outputs, for weights (N, entries)."""
        sums, known, values = {}, self._known, evaluation.values
        for node, column in zip(self._nodes, (weights * self._signs).T, strict=True):
            if node not in known:
                sums[node] = sums[node] + column if node in sums else column
        for number, operation, operands in reversed(self._statements):
            if number in sums:
                for operand, share in self._shares(operation, operands, values, number, sums.pop(number)):
                    if operand not in known:
                        sums[operand] = sums[operand] + share if operand in sums else share
        found = {name: np.zeros((len(weights), size)) for name, size in self._inputs.items()}
        for number, (name, place) in self._places.items():
            if number in sums:
                found[name][:, place] = sums[number]
        return found

    def _value(self, operation, operands, values):
        """What a statement computes."""
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

    def _shares(self, operation, operands, values, number, share):
        """(operand, derivative of the sum by it) of a statement, for the derivative `share` by its result."""
        x = values[operands[0]]
        if operation == MULTIPLY:
            return (operands[0], share * values[operands[1]]), (operands[1], share * x)
        if operation == ADD:
            return (operands[0], share), (operands[1], share)
        if operation == SUBTRACT:
            return (operands[0], share), (operands[1], -share)
        if operation == DIVIDE:
            quotient = share / values[operands[1]]
            return (operands[0], quotient), (operands[1], -quotient * values[number])
        if operation == SINE:
            return ((operands[0], share * np.cos(x)),)
        if operation == COSINE:
            return ((operands[0], -share * np.sin(x)),)
        if operation == SQUARE_ROOT:
            return ((operands[0], 0.5 * share / values[number]),)
        width = self._widths.get(operands[0], 0.0)
        return ((operands[0], share * width**2 / (x * x + width**2) ** 1.5),) if width else ()
