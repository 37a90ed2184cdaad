"""Derivatives of traced scalars along directions, recorded in the same trace.

    dy = ∂y/∂x ẋ,   one column for each direction ẋ of the variables x

Forward accumulation carries the columns from the variables to the outputs, reverse accumulation carries ∂y/∂(node) from
the outputs to the variables and multiplies by the directions at the end. Both are sparse: a node has entries only for
columns on which it depends, and only nodes between variables and outputs are visited. Both record the same derivative
with different operations; which has fewer depends on the program. The trace reuses what it has recorded before: sines
and cosines of the program above all. Source: Griewank and Walther, "Evaluating Derivatives", chapters 3 and 7.

The derivative of a sign is zero, as it is away from the jump.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.codegen.trace.scalar import (
    ADD,
    COSINE,
    DIVIDE,
    INPUT,
    LEAVES,
    MULTIPLY,
    SIGN,
    SINE,
    SQUARE_ROOT,
    SUBTRACT,
    Scalar,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.scalar import Trace

SparseRow: TypeAlias = dict[int, Scalar]
"""Entries of a row that are not zero, by column."""

Accumulation: TypeAlias = "Callable[[Trace, ScalarArray, ScalarArray, ScalarArray], ScalarArray]"
"""`forward_accumulation` or `reverse_accumulation`."""


def forward_accumulation(
    trace: Trace, outputs: ScalarArray, variables: ScalarArray, directions: ScalarArray
) -> ScalarArray:
    """Derivatives of outputs along directions, accumulated from the variables to the outputs.

    Parameters
    ----------
    trace : Trace
        Records the derivatives.
    outputs : (m,)
        Scalars of the trace, or numbers.
    variables : (k,)
        Inputs of the trace, each once. All other inputs are constant.
    directions : (k, c)
        Scalars of the trace, or numbers: derivatives of the variables.

    Returns
    -------
    (m, c)
        Zeros are numbers.
    """
    rows: dict[int, SparseRow] = {}
    for variable, direction in zip(variables, directions, strict=True):
        entries = {column: entry for column, entry in enumerate(direction) if not _is_zero(entry)}
        rows[variable.node] = {column: _as_scalar(trace, entry) for column, entry in entries.items()}
    for number in _active_nodes(trace, outputs, variables):
        row: SparseRow = {}
        for operand, partial in _partial_derivatives(trace, number):
            for column, entry in rows.get(operand, {}).items():
                _add(row, column, partial * entry)
        rows[number] = row
    return _dense(outputs, rows, directions.shape[1])


def reverse_accumulation(
    trace: Trace, outputs: ScalarArray, variables: ScalarArray, directions: ScalarArray
) -> ScalarArray:
    """As `forward_accumulation`, accumulated from the outputs to the variables."""
    is_moved = [any(not _is_zero(entry) for entry in direction) for direction in directions]
    variables, directions = variables[is_moved], directions[is_moved]
    active = _active_nodes(trace, outputs, variables)
    carrying = {*active, *(variable.node for variable in variables)}
    adjoints: dict[int, SparseRow] = {number: {} for number in carrying}
    for index, output in enumerate(outputs):
        if isinstance(output, Scalar) and output.node in carrying:
            _add(adjoints[output.node], index, trace.constant(output.sign))
    for number in reversed(active):
        adjoint = adjoints.pop(number)
        if adjoint:
            for operand, partial in _partial_derivatives(trace, number):
                if operand in carrying:
                    for index, entry in adjoint.items():
                        _add(adjoints[operand], index, partial * entry)
    gradients: ScalarArray = np.zeros((len(outputs), len(variables)), dtype=object)
    for column, variable in enumerate(variables):
        for index, entry in adjoints[variable.node].items():
            gradients[index, column] = entry
    return _sparse_product(gradients, directions)


def substitute(trace: Trace, arrays: Sequence[ScalarArray], replacements: Mapping[int, Scalar]) -> list[ScalarArray]:
    """Arrays of a trace with some of its inputs replaced by other scalars of it.

    Parameters
    ----------
    trace : Trace
    arrays : sequence of arrays of any shape
    replacements : mapping of int to Scalar
        By node number. The replacements themselves stay as they are.

    Returns
    -------
    list of arrays
    """
    scalars = [entry for array in arrays for entry in np.ravel(array) if isinstance(entry, Scalar)]
    replaced = dict(replacements)
    # nodes recorded below are no part of the old expressions
    for number in _active_nodes(trace, scalars, [Scalar(trace, node, 1) for node in replacements]):
        operation, operands = trace.nodes[number]
        new_operands = [replaced.get(operand, Scalar(trace, operand, 1)) for operand in operands]
        replaced[number] = _record(trace, operation, new_operands)

    def new_entry(entry: object) -> object:
        if not isinstance(entry, Scalar) or entry.node not in replaced:
            return entry
        new = replaced[entry.node]
        return -new if entry.sign < 0 else new

    results = []
    for array in arrays:
        result = np.empty(np.shape(array), dtype=object)
        result.ravel()[:] = [new_entry(entry) for entry in np.ravel(array)]
        results.append(result)
    return results


def _record(trace: Trace, operation: str, operands: Sequence[Scalar]) -> Scalar:
    """The Scalar of an operation on other operands."""
    if operation == ADD:
        return trace.sum(*operands)
    if operation == SUBTRACT:
        return trace.sum(operands[0], -operands[1])
    if operation == MULTIPLY:
        return trace.product(*operands)
    if operation == DIVIDE:
        return trace.quotient(*operands)
    return trace.function(operation, operands[0])  # type: ignore[arg-type]  # one of the functions


def _active_nodes(trace: Trace, outputs: Iterable[object], variables: Iterable[Scalar]) -> list[int]:
    """Numbers of the nodes between variables and outputs, both excluded where they are inputs, in order."""
    nodes = [output.node for output in outputs if isinstance(output, Scalar)]
    starts = {variable.node for variable in variables}
    if not nodes or not starts:
        return []
    first = min(starts)
    depends = [False] * (max(nodes) + 1)
    for start in starts:
        if start < len(depends):
            depends[start] = True
    for number in range(first, len(depends)):
        operation, operands = trace.nodes[number]
        if operation not in LEAVES:
            depends[number] = any(depends[operand] for operand in operands)
    is_used = [False] * len(depends)
    for node in nodes:
        is_used[node] = True
    active = []
    for number in range(len(depends) - 1, -1, -1):
        operation, operands = trace.nodes[number]
        if is_used[number] and depends[number] and operation not in LEAVES:
            active.append(number)
            for operand in operands:
                is_used[operand] = True
    return active[::-1]


def _partial_derivatives(trace: Trace, number: int) -> list[tuple[int, Scalar]]:
    """(operand, partial derivative by it) of a node."""
    operation, operands = trace.nodes[number]
    one = trace.constant(1)
    x, *others = (Scalar(trace, operand, 1) for operand in operands)
    if operation == MULTIPLY:
        return [(operands[0], others[0]), (operands[1], x)]
    if operation == ADD:
        return [(operands[0], one), (operands[1], one)]
    if operation == SUBTRACT:
        return [(operands[0], one), (operands[1], -one)]
    if operation == SINE:
        return [(operands[0], x.cos())]
    if operation == COSINE:
        return [(operands[0], -x.sin())]
    if operation == DIVIDE:
        reciprocal = one / others[0]
        return [(operands[0], reciprocal), (operands[1], -(Scalar(trace, number, 1) * reciprocal))]
    if operation == SQUARE_ROOT:
        return [(operands[0], 0.5 / Scalar(trace, number, 1))]
    assert operation in (SIGN, INPUT), operation
    return []


def _add(row: SparseRow, column: int, entry: Scalar) -> None:
    total = row[column] + entry if column in row else entry
    if total.is_zero:
        row.pop(column, None)
    else:
        row[column] = total


def _is_zero(entry: object) -> bool:
    return entry.is_zero if isinstance(entry, Scalar) else entry == 0


def _as_scalar(trace: Trace, entry: Scalar | float) -> Scalar:
    return entry if isinstance(entry, Scalar) else trace.constant(entry)


def _dense(outputs: ScalarArray, rows: Mapping[int, SparseRow], columns: int) -> ScalarArray:
    """(m, columns) rows of the outputs."""
    result: ScalarArray = np.zeros((len(outputs), columns), dtype=object)
    for index, output in enumerate(outputs):
        if isinstance(output, Scalar):
            for column, entry in rows.get(output.node, {}).items():
                result[index, column] = -entry if output.sign < 0 else entry
    return result


def _sparse_product(matrix: ScalarArray, other: ScalarArray) -> ScalarArray:
    """matrix @ other without the terms that are zero."""
    product: ScalarArray = np.zeros((len(matrix), other.shape[1]), dtype=object)
    for i, row in enumerate(matrix):
        for k in [k for k, entry in enumerate(row) if not _is_zero(entry)]:
            for j in [j for j, entry in enumerate(other[k]) if not _is_zero(entry)]:
                product[i, j] = product[i, j] + row[k] * other[k, j]
    return product
