"""Procedures: functions with loops and branches on numbers that run as Python and can be compiled.

A procedure is written once, with NumPy arrays of fixed sizes. Called with arrays it runs as any function.
`codegen.procedure` calls it with symbols instead, and stages it: `if`, `while` and `for ... in range(...)` become
branches and loops of machine code, all other statements are evaluated in the order in which the loops reach them. For
batches it is staged a second time, for several samples in the lanes of vectors.

Rules for a procedure:

- Sizes of arrays are known. What depends on no argument is computed once, when it is staged.
- A name keeps its shape where it is assigned in a loop or in one branch.
- `for ... in range(...)` is a loop of the machine code, `for` over anything else is unrolled.
- The only `return` is the last statement.
- Arrays whose entries are assigned come from `zeros` or `as_array`. A part of such an array with constant indices is a
  copy in machine code: do not assign to the array while the part is in use.
- Indices that depend on a loop count from the start of the array. Staging refuses them where it cannot prove from the
  limits of range(...) that they lie within the array: nothing checks them in a program.
- The right side of `and` and `or` is evaluated always if it calls no procedure, which has no effect on the result.
- Rows of arrays whose index depends on a branch, and a first number of range(...) that does, have no form in lanes:
  batches of such a procedure are computed one sample after the other.
- A name that only one branch or a loop assigns is not used after it, nor the number of a loop. Functions inside a
  procedure use the values that names have where they are defined.

A broken rule raises TypeError when the procedure is staged; the message names the function and the line. Two cases are
not found: an array that is assigned to while a part of it is in use, and names that get other values after the
definition of a function that uses them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextvars import ContextVar
from functools import reduce, wraps
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray

Function = TypeVar("Function", bound=Callable[..., Any])


class Stage(Protocol):
    """Stages procedures, as codegen.procedure.staging.ProcedureStage does."""

    def call(self, function: Callable[..., Any], arguments: Sequence[Any], options: dict[str, Any]) -> Any:
        """The result of a procedure, with symbols."""

    def zeros(self, shape: tuple[int, ...]) -> Any:
        """An array of zeros whose entries can be assigned."""

    def copy(self, values: Any) -> Any:
        """A copy of an array whose entries can be assigned."""

    def select(self, condition: Any, chosen: Any, otherwise: Any) -> Any:
        """`chosen` where the condition holds, else `otherwise`."""

    def largest(self, values: Any) -> Any:
        """The largest of some values, nan if one is nan."""

    def magnitude(self, value: Any) -> Any:
        """The absolute value of a number."""

    def rounded(self, value: Any) -> Any:
        """The integer nearest to a number, as a float."""


active_stage: ContextVar[Stage | None] = ContextVar("active_stage", default=None)
"""The Stage of the procedure that is being staged."""


def procedure(function: Function) -> Function:
    """Mark a function as a procedure."""

    @wraps(function)
    def call(*arguments: Any, **options: Any) -> Any:
        stage = active_stage.get()
        return function(*arguments, **options) if stage is None else stage.call(function, arguments, options)

    return call  # type: ignore[return-value]  # same signature


def zeros(*shape: int) -> Any:
    """An array of zeros whose entries the procedure assigns."""
    stage = active_stage.get()
    return np.zeros(shape) if stage is None else stage.zeros(shape)


def select(condition: Any, chosen: Any, otherwise: Any) -> Any:
    """`chosen` where the condition holds, else `otherwise`; entry by entry of arrays of one shape."""
    stage = active_stage.get()
    return np.where(condition, chosen, otherwise)[()] if stage is None else stage.select(condition, chosen, otherwise)


def largest(values: ScalarArray) -> Any:
    """The largest entry of an array, nan if one is nan, 0 if there is none."""
    stage = active_stage.get()
    if stage is not None:
        return stage.largest(values)
    return np.max(values) if np.size(values) else 0.0


def magnitude(values: Any) -> Any:
    """Absolute values, entry by entry."""
    stage = active_stage.get()
    return np.abs(values) if stage is None else stage.magnitude(values)


def rounded(values: Any) -> Any:
    """Nearest integers as floats, entry by entry; halves to the even one."""
    stage = active_stage.get()
    return np.rint(values) if stage is None else stage.rounded(values)


def arctangent(y: Any, x: Any) -> Any:
    """The angles of the points (x, y), entry by entry, as np.arctan2 but for the sign of zeros."""
    return np.arctan2(y, x) if active_stage.get() is None else _arctangent(y, x)


ARCTANGENT_NUMERATOR = (
    -8.750608600031904122785e-1,
    -1.615753718733365076637e1,
    -7.500855792314704667340e1,
    -1.228866684490136173410e2,
    -6.485021904942025371773e1,
)
ARCTANGENT_DENOMINATOR = (
    1.0,
    2.485846490142306297962e1,
    1.650270098316988542046e2,
    4.328810604912902668951e2,
    4.853903996359136964868e2,
    1.945506571482613964425e2,
)
"""Coefficients of arctan(r) = r + r³ P(r²) / Q(r²) for |r| <= 0.66. Source: S. Moshier, Cephes library, atan.c."""


def _arctangent(y: Any, x: Any) -> Any:
    """`arctangent` of a point of symbols: by a rational function, after a rotation by 45° and by reflections."""
    y, x = (np.asarray(value, dtype=object)[()] for value in (y, x))  # no arrays of shape ()
    width = magnitude(x)
    height = magnitude(y)
    is_steep = height > width
    longer = select(is_steep, height, width)
    ratio = select(is_steep, width, height) / select(longer == 0, 1.0, longer)
    is_diagonal = ratio > np.tan(np.pi / 8)
    ratio = select(is_diagonal, (ratio - 1) / (ratio + 1), ratio)
    square = ratio * ratio
    numerator, denominator = (
        reduce(lambda value, coefficient: value * square + coefficient, coefficients)
        for coefficients in (ARCTANGENT_NUMERATOR, ARCTANGENT_DENOMINATOR)
    )
    angle = ratio + ratio * square * (numerator / denominator)
    angle = angle + select(is_diagonal, np.pi / 4, 0.0)
    angle = select(is_steep, np.pi / 2 - angle, angle)
    angle = select(x < 0, np.pi - angle, angle)
    return select(y < 0, -angle, angle)


def as_array(values: Any) -> Any:
    """A copy of an array whose entries the procedure assigns, and reads with counters."""
    stage = active_stage.get()
    return np.array(values, dtype=float) if stage is None else stage.copy(values)


def solve(matrix: Any, right_side: Any) -> Any:
    """The solution (n, k) of matrix (n, n) x = right_side (n, k); staged, it is not finite where there is none."""
    if active_stage.get() is None:
        return np.linalg.solve(matrix, right_side)
    return _eliminate(as_array(matrix), as_array(right_side))


@procedure
def _eliminate(rows: Any, solution: Any) -> Any:
    """`solve` by elimination with row pivots; both arrays are overwritten."""
    size, columns = solution.shape
    for k in range(size):
        pivot = find_pivot(rows, k)
        if pivot != k:
            exchange_rows(rows, k, pivot)
            exchange_rows(solution, k, pivot)
        reciprocal = 1 / rows[k, k]
        for i in range(k + 1, size):
            factor = rows[i, k] * reciprocal
            for j in range(k + 1, size):
                rows[i, j] = rows[i, j] - factor * rows[k, j]
            for j in range(columns):
                solution[i, j] = solution[i, j] - factor * solution[k, j]
    for eliminated in range(size):
        k = size - 1 - eliminated
        for j in range(columns):
            remainder = solution[k, j]
            for i in range(k + 1, size):
                remainder = remainder - rows[k, i] * solution[i, j]
            solution[k, j] = remainder / rows[k, k]
    return solution


@procedure
def find_pivot(matrix: Any, k: Any) -> Any:
    """The row of a matrix, of those from k on, with the largest entry in column k."""
    pivot = k
    for i in range(k + 1, matrix.shape[0]):
        if magnitude(matrix[i, k]) > magnitude(matrix[pivot, k]):
            pivot = i
    return pivot


@procedure
def exchange_rows(matrix: Any, first: Any, second: Any) -> None:
    """Exchange two rows of a matrix."""
    for j in range(matrix.shape[1]):
        entry = matrix[first, j]
        matrix[first, j] = matrix[second, j]
        matrix[second, j] = entry


def is_finite(values: Any) -> Any:
    """Whether all entries of an array are finite."""
    return largest(magnitude(values)) < np.inf


def finite_or_zero(values: ScalarArray) -> Any:
    """The entries of an array, 0 in place of those that are not finite."""
    stage = active_stage.get()
    if stage is None:
        return np.where(np.isfinite(values), values, 0.0)
    return np.array([stage.select(is_finite(value), value, 0.0) for value in values])
