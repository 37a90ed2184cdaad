"""The text of LLVM IR of a staged procedure: the function `@sample`, as straight-line programs have it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.codegen.procedure.function_text import FunctionText
from robot_dynamics.codegen.procedure.memory import Memory
from robot_dynamics.codegen.procedure.slots import copy_memory
from robot_dynamics.codegen.procedure.staging import ProcedureStage

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.kernels import Kernel

MAX_COPIED_BY_ENTRIES = 64
"""Entries of an array up to which each is loaded and stored."""

LIBRARY = """
declare double @llvm.fabs.f64(double)
declare double @llvm.sqrt.f64(double)
declare double @llvm.rint.f64(double)
declare double @llvm.maximum.f64(double, double)
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
define internal double @library(i64 %index, double %x) alwaysinline {
  %at = getelementptr ptr, ptr @runtime, i64 %index
  %function = load ptr, ptr %at
  %y = call double %function(double %x)
  ret double %y
}
"""
"""Functions that procedures use; `@runtime` is the table of addresses of which sine and cosine are the first."""


class ProcedureInterface(NamedTuple):
    """Names and sizes of the inputs of a procedure, and names and shapes of its outputs."""

    inputs: Mapping[str, int]
    outputs: Mapping[str, tuple[int, ...]]


def procedure_text(function: Callable[..., Any], interface: ProcedureInterface) -> tuple[str, dict[str, Kernel]]:
    """IR of `@sample(ptr %pointers)` of a procedure, and the kernels that it calls, by name.

    Parameters
    ----------
    function : callable
        A procedure that takes the inputs and returns the outputs, an array or a tuple.
    interface : ProcedureInterface

    Returns
    -------
    text : str
    kernels : dict of str to Kernel

    Raises
    ------
    TypeError, ValueError
        The function breaks a rule for procedures, or its results have other shapes.
    """
    text = FunctionText()
    stage = ProcedureStage(text)
    pointers = [text.assign(f"load ptr, ptr {_pointer_at(text, k)}, align 8") for k in range(_array_count(interface))]
    inputs = [
        Memory(text, pointer, (size,)) for pointer, size in zip(pointers, interface.inputs.values(), strict=False)
    ]
    results = stage.stage(function, inputs)
    results = results if isinstance(results, tuple) else (results,)
    outputs = [
        Memory(text, pointer, shape)
        for pointer, shape in zip(pointers[len(inputs) :], interface.outputs.values(), strict=True)
    ]
    _store_results(results, outputs, {memory.address for memory in inputs})
    declarations = [f"declare void @{name}(ptr)" for name in stage.kernels]
    lines = [
        LIBRARY,
        *declarations,
        "define void @sample(ptr %pointers) noinline {",
        *text.allocations,
        *text.lines,
        "ret void",
        "}",
    ]
    return "\n".join(lines), stage.kernels


def _array_count(interface: ProcedureInterface) -> int:
    return len(interface.inputs) + len(interface.outputs)


def _pointer_at(text: FunctionText, number: int) -> str:
    return text.assign(f"getelementptr ptr, ptr %pointers, i64 {number}")


def _store_results(results: tuple[Any, ...], outputs: list[Memory], inputs: set[str]) -> None:
    """Store the results. Outputs may overlap inputs: everything that is read from inputs is read first."""
    read: list[Any] = []
    for result, output in zip(results, outputs, strict=True):
        shape = np.shape(result) if not isinstance(result, Memory) else result.shape
        if shape != output.shape:
            raise ValueError(f"a result has the shape {shape}, and its output {output.shape}")
        is_local = isinstance(result, Memory) and result.address not in inputs
        is_long = isinstance(result, Memory) and result.size > MAX_COPIED_BY_ENTRIES
        read.append(result.values() if isinstance(result, Memory) and not (is_local and is_long) else result)
    for result, output in zip(read, outputs, strict=True):
        if isinstance(result, Memory):
            copy_memory(result, output)
        else:
            output.copy_from(result)
