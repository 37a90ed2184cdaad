"""Staging of procedures: Python functions to LLVM IR.

Each call of a procedure is staged by a Frame; this module has the operations that all of them use.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.codegen.procedure.memory import Memory, as_values
from robot_dynamics.codegen.procedure.slots import copy_memory
from robot_dynamics.codegen.procedure.symbols import Condition, Counter, Number, Symbol, choose, number_operand
from robot_dynamics.procedures import active_stage

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.frames import Frame
    from robot_dynamics.codegen.procedure.function_text import FunctionText
    from robot_dynamics.codegen.procedure.kernels import Kernel


class ProcedureStage:
    """A procedure while it is staged, with all procedures and kernels that it calls.

    Parameters
    ----------
    text : FunctionText
    frame : type
        The Frame of each call.

    Attributes
    ----------
    text : FunctionText
    kernels : dict of str to Kernel
        The kernels that are called, by the name of their function.
    """

    def __init__(self, text: FunctionText, frame: type[Frame]) -> None:
        self.text = text
        self._frame = frame
        self.kernels: dict[str, Kernel] = {}

    def stage(self, function: Callable[..., Any], arguments: Sequence[Any]) -> Any:
        """The result of a procedure for symbols."""
        token = active_stage.set(self)
        try:
            result = function(*arguments)
            self.text.index_checks.finish()
            return result
        finally:
            active_stage.reset(token)

    def call(self, function: Callable[..., Any], arguments: Sequence[Any], options: dict[str, Any]) -> Any:
        """The result of a procedure; its statements are appended to the text."""
        bound = inspect.signature(function).bind(*arguments, **options)
        bound.apply_defaults()
        return self._frame(self, function, dict(bound.arguments)).run()

    def call_kernel(self, kernel: Kernel, arguments: Sequence[Any]) -> Any:
        """The outputs of a kernel, as Memory."""
        self.kernels[kernel.name] = kernel
        interface = kernel.interface
        memories = [
            argument if isinstance(argument, Memory) else self._in_memory(argument, size)
            for argument, size in zip(arguments, interface.inputs.values(), strict=True)
        ]
        for memory, (name, size) in zip(memories, interface.inputs.items(), strict=True):
            if memory.size != size:
                raise TypeError(f"{kernel.name}: {name} has {size} entries, not {memory.size}")
        outputs = [self.zeros(shape, is_cleared=False) for _, shape in interface.outputs]
        table = self.text.allocate_pointers(len(memories) + len(outputs))
        for number, memory in enumerate([*memories, *outputs]):
            entry = self.text.assign(f"getelementptr ptr, ptr {table}, i64 {number}")
            self.text.append(f"store ptr {memory.address}, ptr {entry}, align 8")
        if self.text.lanes == 1:
            self.text.append(f"call void @{kernel.name}(ptr {table})")
        else:
            self.text.reject(self.text.assign(f"call i{self.text.lanes} @{kernel.name}(ptr {table})"))
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _in_memory(self, values: Any, size: int) -> Memory:
        memory = self.zeros((size,), is_cleared=False)
        memory.copy_from(values)
        return memory

    def zeros(self, shape: tuple[int, ...], is_cleared: bool = True) -> Memory:
        """An array in memory; its entries are undefined if it is not cleared."""
        text = self.text
        memory = Memory(text, text.allocate(int(np.prod(shape))), tuple(shape), text.mask)
        if is_cleared:
            size = 8 * text.lanes * memory.size
            text.append(f"call void @llvm.memset.p0.i64(ptr {memory.address}, i8 0, i64 {size}, i1 0)")
        return memory

    def copy(self, values: Any) -> Memory:
        """A copy of an array in memory."""
        memory = self.zeros(tuple(values.shape), is_cleared=False)
        if isinstance(values, Memory):
            copy_memory(values, memory)
        else:
            memory.copy_from(values)
        return memory

    def select(self, condition: Any, chosen: Any, otherwise: Any) -> Any:
        """Numbers or arrays of them."""
        conditions, first, second = np.broadcast_arrays(*map(as_objects, (condition, chosen, otherwise)))
        selected = np.empty(conditions.shape, dtype=object)
        for index in np.ndindex(conditions.shape):
            selected[index] = self._select(conditions[index], first[index], second[index])
        return selected[()]

    def _select(self, condition: Any, chosen: Any, otherwise: Any) -> Any:
        if not isinstance(condition, Condition):
            return chosen if condition else otherwise
        is_integer = isinstance(chosen, Counter | int) and isinstance(otherwise, Counter | int)
        return choose(condition, chosen, otherwise, Counter if is_integer else Number)

    def largest(self, values: Any) -> Any:
        """The largest entry, nan if one is nan."""
        entries = list(np.ravel(as_objects(values)))
        if not any(isinstance(entry, Symbol) for entry in entries):
            return max(entries, default=0.0)
        return reduce(self._larger, entries)

    def _larger(self, a: Any, b: Any) -> Number:
        text = self.text
        return Number(text, number_operand(a, text.lanes)).maximum(b)

    def magnitude(self, value: Any) -> Any:
        """Absolute values."""
        return np.abs(as_values(value))

    def rounded(self, value: Any) -> Any:
        """Nearest integers."""
        return np.rint(as_values(value))


def as_objects(value: Any) -> Any:
    """A value as an array of objects."""
    values = as_values(value)
    if isinstance(values, np.ndarray):
        return values.astype(object)
    entry = np.empty((), dtype=object)
    entry[()] = values
    return entry
