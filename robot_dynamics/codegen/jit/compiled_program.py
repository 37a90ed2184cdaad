"""A straight-line program compiled to machine code, for one sample in buffers or a batch of samples."""

from __future__ import annotations

import ctypes
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from threading import Lock
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from robot_dynamics.codegen.jit.constant_folding import fold_constants
from robot_dynamics.codegen.jit.machine_code import MachineCode
from robot_dynamics.codegen.jit.runtime import FunctionOwner, make_python_callable
from robot_dynamics.codegen.jit.threads import run_in_threads
from robot_dynamics.codegen.trace.scalar import PARAMETER
from robot_dynamics.errors import CompilationError, InvalidInputError, describe_unknown_name

if TYPE_CHECKING:  # engine needs llvmlite, which may be missing
    from robot_dynamics.array_types import Array
    from robot_dynamics.codegen.jit.engine import Library
    from robot_dynamics.codegen.jit.machine_code import TracedProgram
    from robot_dynamics.codegen.trace.program import Interface, Program, ProgramResult

MIN_WORK_PER_THREAD = 2e7
"""Statements times samples, about 0.4 ms; for less, a thread may take longer to start than it saves."""

CHUNKS_PER_THREAD = 16
"""Pieces of the work for each thread, so that no thread waits long for the last one."""

STATUS = "status"
"""Name of the last output of programs that check their results; it is zero where the first output is valid."""

ATTEMPT_DOCSTRING = "The first output, or None where an argument is no float64 array (size,) or the status is not zero."

BATCH_LOOP_TYPE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64, ctypes.c_int64)


def compile_program(
    program: Program, parameters: Mapping[str, float] | None = None, key: str | None = None
) -> CompiledProgram:
    """Compile a program.

    Parameters
    ----------
    program : Program
    parameters : mapping of str to float, optional
        Values of the parameters of the program, which become constants of the code.
    key : str, optional
        Stands for the program and the values; `load_program` finds the compiled program by it.

    Returns
    -------
    CompiledProgram

    Raises
    ------
    CompilationError
        If llvmlite is missing or fails.
    InvalidInputError
        If a parameter is missing, unknown or not finite.
    """
    if not program.outputs:
        raise ValueError(f"{program.name} has no output to compute")
    traced = program, fold_finite_constants(program, parameters or {})
    code = MachineCode(program.interface, lambda: traced, key)
    compiled = CompiledProgram(code)
    code.save_to_cache()
    return compiled


def load_program(key: str, trace: Callable[[], Program]) -> CompiledProgram | None:
    """Load a program that was compiled with a key.

    Parameters
    ----------
    key : str
    trace : callable
        Returns the Program, which must have no parameters; called only if its statements are needed.

    Returns
    -------
    CompiledProgram or None
        None if the cache has no program for the key.

    Raises
    ------
    CompilationError
        If llvmlite is missing or fails.
    """

    def trace_with_constants() -> TracedProgram:
        program = trace()
        return program, fold_finite_constants(program, {})

    code = MachineCode.from_cache(key, trace_with_constants)
    return None if code is None else CompiledProgram(code)


def fold_finite_constants(program: Program, parameters: Mapping[str, float]) -> dict[int, float]:
    """The value of each node of a Program that is known before a call.

    Parameters
    ----------
    program : Program
    parameters : mapping of str to float
        Values of the parameters.

    Returns
    -------
    dict of int to float

    Raises
    ------
    InvalidInputError
        If a parameter is missing or unknown, or a parameter or setup statement is not finite.
    """
    for name in parameters:
        if name not in program.parameters:
            raise InvalidInputError(describe_unknown_name(f"parameter of {program.name}", name, program.parameters))
    constants = fold_constants(program, parameters)
    for number, operation, operands in program.leaves:
        if operation == PARAMETER and not math.isfinite(constants[number]):
            raise InvalidInputError(
                f"parameter {operands[0]!r} of {program.name} is {constants[number]}, and must be finite"
            )
    for number, operation, _ in program.setup:
        if not math.isfinite(constants[number]):
            raise InvalidInputError(
                f"the parameters of {program.name} give no finite constants: {operation} gives {constants[number]}"
            )
    return constants


class CompiledProgram:
    """A Program as machine code.

    Attributes
    ----------
    interface : Interface
        Name, inputs, outputs and operations of the program.
    evaluate : callable
        ``evaluate(*inputs)`` returns new arrays, a tuple if there are several outputs; ``evaluate(*inputs, *outputs)``
        writes to the outputs and returns None. Each argument is a C-contiguous buffer of float64 of any shape with as
        many numbers as the program needs: a NumPy array, an array.array("d"), a memoryview. Outputs may overlap inputs,
        but not each other. Raises TypeError for arguments of other types, ValueError for a wrong count or layout, or a
        read-only output.
    attempt : callable or None
        ``attempt(*inputs)`` returns the first output, or None where an argument is not a C-contiguous NumPy array
        (size,) of float64 or where the status is not zero. None for programs without the output `status`.

    Notes
    -----
    nan or inf in an input give nan or inf in the outputs that depend on it, in that sample alone.
    """

    def __init__(self, code: MachineCode) -> None:
        self.interface: Interface = code.interface
        self._code = code
        self._inputs = list(self.interface.inputs.items())
        self._outputs = self.interface.outputs
        self._lock = Lock()
        self._loop: Any = None
        self._lanes_library: Library | None = None
        self._library = _load_library(code.sample_library)
        self.evaluate: Callable[..., ProgramResult] = make_python_callable(
            self._library["evaluate"], self.interface.name, _docstring(self.interface), FunctionOwner(self._library)
        )
        self.attempt: Callable[..., Array | None] | None = None
        if self._outputs[-1][0] == STATUS:
            self.attempt = make_python_callable(
                self._library["attempt"], self.interface.name, ATTEMPT_DOCSTRING, FunctionOwner(self._library)
            )

    def __repr__(self) -> str:
        return f"CompiledProgram({', '.join(self.interface.inputs)}: {self.interface.operations})"

    @property
    def program(self) -> Program:
        """The Program; traced on first access if the machine code was loaded from the cache."""
        return self._code.program

    @property
    def work(self) -> float:
        """Operations of one sample, about."""
        return self._code.work

    @property
    def address(self) -> int:
        """Address of the function of one sample, which takes a table of the addresses of inputs and outputs."""
        return self._library["sample"]

    def compile_lanes(self) -> int:
        """Address of the function of several samples in vectors, as `kernel.LaneWriter` has it; compiled if needed.

        Raises CompilationError.
        """
        with self._lock:
            if self._lanes_library is None:
                self._lanes_library = _load_library(partial(self._code.lanes_library, self._library))
        return self._lanes_library["lanes"]

    def compile_batch(self) -> Any:
        """Compile the function that `batch` runs, unless it is compiled; the first `batch` does it otherwise.

        Raises CompilationError.
        """
        with self._lock:
            if self._loop is None:
                library = _load_library(partial(self._code.batch_library, self._library))
                self._loop = BATCH_LOOP_TYPE(library["batch"])
                self._loop.libraries = library, self._library  # the loop calls functions of both
        return self._loop

    def batch(self, *arrays: ArrayLike, out: Array | Sequence[Array] | None = None, threads: int = 1) -> ProgramResult:
        """Compute N samples.

        Parameters
        ----------
        arrays : (N, size) or (size,)
            One for each input; (size,) is the same for all samples. At least one has N rows. Arrays that are not
            C-contiguous float64 are copied.
        out : array or sequence of arrays (N, ...), optional
            C-contiguous float64 arrays to write to, one for each output; they may overlap inputs.
        threads : int
            Number of threads that share the work, if there is enough for them. Other Python threads continue to run.

        Returns
        -------
        ndarray, shape (N, ...)
            A tuple if there are several outputs.

        Raises
        ------
        TypeError, ValueError
            If an argument does not fit.
        """
        inputs, samples = self._check_inputs(arrays)
        outputs = self._check_outputs(out, samples)
        results = outputs
        if out is not None:
            results = [
                np.empty_like(output) if any(np.may_share_memory(output, array) for array in inputs) else output
                for output in outputs
            ]
        self._run(inputs, results, samples, threads)
        for output, result in zip(outputs, results, strict=True):
            if result is not output:
                output[...] = result
        return outputs[0] if len(outputs) == 1 else tuple(outputs)

    def _check_inputs(self, arrays: Sequence[ArrayLike]) -> tuple[list[Array], int]:
        """The inputs of `batch` as arrays of float64, and the number of samples."""
        if len(arrays) != len(self._inputs):
            names = ", ".join(name for name, _ in self._inputs)
            raise TypeError(f"{self.interface.name} takes {len(self._inputs)} arrays ({names}), not {len(arrays)}")
        inputs = []
        rows = {}
        for number, ((name, size), values) in enumerate(zip(self._inputs, arrays, strict=True), start=1):
            array = np.asarray(values)
            argument = f"{self.interface.name}: argument {number} ({name})"
            if array.dtype.kind not in "fiu":
                raise TypeError(f"{argument} must hold float64, not {array.dtype}")
            if array.shape != (size,) and (array.ndim != 2 or array.shape[1] != size):
                raise ValueError(f"{argument} must have the shape (N, {size}) or ({size},), not {array.shape}")
            if array.ndim == 2:
                rows[name] = len(array)
            inputs.append(np.ascontiguousarray(array, dtype=np.float64))
        if len(set(rows.values())) != 1:
            counts = ", ".join(f"{name} has {count}" for name, count in rows.items()) or "no array has rows"
            raise ValueError(f"{self.interface.name}: the arrays must have the same number of samples, but {counts}")
        return inputs, next(iter(rows.values()))

    def _check_outputs(self, out: Array | Sequence[Array] | None, samples: int) -> list[Array]:
        """The arrays to write to: `out` if it fits, new ones if it is None."""
        shapes = [(name, (samples, *shape)) for name, shape in self._outputs]
        if out is None:
            return [np.empty(shape) for _, shape in shapes]
        outputs = [out] if isinstance(out, np.ndarray) else list(out)
        if len(outputs) != len(shapes):
            raise ValueError(f"{self.interface.name} writes to {len(shapes)} arrays, not {len(outputs)}")
        for (name, shape), array in zip(shapes, outputs, strict=True):
            argument = f"{self.interface.name}: the array for {name}"
            if not isinstance(array, np.ndarray) or array.dtype != np.float64:
                raise TypeError(f"{argument} must be a NumPy array of float64")
            if array.shape != shape or not (array.flags.c_contiguous and array.flags.writeable):
                raise ValueError(
                    f"{argument} must be C-contiguous, writable and of the shape {shape}, not {array.shape}"
                )
        if any(np.may_share_memory(a, b) for index, a in enumerate(outputs) for b in outputs[:index]):
            raise ValueError(f"{self.interface.name}: the arrays to write to must not overlap")
        return outputs

    def _run(self, inputs: Sequence[Array], results: Sequence[Array], samples: int, threads: int) -> None:
        arrays = [*inputs, *results]
        pointers = (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        row_bytes = [array.strides[0] if array.ndim == 2 else 0 for array in inputs]
        row_bytes += [8 * math.prod(shape) for _, shape in self._outputs]
        strides = (ctypes.c_ssize_t * len(row_bytes))(*row_bytes)
        loop = self.compile_batch()

        useful_threads = int(samples * max(1, self._code.work) / MIN_WORK_PER_THREAD)
        threads = max(1, min(threads, useful_threads))
        chunks = threads * CHUNKS_PER_THREAD if threads > 1 else 1
        chunk = -(-samples // (8 * chunks)) * 8  # whole blocks, of 4 or 8 samples
        next_sample = ctypes.c_int64(0)

        def work(_arrays: Sequence[Array] = arrays) -> None:  # keeps the arrays alive while a thread uses them
            loop(pointers, strides, ctypes.byref(next_sample), chunk, samples)

        run_in_threads(work, threads)


def _docstring(interface: Interface) -> str:
    arguments = ", ".join([*interface.inputs, *(name for name, _ in interface.outputs)])
    return f"{interface.name}({arguments})\n\nWithout the outputs it returns new arrays; see CompiledProgram."


def _load_library(load: Callable[[], Library]) -> Library:
    """The result of `load`. Raises CompilationError for the errors that may stop it."""
    if sys.implementation.name != "cpython" or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise CompilationError("compiled programs need CPython on a 64-bit machine")
    try:
        return load()
    except ImportError as error:
        raise CompilationError(f"compiled programs need llvmlite, 0.46 or later: {error}") from error
    except (AttributeError, OSError, RuntimeError) as error:
        raise CompilationError(f"the program could not be compiled: {error}") from error
