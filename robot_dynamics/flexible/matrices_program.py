"""The matrices of a robot as a customised straight-line program, traced from the recursion and compiled.

Most entries of M and K are zero or constant, whatever the pose, and symmetric: the program computes each of the others
once, and what it gives is laid into templates.
"""

from functools import cache, partial
from typing import NamedTuple

import numpy as np

from robot_dynamics.codegen.jit.background_compilation import BackgroundCompilation
from robot_dynamics.codegen.jit.compiled_program import compile_program, load_program
from robot_dynamics.codegen.trace.fingerprint import fingerprint
from robot_dynamics.codegen.trace.program import build_program
from robot_dynamics.codegen.trace.scalar import CONSTANT, Scalar, Trace
from robot_dynamics.errors import CompilationError, InvalidInputError
from robot_dynamics.flexible.matrices import constrained_matrices

MATRIX_NAMES = ("mass", "stiffness", "expansion")
COMPILE_THRESHOLD = 0.2
"""Time spent on matrices by the recursion [s] after which a program is compiled."""


class MatrixLayout(NamedTuple):
    """Where what a program gives belongs in a matrix: template, with the constants; places: of entries in the flattened
    matrix; values: which of the values each of them is; signs."""

    template: np.ndarray
    places: np.ndarray
    values: np.ndarray
    signs: np.ndarray

    def fill(self, values):
        """(..., n, m) from what the program gave, (..., k)."""
        batch = values.shape[:-1]
        flat = np.empty((*batch, self.template.size))
        flat[...] = self.template.ravel()
        flat[..., self.places] = values[..., self.values] * self.signs
        return flat.reshape(*batch, *self.template.shape)


class MatricesProgram:
    """The program of M and K of a Structure.

    `compiled_matrices` stays None where the loops are not closed element by element, or where nothing compiles.
    """

    def __init__(self, structure, robot):
        self._trace = cache(partial(trace_matrices, structure, robot))
        self._compilation = BackgroundCompilation(
            partial(_compile_matrices, structure, robot, self._trace),
            COMPILE_THRESHOLD,
            f"the matrices of {robot.name!r}",
            expected_errors=(CompilationError, InvalidInputError),
        )

    @property
    def program(self):
        """The Program of the entries that vary. Raises InvalidInputError where there is none."""
        return self._trace()[0]

    @property
    def compiled_matrices(self):
        """The CompiledMatrices, None until they are compiled."""
        return self._compilation.program

    def compile(self):
        """The CompiledMatrices, compiled or loaded now. Raises CompilationError and InvalidInputError."""
        return self._compilation.get()

    def record_duration(self, seconds):
        """Add time that the recursion took [s]; the program is compiled in the background once that is worthwhile."""
        self._compilation.record_time(seconds)


def _compile_matrices(structure, robot, trace):
    """The CompiledMatrices of a structure, from the cache or compiled."""
    program, layouts, independent = trace()
    key = fingerprint(robot, structure.coordinates, structure.components, MATRIX_NAMES)
    compiled = (key and load_program(key, lambda: program)) or compile_program(program, key=key)
    return CompiledMatrices(compiled, layouts, independent)


class CompiledMatrices(NamedTuple):
    """A compiled program, and the Layouts of what it gives."""

    compiled: object
    layouts: tuple
    independent: tuple

    def __call__(self, q):
        """(mass, stiffness, expansion, independent) at positions q (..., all joints)."""
        values = np.empty((*q.shape[:-1], *self.compiled.interface.outputs[0][1]))
        rows = values.reshape(-1, values.shape[-1])
        for sample, row in zip(np.ascontiguousarray(q).reshape(-1, q.shape[-1]), rows, strict=True):
            self.compiled.evaluate(sample, row)  # some microseconds: a loop of vectors takes longer to compile
        return (*(layout.fill(values) for layout in self.layouts), self.independent)


def trace_matrices(structure, robot):
    """(Program q -> entries (k,), Layouts of mass, stiffness and expansion, independent coordinates)."""
    trace = Trace()
    q = trace.input("q", len(robot.joints))
    system = constrained_matrices(structure, robot, q)
    if system is None:
        raise InvalidInputError(f"the loops of {robot.name!r} are not closed element by element: there is no program")
    numbers, entries, layouts = {}, [], []
    for name in MATRIX_NAMES:
        matrix = getattr(system, name)
        template, places, values, signs = np.zeros(matrix.shape), [], [], []
        for place, entry in enumerate(matrix.ravel()):
            if not isinstance(entry, Scalar):
                template.flat[place] = entry
            elif trace.nodes[entry.node][0] == CONSTANT:
                template.flat[place] = entry.sign * trace.constant_value(entry.node)
            else:
                if entry.node not in numbers:
                    numbers[entry.node] = len(entries)
                    entries.append(entry if entry.sign > 0 else -entry)
                places.append(place)
                values.append(numbers[entry.node])
                signs.append(entry.sign)
        layouts.append(MatrixLayout(template, *(np.array(told, dtype=int) for told in (places, values, signs))))
    listed = np.empty(len(entries), dtype=object)
    listed[:] = entries
    if not entries:
        raise InvalidInputError(f"the matrices of {robot.name!r} are the same at every pose: there is no program")
    program = build_program(trace, "matrices", {"q": len(robot.joints)}, {"entries": listed})
    return program, tuple(layouts), system.independent
