"""The matrices of a robot as a customised straight-line program, traced from the recursion and compiled.

Most entries of M and K are zero or constant at every pose, and the matrices are symmetric: the program computes each of
the other entries once, and its results are copied into templates.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.codegen.jit.background_compilation import BackgroundCompilation
from robot_dynamics.codegen.jit.compiled_program import compile_program, load_program
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import Scalar, Trace
from robot_dynamics.errors import CompilationError, InvalidInputError
from robot_dynamics.flexible.matrices import constrained_matrices

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray, ScalarArray
    from robot_dynamics.codegen.jit.compiled_program import CompiledProgram
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.flexible.structure import Structure
    from robot_dynamics.model.robot import Robot

MATRIX_NAMES = ("mass", "stiffness", "expansion")
COMPILE_THRESHOLD = 0.2
"""Time spent on matrices by the recursion [s] after which a program is compiled."""


class MatrixLayout(NamedTuple):
    """Positions of the program's results in a matrix.

    template: the matrix (n, m) with its constant entries; indices: (p,) of the other entries in the flattened matrix;
    results: (p,) numbers of the program's results in these entries; signs: (p,) of the results there.
    """

    template: Array
    indices: IntArray
    results: IntArray
    signs: IntArray

    def fill(self, values: Array) -> Array:
        """Return matrices (..., n, m) of results (..., k) of the program."""
        batch = values.shape[:-1]
        flat = np.empty((*batch, self.template.size))
        flat[...] = self.template.ravel()
        flat[..., self.indices] = values[..., self.results] * self.signs
        return flat.reshape(*batch, *self.template.shape)


class TracedMatrices(NamedTuple):
    """A program from q to the varying entries, the layouts of MATRIX_NAMES, and the independent coordinates."""

    program: Program
    layouts: tuple[MatrixLayout, ...]
    independent: tuple[int, ...]


class CompiledMatrices(NamedTuple):
    """As TracedMatrices, with a compiled program."""

    compiled: CompiledProgram
    layouts: tuple[MatrixLayout, ...]
    independent: tuple[int, ...]

    def __call__(self, q: Array) -> tuple[Array, Array, Array, tuple[int, ...]]:
        """Return mass, stiffness, expansion and independent coordinates at positions q (..., all joints)."""
        values = np.empty((*q.shape[:-1], *self.compiled.interface.outputs[0][1]))
        rows = values.reshape(-1, values.shape[-1])
        for sample, row in zip(np.ascontiguousarray(q).reshape(-1, q.shape[-1]), rows, strict=True):
            self.compiled.evaluate(sample, row)  # some microseconds: a vectorised loop takes longer to compile
        mass, stiffness, expansion = (layout.fill(values) for layout in self.layouts)
        return mass, stiffness, expansion, self.independent


class MatricesProgram:
    """The program of M and K of a Structure, compiled on request or in the background.

    `compiled_matrices` stays None where the loops are not closed element by element, or where no compiler is available.
    """

    def __init__(self, structure: Structure, robot: Robot) -> None:
        self._trace = cache(partial(trace_matrices, structure, robot))
        self._compilation = BackgroundCompilation(
            partial(_compile_matrices, structure, robot, self._trace),
            COMPILE_THRESHOLD,
            f"the matrices of {robot.name!r}",
            expected_errors=(CompilationError, InvalidInputError),
        )

    @property
    def program(self) -> Program:
        """The Program of the varying entries. Raises InvalidInputError where there is none."""
        return self._trace().program

    @property
    def compiled_matrices(self) -> CompiledMatrices | None:
        """The CompiledMatrices, None until they are compiled."""
        return self._compilation.program

    def compile(self) -> CompiledMatrices:
        """Compile now, or load the program from the cache. Raises CompilationError and InvalidInputError."""
        return self._compilation.get()

    def record_duration(self, seconds: float) -> None:
        """Count the time of a recursion; above COMPILE_THRESHOLD in total, compile in the background."""
        self._compilation.record_time(seconds)


def _compile_matrices(structure: Structure, robot: Robot, trace: Callable[[], TracedMatrices]) -> CompiledMatrices:
    """Return the CompiledMatrices of a structure, from the cache or compiled."""
    program, layouts, independent = trace()
    key = fingerprint(robot, structure.coordinates, structure.components, MATRIX_NAMES)
    compiled = (key and load_program(key, lambda: program)) or compile_program(program, key=key)
    return CompiledMatrices(compiled, layouts, independent)


def trace_matrices(structure: Structure, robot: Robot) -> TracedMatrices:
    """Return the TracedMatrices of a robot. Raises InvalidInputError where there is no program."""
    trace = Trace()
    q = trace.input("q", len(robot.joints))
    matrices = constrained_matrices(structure, robot, q)
    if matrices is None:
        raise InvalidInputError(f"the loops of {robot.name!r} are not closed element by element: there is no program")
    numbers: dict[int, int] = {}  # of the results, by node of the trace
    entries: list[Scalar] = []
    layouts = tuple(_layout(trace, getattr(matrices, name), numbers, entries) for name in MATRIX_NAMES)
    if not entries:
        raise InvalidInputError(f"the matrices of {robot.name!r} are the same at every pose: there is no program")
    outputs = np.empty(len(entries), dtype=object)
    outputs[:] = entries
    program = build_program(trace, "matrices", {"q": len(robot.joints)}, {"entries": outputs})
    return TracedMatrices(program, layouts, matrices.independent)


def _layout(trace: Trace, matrix: ScalarArray, numbers: dict[int, int], entries: list[Scalar]) -> MatrixLayout:
    """Return the layout of a matrix; add its varying entries to `entries` and their positions there to `numbers`."""
    template = np.zeros(matrix.shape)
    indices: list[int] = []
    results: list[int] = []
    signs: list[int] = []
    for index, entry in enumerate(matrix.ravel()):
        if not isinstance(entry, Scalar):
            template.flat[index] = entry
            continue
        constant = trace.constant_value(entry.node)
        if constant is not None:
            template.flat[index] = entry.sign * constant
        else:
            if entry.node not in numbers:
                numbers[entry.node] = len(entries)
                entries.append(entry if entry.sign > 0 else -entry)
            indices.append(index)
            results.append(numbers[entry.node])
            signs.append(entry.sign)
    return MatrixLayout(
        template, np.array(indices, dtype=int), np.array(results, dtype=int), np.array(signs, dtype=int)
    )
