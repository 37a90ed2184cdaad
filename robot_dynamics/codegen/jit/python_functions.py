"""Programs as Python functions to call, for one sample or many.

Floats behave as in compiled code: the sine of an infinity is NaN, and division by zero gives an infinity.
"""

import functools
import math
from collections import Counter

import numpy as np

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

INLINE_SIGN = "1.0 if (x_ := {}) > 0 else -1.0 if x_ < 0 else x_ + 0.0"
MAX_EXPRESSION_OPERATIONS = 12  # operations that functions compute in one line
BLOCK_SIZE = 2048  # samples that go through a program together, so that what is alive stays in the cache


def python_function(program, parameters=None):
    """A function of the inputs of a program, sequences, that returns what the function of `python_source` does.

    parameters: {name: value} of the program's, settled here once; more may be among them. Raises QuestionError where
    one is missing. Where `math` would raise an error, the function of `python_source` is asked instead.
    """
    settled = fold_constants(program, parameters)
    packed = _Packed(program, settled, vectorised=False)
    lists = [list_literal(packed.entries(output)) for output in program.outputs]
    lines = [*packed.lines, f"return {lists[0] if len(lists) == 1 else _tuple(lists)}"]
    if operations_used(program) & {SINE, COSINE, SQUARE_ROOT, DIVIDE}:
        lines = ["try:", *("    " + line for line in lines), "except (ValueError, ZeroDivisionError):"]
        lines.append(f"    return elsewhere()({', '.join(packed.inputs.values())})")
    scope = {"sin": math.sin, "cos": math.cos, "sqrt": math.sqrt, "inf": math.inf, "nan": math.nan}
    scope["elsewhere"] = functools.cache(functools.partial(_careful_function, program, settled))
    unpacked = [f"{names} = map(float, {given})" for given, names in packed.unpacking(program)]
    return _compiled(program, packed, unpacked + lines, scope)


def python_batch(program, parameters=None):
    """A function of the inputs of a program as arrays (N, size) that returns its outputs as arrays (N, *shape).

    Several outputs are a tuple. The lines of `python_function`, each computed for many samples at once by NumPy.
    Raises QuestionError where a parameter is missing; the function does for arrays of other shapes.
    """
    packed = _Packed(program, fold_constants(program, parameters), vectorised=True)
    lines = [*packed.lines, f"return {_tuple([list_literal(packed.entries(output)) for output in program.outputs])}"]
    scope = {"sin": np.sin, "cos": np.cos, "sqrt": np.sqrt, "sign": np.sign, "inf": math.inf, "nan": math.nan}
    unpacked = [f"{names} = {given}" for given, names in packed.unpacking(program)]
    columns = _compiled(program, packed, unpacked + lines, scope)

    def batch(*inputs):
        arrays = _samples(program, inputs)
        count = len(arrays[0]) if arrays else 1
        found = [np.empty((count, len(output.entries))) for output in program.outputs]
        with np.errstate(all="ignore"):
            for start in range(0, count, BLOCK_SIZE):
                block = slice(start, start + BLOCK_SIZE)
                computed = columns(*(np.ascontiguousarray(array[block].T) for array in arrays))
                for array, entries in zip(found, computed, strict=True):
                    for place, entry in enumerate(entries):
                        array[block, place] = entry
        shaped = [array.reshape(count, *output.shape) for array, output in zip(found, program.outputs, strict=True)]
        return shaped[0] if len(shaped) == 1 else tuple(shaped)

    batch.__doc__ = summary(program)
    return batch


def _tuple(texts):
    return f"({''.join(f'{text}, ' for text in texts)})"


def _careful_function(program, settled):
    """The function of `python_source`, with its parameters settled."""
    scope = {}
    exec(compile(python_source(program), "<robot_dynamics>", "exec"), scope)
    function = scope[VariableNames(program, UniqueNames(RESERVED), python_literal).function]
    if not program.parameters:
        return function
    return functools.partial(function, settled=[settled[node] for node in setup_nodes(program)])


def _samples(program, inputs):
    """The inputs as arrays (N, size), all with the same N."""
    if len(inputs) != len(program.inputs):
        raise InvalidInputError(f"{len(inputs)} arrays are given: {', '.join(map(repr, program.inputs))} are needed")
    arrays = [np.asarray(given, dtype=float) for given in inputs]
    for (name, size), array in zip(program.inputs.items(), arrays, strict=True):
        if array.ndim != 2 or array.shape[1] != size or len(array) != len(arrays[0]):
            raise InvalidInputError(
                f"{name!r} has shape {array.shape}: (N, {size}), N the same for all inputs, is needed"
            )
    return arrays


def _compiled(program, packed, lines, scope):
    """The function of some lines and of the names that they read."""
    text = "\n    ".join([f"def {packed.function}({', '.join(packed.inputs.values())}):", *lines])
    exec(compile(text, "<robot_dynamics>", "exec"), scope)
    function = scope[packed.function]
    function.__doc__ = summary(program)
    return function


class _Packed:
    """The statements of a program in few and fast lines.

    What one operation alone reads is computed within its line, and a local whose value is no longer read takes another
    one: Python is slower from the 257th local on, and NumPy where arrays do not fit the cache.

    function, inputs: as in Variables; lines: of the body. Names of locals end in _, which no other identifier does.
    """

    def __init__(self, program, settled, vectorised):
        names = UniqueNames(RESERVED)
        self.function = names.take(program.name, "model")
        self.inputs = {name: names.take(name, "input") for name in program.inputs}
        self.lines = []
        self._vectorised = vectorised
        self._texts = {number: float_literal(value, "inf", "nan") for number, value in settled.items()}
        for number, operation, operands in program.leaves:
            if operation == INPUT:
                self._texts[number] = self._entry(*operands)
        self._left = Counter(operand for statement in program.statements for operand in statement.operands)
        self._returned = {node for output in program.outputs for node, _ in output.entries}
        self._within, self._locals, self._free = {}, {}, []
        for statement in program.statements:
            self._add(statement)

    def entries(self, output):
        """The texts of the entries of an output, row by row."""
        return [signed(self._texts[node], sign) for node, sign in output.entries]

    def unpacking(self, program):
        """For each input its name and the list of locals that its entries go to."""
        read = {leaf.operands for leaf in program.leaves if leaf.operation == INPUT}
        for name, size in program.inputs.items():
            yield (
                self.inputs[name],
                list_literal([self._entry(name, place) if (name, place) in read else "_" for place in range(size)]),
            )

    def _entry(self, name, place):
        return f"{self.inputs[name]}_{place}_"

    def _add(self, statement):
        """Write a statement, or keep it back for the line of the one that reads it."""
        number, operation, operands = statement
        texts, reads, size = [], [], 1
        for operand in operands:
            text, others, operations = self._within.pop(operand, (self._texts.get(operand), [operand], 0))
            texts.append(text)
            reads += others
            size += operations
        text = (
            INLINE_SIGN.format(*texts) if operation == SIGN and not self._vectorised else expression(operation, texts)
        )
        if size < MAX_EXPRESSION_OPERATIONS and self._left[number] == 1 and number not in self._returned:
            self._within[number] = f"({text})", reads, size
        else:
            self._keep(number, text, reads)

    def _keep(self, number, text, reads):
        """Write a line that gives the value of a node to a local, one that is free after the line has read."""
        for operand in reads:
            self._left[operand] -= 1
            if not self._left[operand] and operand not in self._returned and operand in self._locals:
                self._free.append(self._locals.pop(operand))
        self._locals[number] = self._free.pop() if self._free else f"t{len(self._locals)}_"
        self._texts[number] = self._locals[number]
        self.lines.append(f"{self._locals[number]} = {text}")
