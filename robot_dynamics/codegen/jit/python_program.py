"""A straight-line program run as Python, for machines on which nothing compiles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from robot_dynamics.codegen.jit.python_functions import python_batch, python_function

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.trace.program import Program, ProgramResult


class PythonProgram:
    """A Program run as Python, with the methods of a CompiledProgram.

    Attributes
    ----------
    program : Program
    interface : Interface
        Name, inputs, outputs and operations of the program.
    """

    def __init__(self, program: Program) -> None:
        self.program = program
        self.interface = program.interface
        self._evaluate_sample = python_function(program)
        self._evaluate_batch = python_batch(program)

    def __repr__(self) -> str:
        return f"PythonProgram({', '.join(self.interface.inputs)}: {self.interface.operations})"

    def evaluate(self, *arguments: ArrayLike) -> ProgramResult:
        """The outputs of one sample, as CompiledProgram.evaluate: None where arrays to write to are passed too."""
        count = len(self.program.inputs)
        inputs, outputs = arguments[:count], arguments[count:]
        results = self._evaluate_sample(*inputs)
        rows = [results] if len(self.program.outputs) == 1 else results
        shapes = [output.shape for output in self.program.outputs]
        arrays = [np.reshape(row, shape) for row, shape in zip(rows, shapes, strict=True)]
        if not outputs:
            return arrays[0] if len(arrays) == 1 else tuple(arrays)
        for buffer, array in zip(outputs, arrays, strict=True):
            np.frombuffer(buffer)[:] = array.ravel()  # type: ignore[call-overload]  # any buffer, as compiled code takes
        return None

    def batch(
        self, *arrays: ArrayLike, out: Array | tuple[Array, ...] | None = None, threads: int = 1
    ) -> ProgramResult:
        """The outputs of N samples, as CompiledProgram.batch; `threads` has no effect."""
        samples = next((np.shape(array)[0] for array in arrays if np.ndim(array) == 2), None)
        results = self._evaluate_batch(*(_repeat_shared(array, samples) for array in arrays))
        if out is None:
            return results
        is_single = len(self.program.outputs) == 1
        targets = [out] if is_single else out
        for target, result in zip(targets, [results] if is_single else results, strict=True):
            target[...] = result
        return out


def _repeat_shared(array: ArrayLike, samples: int | None) -> ArrayLike:
    """An array (size,) repeated as rows (samples, size); others unchanged."""
    if np.ndim(array) != 1 or samples is None:
        return array
    return np.broadcast_to(array, (samples, np.shape(array)[0]))
