"""A straight-line program compiled to machine code: one sample at a time from buffers, or a batch of them."""

import ctypes
import math
import sys
from functools import partial
from threading import Lock
from types import SimpleNamespace

import numpy as np

from robot_dynamics.codegen.jit.constant_folding import fold_constants
from robot_dynamics.codegen.jit.machine_code import MachineCode
from robot_dynamics.codegen.jit.runtime import make_python_callable
from robot_dynamics.codegen.jit.threads import run_in_threads
from robot_dynamics.codegen.trace.scalar import PARAMETER
from robot_dynamics.errors import CompilationError, InvalidInputError, describe_unknown_name

MIN_WORK_PER_THREAD = 2e7
"""Statements times samples, about 0.4 ms, below which a thread may take longer to start than it saves."""
CHUNKS_PER_THREAD = 16
"""In which the work is cut, so that no thread has long to wait for the last one."""
BATCH_LOOP_TYPE = ctypes.CFUNCTYPE(None, *[ctypes.c_void_p] * 3, ctypes.c_int64, ctypes.c_int64)


def compile_program(program, parameters=None, key=None):
    """The CompiledProgram of a Program, for {name: value} of its parameters, which become constants of the code.

    key: a text that stands for the program and the values, under which `load_program` finds it again.

    Raises CompilationError where llvmlite is missing or fails, and QuestionError for parameters that do not fit.
    """
    if not program.outputs:
        raise ValueError(f"{program.name} has no output to compute")
    traced = program, fold_finite_constants(program, parameters or {})
    code = MachineCode(program.interface, lambda: traced, key)
    made = CompiledProgram(code)
    code.save_to_cache()
    return made


def load_program(key, trace):
    """The CompiledProgram that was kept for a key, None if there is none.

    trace: a function that gives the Program, without parameters, for when someone asks for its statements. Raises
    CompilationError where llvmlite fails.
    """
    code = MachineCode.from_cache(key, lambda: (program := trace(), fold_finite_constants(program, {})))
    return None if code is None else CompiledProgram(code)


def fold_finite_constants(program, parameters):
    """{node: float} of all that a Program knows before a call, for {name: value} of its parameters, all finite."""
    for name in parameters:
        if name not in program.parameters:
            raise InvalidInputError(describe_unknown_name(f"parameter of {program.name}", name, program.parameters))
    known = fold_constants(program, parameters)
    for number, operation, operands in program.leaves:
        if operation == PARAMETER and not math.isfinite(known[number]):
            raise InvalidInputError(
                f"parameter {operands[0]!r} of {program.name} is {known[number]}, and must be finite"
            )
    for number, operation, _ in program.setup:
        if not math.isfinite(known[number]):
            raise InvalidInputError(
                f"the parameters of {program.name} have no answer: {operation} gives {known[number]}"
            )
    return known


class CompiledProgram:
    """A Program as machine code.

    interface: its name, inputs, outputs and operations.

    evaluate(*inputs) gives new arrays, one, or a tuple if there are several; evaluate(*inputs, *outputs) writes into
    the outputs and gives None. Each argument is a C-contiguous buffer of float64 with as many numbers as the program
    says, of any shape: a NumPy array, an array.array("d"), a memoryview. Outputs may overlap inputs, but not each
    other. Raises TypeError for what is no such buffer, ValueError for a wrong count, layout or read-only output.

    nan or inf in an input make nan or inf of what depends on it, in that sample alone.
    """

    def __init__(self, code):
        self._code, self.interface = code, code.interface
        self._inputs, self._outputs = list(self.interface.inputs.items()), self.interface.outputs
        self._lock, self._loop = Lock(), None
        self._library = _translated(code.sample_library)
        owner = SimpleNamespace(library=self._library)
        self.evaluate = make_python_callable(
            self._library["evaluate"], self.interface.name, _document(self.interface), owner
        )

    @property
    def program(self):
        """The Program; traced now where the machine code was loaded without it."""
        return self._code.program

    def compile_batch(self):
        """Compile what `batch` runs, if it is not yet; the first `batch` does it otherwise. Raises CompilationError."""
        with self._lock:
            if self._loop is None:
                library = _translated(partial(self._code.batch_library, self._library))
                self._loop = BATCH_LOOP_TYPE(library["batch"])
                self._loop.libraries = library, self._library  # it calls `sample` of the other
        return self._loop

    def batch(self, *arrays, out=None, threads=1):
        """The outputs (N, *shape) of N samples, one array or a tuple of several.

        arrays: of each input (N, size), or (size,) for all samples the same; at least one has N rows. What is not a
        C-contiguous array of float64 is copied into one. out: arrays of the outputs' shapes to write into, one or a
        tuple; they may overlap inputs. threads: how many share the work, if it is enough for them; other Python
        threads go on meanwhile.

        Raises TypeError and ValueError for arguments that do not fit.
        """
        given, samples = self._samples(arrays)
        told = self._results(out, samples)
        results = [
            np.empty_like(array)
            if out is not None and any(np.may_share_memory(array, other) for other in given)
            else array
            for array in told
        ]
        self._run(given, results, samples, threads)
        for array, result in zip(told, results, strict=True):
            if result is not array:
                array[...] = result
        return told[0] if len(told) == 1 else tuple(told)

    def _samples(self, arrays):
        """(arrays of float64, number of samples) of the arguments of `batch`."""
        if len(arrays) != len(self._inputs):
            names = ", ".join(name for name, _ in self._inputs)
            raise TypeError(f"{self.interface.name} takes {len(self._inputs)} arrays ({names}), not {len(arrays)}")
        given, rows = [], {}
        for place, ((name, size), array) in enumerate(zip(self._inputs, arrays, strict=True), start=1):
            array = np.asarray(array)
            where = f"{self.interface.name}: argument {place} ({name})"
            if array.dtype.kind not in "fiu":
                raise TypeError(f"{where} must hold float64, not {array.dtype}")
            if array.shape != (size,) and (array.ndim != 2 or array.shape[1] != size):
                raise ValueError(f"{where} must have the shape (N, {size}) or ({size},), not {array.shape}")
            if array.ndim == 2:
                rows[name] = len(array)
            given.append(np.ascontiguousarray(array, dtype=np.float64))
        if len(set(rows.values())) != 1:
            told = ", ".join(f"{name} has {count}" for name, count in rows.items()) or "no array has rows"
            raise ValueError(f"{self.interface.name}: the arrays must have the same number of samples, but {told}")
        return given, next(iter(rows.values()))

    def _results(self, out, samples):
        """The arrays to write into."""
        shapes = [(name, (samples, *shape)) for name, shape in self._outputs]
        if out is None:
            return [np.empty(shape) for _, shape in shapes]
        told = [out] if isinstance(out, np.ndarray) else list(out)
        if len(told) != len(shapes):
            raise ValueError(f"{self.interface.name} writes into {len(shapes)} arrays, not {len(told)}")
        for (name, shape), array in zip(shapes, told, strict=True):
            where = f"{self.interface.name}: the array for {name}"
            if not isinstance(array, np.ndarray) or array.dtype != np.float64:
                raise TypeError(f"{where} must be a NumPy array of float64")
            if array.shape != shape or not (array.flags.c_contiguous and array.flags.writeable):
                raise ValueError(f"{where} must be C-contiguous, writable and of the shape {shape}, not {array.shape}")
        if any(np.may_share_memory(a, b) for place, a in enumerate(told) for b in told[:place]):
            raise ValueError(f"{self.interface.name}: the arrays to write into must not overlap")
        return told

    def _run(self, given, results, samples, threads):
        arrays = [*given, *results]
        pointers = (ctypes.c_void_p * len(arrays))(*(array.ctypes.data for array in arrays))
        rows = [array.strides[0] if array.ndim == 2 else 0 for array in given]
        rows += [8 * math.prod(shape) for _, shape in self._outputs]
        strides = (ctypes.c_ssize_t * len(rows))(*rows)
        loop = self.compile_batch()

        enough = int(samples * max(1, sum(self.interface.operations)) / MIN_WORK_PER_THREAD)
        threads = max(1, min(threads, enough))
        shares = threads * CHUNKS_PER_THREAD if threads > 1 else 1
        share = -(-samples // (8 * shares)) * 8  # whole blocks, of 4 or 8 samples
        following = ctypes.c_int64(0)

        def work(_arrays=arrays):  # which live as long as a thread works on them
            loop(pointers, strides, ctypes.byref(following), share, samples)

        run_in_threads(work, threads)


def _document(interface):
    arguments = ", ".join([*interface.inputs, *(name for name, _ in interface.outputs)])
    return f"{interface.name}({arguments})\n\nWithout the outputs it gives new arrays; see CompiledProgram."


def _translated(load):
    """What `load` gives, or CompilationError for whatever stops it."""
    if sys.implementation.name != "cpython" or ctypes.sizeof(ctypes.c_void_p) != 8:
        raise CompilationError("compiled programs need CPython on a 64-bit machine")
    try:
        return load()
    except ImportError as error:
        raise CompilationError(f"compiled programs need llvmlite, 0.46 or later: {error}") from error
    except (AttributeError, OSError, RuntimeError) as error:
        raise CompilationError(f"the program could not be compiled: {error}") from error
