"""Programs as Python functions, for one sample or many.

Floats behave as in compiled code: the sine of an infinity is NaN, and division by zero gives an infinity.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robot_dynamics.codegen.emit.code_text import (
    UniqueNames,
    VariableNames,
    expression,
    float_literal,
    operations_used,
    setup_nodes,
    signed,
)
from robot_dynamics.codegen.emit.python_source import RESERVED, list_literal, python_literal, python_source, summary
from robot_dynamics.codegen.jit.constant_folding import fold_constants
from robot_dynamics.codegen.trace.scalar import COSINE, DIVIDE, INPUT, SIGN, SINE, SQUARE_ROOT
from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.trace.program import Output, Program, ProgramResult, Statement

INLINE_SIGN = "1.0 if (x_ := {}) > 0 else -1.0 if x_ < 0 else x_ + 0.0"

MAX_EXPRESSION_OPERATIONS = 12
"""Operations that functions compute in one line."""

BLOCK_SIZE = 2048
"""Samples that are computed together, so that their values stay in the cache of the processor."""


def python_function(program: Program, parameters: Mapping[str, float] | None = None) -> Callable[..., Any]:
    """The function of one sample.

    Parameters
    ----------
    program : Program
    parameters : mapping of str to float, optional
        Values of the parameters of the program, which become constants; further names are ignored.

    Returns
    -------
    callable
        Takes the inputs as sequences and returns the result of the function of `python_source`, which it calls where
        `math` raises an error.

    Raises
    ------
    InvalidInputError
        If a parameter has no value.
    """
    constants = fold_constants(program, parameters)
    body = _FunctionBody(program, constants, vectorised=False)
    lists = [list_literal(body.entries(output)) for output in program.outputs]
    lines = [*body.lines, f"return {lists[0] if len(lists) == 1 else _tuple_literal(lists)}"]
    if operations_used(program) & {SINE, COSINE, SQUARE_ROOT, DIVIDE}:
        lines = ["try:", *("    " + line for line in lines), "except (ValueError, ZeroDivisionError):"]
        lines.append(f"    return fallback()({', '.join(body.inputs.values())})")
    scope: dict[str, Any] = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "inf": math.inf, "nan": math.nan}
    scope["fallback"] = functools.cache(functools.partial(_source_function, program, constants))
    unpacking = [f"{names} = map(float, {array})" for array, names in body.unpacking(program)]
    return _compile(program, body, unpacking + lines, scope)


def python_batch(program: Program, parameters: Mapping[str, float] | None = None) -> Callable[..., ProgramResult]:
    """The function of many samples: the lines of `python_function`, computed by NumPy.

    Parameters
    ----------
    program, parameters
        See `python_function`.

    Returns
    -------
    callable
        Takes the inputs as arrays (N, size) and returns the outputs (N, *shape), as a tuple if there are several.
        Raises InvalidInputError for arrays of other shapes.

    Raises
    ------
    InvalidInputError
        If a parameter has no value.
    """
    body = _FunctionBody(program, fold_constants(program, parameters), vectorised=True)
    lists = [list_literal(body.entries(output)) for output in program.outputs]
    lines = [*body.lines, f"return {_tuple_literal(lists)}"]
    scope: dict[str, Any] = {
        "sin": np.sin,
        "cos": np.cos,
        "sqrt": np.sqrt,
        "sign": np.sign,
        "inf": math.inf,
        "nan": math.nan,
    }
    unpacking = [f"{names} = {array}" for array, names in body.unpacking(program)]
    compute_columns = _compile(program, body, unpacking + lines, scope)

    def batch(*inputs: ArrayLike) -> ProgramResult:
        arrays = _sample_arrays(program, inputs)
        count = len(arrays[0]) if arrays else 1
        results = [np.empty((count, len(output.entries))) for output in program.outputs]
        with np.errstate(all="ignore"):
            for start in range(0, count, BLOCK_SIZE):
                block = slice(start, start + BLOCK_SIZE)
                computed = compute_columns(*(np.ascontiguousarray(array[block].T) for array in arrays))
                for result, columns in zip(results, computed, strict=True):
                    for position, column in enumerate(columns):
                        result[block, position] = column
        shaped = [result.reshape(count, *output.shape) for result, output in zip(results, program.outputs, strict=True)]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    batch.__doc__ = summary(program)
    return batch


def _tuple_literal(texts: Sequence[str]) -> str:
    return f"({''.join(f'{text}, ' for text in texts)})"


def _source_function(program: Program, constants: Mapping[int, float]) -> Callable[..., Any]:
    """The function of `python_source` with the values of its constants."""
    scope: dict[str, Any] = {}
    exec(compile(python_source(program), "<robot_dynamics>", "exec"), scope)
    function: Callable[..., Any] = scope[VariableNames(program, UniqueNames(RESERVED), python_literal).function]
    if not program.parameters:
        return function
    return functools.partial(function, constants=[constants[node] for node in setup_nodes(program)])


def _sample_arrays(program: Program, inputs: Sequence[ArrayLike]) -> list[Array]:
    """The inputs as arrays (N, size), all with the same N."""
    if len(inputs) != len(program.inputs):
        names = ", ".join(map(repr, program.inputs))
        raise InvalidInputError(
            f"{program.name}: {len(program.inputs)} arrays ({names}) are needed, but {len(inputs)} were passed"
        )
    arrays = [np.asarray(array, dtype=float) for array in inputs]
    for (name, size), array in zip(program.inputs.items(), arrays, strict=True):
        if array.ndim != 2 or array.shape[1] != size or len(array) != len(arrays[0]):
            raise InvalidInputError(
                f"{name!r} has shape {array.shape}: (N, {size}) is needed, with the same N for all inputs"
            )
    return arrays


def _compile(program: Program, body: _FunctionBody, lines: Sequence[str], scope: dict[str, Any]) -> Callable[..., Any]:
    """The function with some lines, in a scope with the names that they read."""
    text = "\n    ".join([f"def {body.function}({', '.join(body.inputs.values())}):", *lines])
    exec(compile(text, "<robot_dynamics>", "exec"), scope)
    function: Callable[..., Any] = scope[body.function]
    function.__doc__ = summary(program)
    return function


class _FunctionBody:
    """The statements of a program in few and fast lines.

    A result that one operation alone reads is computed within the line of that operation, and a local variable whose
    value is no longer read is reused: Python is slower from the 257th local variable on, and NumPy where arrays exceed
    the cache.

    Parameters
    ----------
    program : Program
    constants : mapping of int to float
        Value of each node that is known before a call.
    vectorised : bool
        Whether the lines compute arrays.

    Attributes
    ----------
    function : str
        Name of the function.
    inputs : dict of str to str
        Identifier of each input.
    lines : list of str
        Lines of the body. Names of local variables end in _, which no other identifier does.
    """

    def __init__(self, program: Program, constants: Mapping[int, float], vectorised: bool) -> None:
        names = UniqueNames(RESERVED)
        self.function = names.take(program.name, "model")
        self.inputs = {name: names.take(name, "input") for name in program.inputs}
        self.lines: list[str] = []
        self._vectorised = vectorised
        self._texts = {number: float_literal(value, "inf", "nan") for number, value in constants.items()}
        for number, operation, operands in program.leaves:
            if operation == INPUT:
                self._texts[number] = self._entry(*operands)
        self._remaining_reads = Counter(operand for statement in program.statements for operand in statement.operands)
        self._output_nodes = {node for output in program.outputs for node, _ in output.entries}
        self._inline: dict[int, tuple[str, list[int], int]] = {}  # text, nodes that it reads, operations
        self._locals: dict[int, str] = {}
        self._free_locals: list[str] = []
        for statement in program.statements:
            self._add(statement)

    def entries(self, output: Output) -> list[str]:
        """The texts of the entries of an output, row by row."""
        return [signed(self._texts[node], sign) for node, sign in output.entries]

    def unpacking(self, program: Program) -> Iterator[tuple[str, str]]:
        """For each input its identifier and the list of local variables to which its entries are assigned."""
        used = {leaf.operands for leaf in program.leaves if leaf.operation == INPUT}
        for name, size in program.inputs.items():
            entries = [self._entry(name, k) if (name, k) in used else "_" for k in range(size)]
            yield self.inputs[name], list_literal(entries)

    def _entry(self, name: str, position: int) -> str:
        return f"{self.inputs[name]}_{position}_"

    def _add(self, statement: Statement) -> None:
        """Write a statement, or defer it to the line of the only operation that reads it."""
        number, operation, operands = statement
        texts, reads, size = [], [], 1
        for operand in operands:
            if operand in self._inline:
                text, inner_reads, operations = self._inline.pop(operand)
            else:
                text, inner_reads, operations = self._texts[operand], [operand], 0
            texts.append(text)
            reads += inner_reads
            size += operations
        if operation == SIGN and not self._vectorised:
            text = INLINE_SIGN.format(*texts)
        else:
            text = expression(operation, texts)
        is_read_once = self._remaining_reads[number] == 1 and number not in self._output_nodes
        if size < MAX_EXPRESSION_OPERATIONS and is_read_once:
            self._inline[number] = f"({text})", reads, size
        else:
            self._assign(number, text, reads)

    def _assign(self, number: int, text: str, reads: Sequence[int]) -> None:
        """Assign a node to a local variable, which may be one that the line reads for the last time."""
        for operand in reads:
            self._remaining_reads[operand] -= 1
            is_free = not self._remaining_reads[operand] and operand not in self._output_nodes
            if is_free and operand in self._locals:
                self._free_locals.append(self._locals.pop(operand))
        self._locals[number] = self._free_locals.pop() if self._free_locals else f"t{len(self._locals)}_"
        self._texts[number] = self._locals[number]
        self.lines.append(f"{self._locals[number]} = {text}")
