"""The text of LLVM IR of a staged procedure: the function `@sample`, as straight-line programs have it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.codegen.procedure.frames import Frame
from robot_dynamics.codegen.procedure.function_text import FunctionText
from robot_dynamics.codegen.procedure.memory import Memory
from robot_dynamics.codegen.procedure.slots import MAX_COPIED_BY_ENTRIES, copy_memory
from robot_dynamics.codegen.procedure.staging import ProcedureStage

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.kernels import Kernel

FUNCTIONS = """
declare {number} @llvm.sqrt.{suffix}({number})
declare {number} @llvm.rint.{suffix}({number})
declare {number} @llvm.maximum.{suffix}({number}, {number})
declare void @llvm.memcpy.p0.p0.i64(ptr, ptr, i64, i1)
declare void @llvm.memset.p0.i64(ptr, i8, i64, i1)
"""
"""Functions that procedures use."""

SAMPLE_FUNCTIONS = """
declare double @llvm.fabs.f64(double)
declare {<2 x double>, <2 x double>} @sincos_anywhere2(<2 x double>) memory(none) nounwind willreturn
define internal double @sine(double %x) alwaysinline {
  %angles = insertelement <2 x double> zeroinitializer, double %x, i64 0
  %both = call {<2 x double>, <2 x double>} @sincos_anywhere2(<2 x double> %angles)
  %sines = extractvalue {<2 x double>, <2 x double>} %both, 0
  %sine = extractelement <2 x double> %sines, i64 0
  ret double %sine
}
define internal double @cosine(double %x) alwaysinline {
  %angles = insertelement <2 x double> zeroinitializer, double %x, i64 0
  %both = call {<2 x double>, <2 x double>} @sincos_anywhere2(<2 x double> %angles)
  %cosines = extractvalue {<2 x double>, <2 x double>} %both, 1
  %cosine = extractelement <2 x double> %cosines, i64 0
  ret double %cosine
}
"""
"""Functions that procedures of one sample use."""

SINCOS_WIDTH = 2
"""Width of the vectors in which these compute an angle."""


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
    stage = ProcedureStage(text, Frame)
    pointers = [text.assign(f"load ptr, ptr {_pointer_at(text, k)}, align 8") for k in range(_array_count(interface))]
    inputs = [
        Memory(text, pointer, (size,)) for pointer, size in zip(pointers, interface.inputs.values(), strict=False)
    ]
    results = stage.stage(function, inputs)
    outputs = [
        Memory(text, pointer, shape)
        for pointer, shape in zip(pointers[len(inputs) :], interface.outputs.values(), strict=True)
    ]
    _store_results(check_results(results, interface), outputs, {memory.address for memory in inputs})
    lines = [
        declare_functions(text),
        SAMPLE_FUNCTIONS,
        *(f"declare void @{name}(ptr)" for name in stage.kernels),
        "define void @sample(ptr %pointers) noinline {",
        *text.allocations,
        *text.lines,
        "ret void",
        "}",
    ]
    return "\n".join(lines), stage.kernels


def declare_functions(text: FunctionText) -> str:
    """IR that declares the functions of LLVM that procedures use."""
    return FUNCTIONS.format(number=text.number_type, suffix=text.number_suffix)


def check_results(results: Any, interface: ProcedureInterface) -> tuple[Any, ...]:
    """The results of a procedure, one for each output. Raises ValueError where their shapes differ."""
    arrays = results if isinstance(results, tuple) else (results,)
    for result, shape in zip(arrays, interface.outputs.values(), strict=True):
        if np.shape(result) != shape:
            raise ValueError(f"a result has the shape {np.shape(result)}, and its output {shape}")
    return arrays


def _array_count(interface: ProcedureInterface) -> int:
    return len(interface.inputs) + len(interface.outputs)


def _pointer_at(text: FunctionText, number: int) -> str:
    return text.assign(f"getelementptr ptr, ptr %pointers, i64 {number}")


def _store_results(results: tuple[Any, ...], outputs: list[Memory], inputs: set[str]) -> None:
    """Store the results. Outputs may overlap inputs: everything that is read from inputs is read first."""
    read: list[Any] = []
    for result in results:
        is_local = isinstance(result, Memory) and result.address not in inputs
        is_long = isinstance(result, Memory) and result.size > MAX_COPIED_BY_ENTRIES
        read.append(result.values() if isinstance(result, Memory) and not (is_local and is_long) else result)
    for result, output in zip(read, outputs, strict=True):
        if isinstance(result, Memory):
            copy_memory(result, output)
        else:
            output.copy_from(result)
