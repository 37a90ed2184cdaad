"""Closure of the loops at one sample, as procedures: for callers that close the loops in a cycle of a controller.

They follow `newton_iteration`, `branch_tracker` and `assembly_modes`, whose functions take many samples. The regular
cases end here: the loops close near a seed, or at the end of the straight path from the reference positions. All others
have a status that is not zero, and the caller takes the functions for many samples.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.constraints.attitude_charts import STEEP_PITCH_COSINE, angle_steps, chart_steps
from robot_dynamics.constraints.branch_tracker import (
    BLOCKED_RESIDUAL,
    MAX_ABSOLUTE_DEVIATION,
    MAX_RELATIVE_DEVIATION,
    MAX_STRIDE_ITERATIONS,
    STRIDE_TOLERANCE,
)
from robot_dynamics.constraints.closure_step import NewtonStep
from robot_dynamics.constraints.constrained_state import charted_state_at
from robot_dynamics.constraints.newton_iteration import (
    CLOSURE_TOLERANCE,
    MAX_ITERATIONS,
    MAX_STEP,
    MAX_STRIDE,
    MIN_QUALITY,
    NEWTON_TOLERANCE,
    SHORT_STRIDE,
    iterate_sample,
)
from robot_dynamics.procedures import (
    as_array,
    exchange_rows,
    find_pivot,
    is_finite,
    largest,
    magnitude,
    procedure,
    rounded,
    select,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.topology import ConstraintTopology

MAX_SAMPLE_STRIDES = 100
"""Strides of the longest path that is followed here."""

Sample = Any
"""An array (m,) of numbers or symbols."""


class ClosedSample(NamedTuple):
    """Closed positions t (m,), or a status that is not zero."""

    t: Sample
    status: Any


class SampleClosure:
    """Procedures that close the loops of a robot at one sample.

    Parameters
    ----------
    topology : ConstraintTopology
    newton_step : callable
        The results of a NewtonStep at positions t (m,).
    """

    def __init__(self, topology: ConstraintTopology, newton_step: Callable[[Sample], Sequence[Any]]) -> None:
        self._topology = topology
        self._newton_step = newton_step
        self._max_step = MAX_STEP * topology.column_units[topology.dependent_columns]
        self._independent = topology.independent_columns
        self._dependent = topology.dependent_columns
        self._order = np.argsort(np.concatenate([self._independent, self._dependent]))
        # displacement of the joints t for unit displacements of the independent joints at the reference positions
        self._tangent = _tangent_matrix(topology)

    @procedure
    def close_near(self, q: Sample) -> Any:
        """ClosedSample nearest to positions q (all joints,); the independent joints keep theirs."""
        t = q[self._topology.non_mimic_joints]
        t, evaluation = self._iterate(t, MAX_ITERATIONS, NEWTON_TOLERANCE)
        return ClosedSample(t, select(is_finite(q) & self._is_closed(evaluation), 0.0, 1.0))

    @procedure
    def close_from_reference(self, q: Sample) -> Any:
        """ClosedSample for q (n,) of the independent joints, in the assembly mode of the reference positions.

        The path leads straight from the reference positions to q without whole turns, as `_remove_turns` takes them.
        """
        target = self._without_turns(q)
        t, is_regular = self._follow_from_reference(target, MAX_STRIDE)
        if not is_regular:
            t, is_regular = self._follow_from_reference(target, SHORT_STRIDE)
        return ClosedSample(self._with_independent(t, q), select(is_finite(q) & is_regular, 0.0, 1.0))

    @procedure
    def _follow_from_reference(self, target: Sample, max_stride: float) -> Any:
        """Positions (m,) at the end of the path from the reference positions, and whether they are valid."""
        reference = self._topology.reference_positions
        direction = self._tangent @ (target - reference[self._independent])
        t, evaluation, is_regular = self._follow_path(reference, direction, target, max_stride)
        if is_regular:
            is_regular = determinant_is_positive(evaluation.determinant_matrix)
        return t, is_regular

    @procedure
    def _follow_path(
        self, start: Sample, direction: Sample, target: Sample, max_stride: float, accepts_bends: bool = False
    ) -> Any:
        """The end (m,) of the straight path from `start` (m,) to `target` (n,), as BranchTracker.follow_path.

        direction: (m,) displacement from the start to about the end. Also returns the NewtonStep at the end, and
        whether the loops close there and on the path, and no stride has a bend that is not accepted.
        """
        begin = start[self._independent]
        displacement = target - begin
        length = largest(magnitude(displacement) / self._topology.column_units[self._independent])
        strides = 1.0
        while (strides * max_stride < length) and (strides <= MAX_SAMPLE_STRIDES):
            strides = strides + 1.0
        before, is_regular = self._displaced(start, -direction / strides)
        is_regular = is_regular & (strides <= MAX_SAMPLE_STRIDES)
        t = as_array(start)
        number = select(is_regular, 1.0, strides)
        while number < strides:
            predicted, is_near = self._extrapolated(before, t)
            predicted = self._with_independent(predicted, begin + number / strides * displacement)
            before = t
            t, evaluation = self._iterate(predicted, MAX_STRIDE_ITERATIONS, STRIDE_TOLERANCE)
            is_on_path = largest(magnitude(evaluation.residual)) <= BLOCKED_RESIDUAL
            is_regular = is_regular & is_near & is_on_path
            is_regular = is_regular & (self._is_straight(before, predicted, t) | accepts_bends)
            number = select(is_regular, number + 1.0, strides)
        predicted, is_near = self._extrapolated(before, t)
        predicted = self._with_independent(predicted, target)
        before = t
        t, evaluation = self._iterate(predicted, select(is_regular, MAX_ITERATIONS, 0), NEWTON_TOLERANCE)
        is_regular = is_regular & is_near & self._is_closed(evaluation)
        is_regular = is_regular & (self._is_straight(before, predicted, t) | accepts_bends)
        return t, evaluation, is_regular

    @procedure
    def joint_positions(self, t: Sample) -> Any:
        """Positions (all joints,) from those (m,) of the joints that mimic no other joint."""
        return self._topology.S @ t + self._topology.offset

    @procedure
    def project(self, q: Sample) -> Any:
        """Positions t (m,) that close the loops near q (all joints,), their quality, and whether they are closed."""
        t, evaluation = self._iterate(q[self._topology.non_mimic_joints], MAX_ITERATIONS, NEWTON_TOLERANCE)
        return t, self._quality(evaluation), largest(magnitude(evaluation.residual)) <= CLOSURE_TOLERANCE

    @procedure
    def correction(self, begin: Sample, end: Sample) -> Any:
        """Largest displacement between positions t (m,) [rad or characteristic lengths]; whether no pitch is steep."""
        step, is_flat = self._displacement(begin, end)
        return largest(magnitude(step) / self._topology.column_units), is_flat

    @procedure
    def _iterate(self, t: Sample, iterations: int, tolerance: float) -> Any:
        """Positions (m,) by Newton's method from t (m,), and the NewtonStep there."""
        return iterate_sample(self._evaluate, t, self._advance, self._max_step, iterations, tolerance)

    def _evaluate(self, t: Sample) -> NewtonStep:
        return NewtonStep(*self._newton_step(t))

    def _advance(self, t: Sample, step: Sample) -> Any:
        """Positions (m,) after a step (dependent,) of the dependent joints.

        nan where a pitch is steep: there the loops are closed by rotations, as attitude_charts.displace does.
        """
        moved, is_flat = self._displaced(t, self._dependent_step(step))
        return moved + select(is_flat, 0.0, np.nan)

    @procedure
    def _is_closed(self, evaluation: NewtonStep) -> Any:
        """Whether the loops are closed and determine the dependent joints."""
        is_closed = largest(magnitude(evaluation.residual)) <= CLOSURE_TOLERANCE
        return is_closed & (self._quality(evaluation) > MIN_QUALITY)

    @procedure
    def _quality(self, evaluation: NewtonStep) -> Any:
        """How well the loops determine the dependent joints, as in ClosureResult."""
        return -largest(-(evaluation.pivots / evaluation.squared_norms))

    def _dependent_step(self, step: Sample) -> Any:
        """(m,) displacement of a step (dependent,)."""
        return self._merge(np.zeros(len(self._independent)), step)

    def _with_independent(self, t: Sample, q: Sample) -> Any:
        """t (m,) with positions q (n,) of the independent joints."""
        return self._merge(q, t[self._dependent])

    def _merge(self, independent: Sample, dependent: Sample) -> Any:
        """(m,) of entries (n,) for the independent joints and (dependent,) for the others."""
        return np.concatenate([independent, dependent])[self._order]

    @procedure
    def _without_turns(self, q: Sample) -> Any:
        """As assembly_modes._remove_turns, for q (n,)."""
        topology = self._topology
        reference = topology.reference_positions[self._independent]
        targets = []
        for k, moved in enumerate(topology.loop_joints_moved):
            target = q[k]
            if topology.is_periodic[k]:
                lower, upper = topology.independent_limits[:, k]
                is_limited = np.isfinite(upper - lower) and lower <= reference[k] <= upper
                nearest = target - 2 * np.pi * rounded((target - reference[k]) / (2 * np.pi))
                is_inside = is_limited and (target >= lower) & (target <= upper)
                target = select(is_inside, target, nearest) if is_limited else nearest
            targets.append(target if moved.any() else reference[k])
        return np.array(targets)

    def _displaced(self, t: Sample, step: Sample) -> tuple[Any, Any]:
        """t (m,) after a displacement (m,), as attitude_charts.displace, and whether no pitch is steep."""
        end = list(t + step)
        is_flat: Any = True
        for attitude in self._topology.dependent_attitudes:
            yaw, pitch, roll = attitude.columns
            sine, cosine = np.sin(t[pitch]), np.cos(t[pitch])
            yaw_step, roll_step = angle_steps(step[yaw], step[roll], sine, cosine)
            end[yaw], end[roll] = t[yaw] + yaw_step, t[roll] + roll_step
            is_flat = is_flat & (magnitude(cosine) >= STEEP_PITCH_COSINE)
        return np.array(end), is_flat

    def _displacement(self, begin: Sample, end: Sample) -> tuple[Any, Any]:
        """(m,) between positions (m,), as attitude_charts.displacement, and whether no pitch is steep."""
        step = list(end - begin)
        is_flat: Any = True
        for attitude in self._topology.dependent_attitudes:
            yaw, pitch, roll = attitude.columns
            sine, cosine = np.sin(end[pitch]), np.cos(end[pitch])
            step[yaw], step[roll] = chart_steps(step[yaw], step[roll], sine, cosine)
            is_flat = is_flat & (magnitude(cosine) >= STEEP_PITCH_COSINE)
            is_flat = is_flat & (magnitude(np.cos(begin[pitch])) >= STEEP_PITCH_COSINE)
        return np.array(step), is_flat

    def _extrapolated(self, before: Sample, t: Sample) -> tuple[Any, Any]:
        """Positions (m,) as far beyond t as t is from `before`, and whether no pitch is steep."""
        step, is_flat = self._displacement(before, t)
        end, is_near = self._displaced(t, step)
        return end, is_flat & is_near

    def _is_straight(self, before: Sample, predicted: Sample, t: Sample) -> Any:
        """Whether a stride from `before`, predicted to end at `predicted`, ends at t near it."""
        units = self._topology.column_units
        stride, is_flat = self._displacement(before, predicted)
        deviation, is_near = self._displacement(predicted, t)
        limit = MAX_RELATIVE_DEVIATION * largest(magnitude(stride) / units) + MAX_ABSOLUTE_DEVIATION
        return is_flat & is_near & (largest(magnitude(deviation) / units) <= limit)


@procedure
def determinant_is_positive(matrix: Sample) -> Any:
    """Whether the determinant of a matrix (k, k) is positive, by elimination with row pivots."""
    rows = as_array(matrix)
    size = len(rows)
    is_positive: Any = True
    is_regular: Any = True
    for k in range(size):
        pivot = find_pivot(rows, k)
        if pivot != k:
            is_positive = not is_positive
            exchange_rows(rows, k, pivot)
        if rows[k, k] < 0:
            is_positive = not is_positive
        is_regular = is_regular & (magnitude(rows[k, k]) > 0)
        for i in range(k + 1, size):
            factor = rows[i, k] / rows[k, k]
            for j in range(k + 1, size):
                rows[i, j] = rows[i, j] - factor * rows[k, j]
    return is_positive & is_regular


def _tangent_matrix(topology: ConstraintTopology) -> Array:
    """(m, n) rates of the joints t for unit rates of the independent ones at the reference positions.

    Rates of yaw and roll are those of the charts where the loops determine them.
    """
    if topology.attitudes != topology.dependent_attitudes:
        topology = replace(topology, attitudes=topology.dependent_attitudes)
    state = charted_state_at(topology, topology.joint_positions(topology.reference_positions))
    matrix: Array = np.nan_to_num(state.expand_rates(np.eye(len(topology.independent_columns))).T)
    return matrix[topology.non_mimic_joints]
