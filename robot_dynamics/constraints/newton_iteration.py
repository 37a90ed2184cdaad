"""Newton's method for positions that close the loops of a robot, for many samples at once.

The function that evaluates residuals and steps is an argument: `closure_step.newton_step`, or a compiled program.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.procedures import finite_or_zero, largest, magnitude, procedure, select

if TYPE_CHECKING:
    from robot_dynamics.array_types import IntArray

CLOSURE_TOLERANCE = 1e-11
"""Residual [characteristic lengths, rad] at which a loop is closed."""
MAX_STRIDE = 0.15
"""Longest stride of a path along closed positions [rad or characteristic lengths]."""
SHORT_STRIDE = MAX_STRIDE / 5
"""Longest stride [rad or characteristic lengths] where MAX_STRIDE leads to a wrong branch."""

MIN_QUALITY = 10 * CLOSURE_TOLERANCE
"""Least quality of positions whose rates are meaningful. A deviation δ from a singular position leaves a residual of δ²
only, and the quality is about δ²: positions within CLOSURE_TOLERANCE of a singular one stay below this."""
NEWTON_TOLERANCE = 1e-13
"""Residual [characteristic lengths, rad] below which rounding prevents a further decrease."""
MAX_ITERATIONS = 40
MAX_HALVINGS = 6
SUFFICIENT_DECREASE = 0.999
"""Ratio of the residuals after and before a step above which the iteration ends."""
MAX_STEP = 0.5
"""Longest step [rad or characteristic lengths]: the linearization does not hold further away."""

StepEvaluator: TypeAlias = Callable[[Array], Sequence[Array]]
"""Evaluates positions t (..., m): residual (..., rows), Newton's step (..., dependent), and further arrays."""
Advance: TypeAlias = Callable[[Array, Array], Array]
"""Positions (..., m) from positions (..., m) and a step (..., dependent)."""


def iterate_newton(
    evaluate: StepEvaluator,
    t: Array,
    dependent: IntArray | Sequence[int],
    max_step: Array,
    iterations: int = MAX_ITERATIONS,
    tolerance: float = NEWTON_TOLERANCE,
    advance: Advance | None = None,
) -> tuple[Array, list[Array]]:
    """Move the dependent joints until the loops are closed, or until no step decreases the residual.

    Parameters
    ----------
    evaluate : StepEvaluator
        A single sample is evaluated as t (m,), which takes a fraction of the time.
    t : ndarray, shape (N, m)
        Start positions.
    dependent : sequence of int
        Columns of t that move.
    max_step : ndarray, shape (dependent,)
        Longest step of each of them.
    iterations : int
    tolerance : float
        Residual at which a sample is closed.
    advance : Advance, optional
        Adds a step to positions. By default the dependent columns are summed.

    Returns
    -------
    t : ndarray, shape (N, m)
    evaluation : list of ndarray
        Results of `evaluate` there.
    """
    advance = advance or _add_to_columns(dependent)
    if len(t) == 1:
        end, results = iterate_sample(evaluate, np.array(t[0]), advance, max_step, iterations, tolerance)
        return end[None], [np.asarray(value)[None] for value in results]
    t = np.array(t)
    evaluation = [np.require(value, requirements="W") for value in evaluate(t)]
    active = np.arange(len(t))
    for _ in range(iterations):
        residual = evaluation[0][_row_index(active, t)]
        active = active[np.abs(residual).max(axis=-1, initial=0) > tolerance]
        if not len(active):
            break
        step = _limit_step(evaluation[1][_row_index(active, t)], max_step)
        active = _advance_samples(evaluate, t, evaluation, advance, active, step)
    return t, evaluation


def _add_to_columns(dependent: IntArray | Sequence[int]) -> Advance:
    """The function that adds a step (..., dependent) to these columns of positions (..., m)."""

    def advance(t: Array, step: Array) -> Array:
        end = np.array(t)
        end[..., dependent] += step
        return end

    return advance


@procedure
def iterate_sample(
    evaluate: StepEvaluator, t: Any, advance: Advance, max_step: Array, iterations: int, tolerance: float
) -> Any:
    """`iterate_newton` for one sample t (m,), of numbers or symbols."""
    evaluation = evaluate(t)
    is_improving: Any = True
    for _ in range(iterations):
        residual = evaluation[0]
        if not (is_improving and largest(magnitude(residual)) > tolerance):
            break
        step = _limit_sample_step(evaluation[1], max_step)
        sufficient = SUFFICIENT_DECREASE**2 * (residual @ residual)
        fraction = 1.0
        is_improving = False
        for _ in range(MAX_HALVINGS):
            trial = advance(t, fraction * step)
            trial_evaluation = evaluate(trial)
            if trial_evaluation[0] @ trial_evaluation[0] < sufficient:
                t = trial
                evaluation = trial_evaluation
                is_improving = True
                break
            fraction = fraction / 2
    return t, evaluation


@procedure
def _limit_sample_step(step: Any, max_step: Array) -> Any:
    """`_limit_step` for one sample."""
    step = finite_or_zero(step)
    excess = largest(magnitude(step) / max_step)
    return step / select(excess > 1, excess, 1.0)


def _limit_step(step: Array, max_step: Array) -> Array:
    """Steps (..., dependent), shortened as a whole where an entry is too long, zero where entries are not finite."""
    if not (np.abs(step) <= max_step).all():
        step = np.where(np.isfinite(step), step, 0)
        step = step / np.maximum(1.0, (np.abs(step) / max_step).max(axis=-1, keepdims=True))
    return step


def _advance_samples(
    evaluate: StepEvaluator, t: Array, evaluation: list[Array], advance: Advance, active: IntArray, step: Array
) -> IntArray:
    """Take the step (active, dependent), or a part of it, in those active samples whose residual it decreases.

    Updates t and evaluation in place, and returns the numbers of these samples, ascending.
    """
    sufficient = SUFFICIENT_DECREASE**2 * _squared_norm(evaluation[0][_row_index(active, t)])
    remaining = np.arange(len(active))
    fraction = 1.0
    improved = []
    for _ in range(MAX_HALVINGS):
        trial = advance(t[_row_index(active[remaining], t)], fraction * step[_row_index(remaining, step)])
        trial_evaluation = evaluate(trial)
        is_better = _squared_norm(trial_evaluation[0]) < sufficient[remaining]
        samples = active[remaining[is_better]]
        rows = _row_index(samples, t)
        better_rows = _row_index(np.flatnonzero(is_better), trial)
        t[rows] = trial[better_rows]
        for values, trial_values in zip(evaluation, trial_evaluation, strict=True):
            values[rows] = trial_values[better_rows]
        improved.append(samples)
        remaining = remaining[~is_better]
        fraction /= 2
        if not len(remaining):
            break
    return np.sort(np.concatenate(improved))


def _row_index(numbers: IntArray, array: Array) -> slice | IntArray:
    """Index of ascending rows of an array: a slice, which copies nothing, where these are all rows."""
    return slice(None) if len(numbers) == len(array) else numbers


def _squared_norm(residuals: Array) -> Array:
    norms: Array = np.einsum("...i,...i", residuals, residuals)
    return norms
