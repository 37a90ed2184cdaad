"""Continuation of closed positions: Newton's method at fixed independent joints, and paths along a branch.

A path goes straight from one position of the independent joints to another, in strides. Each stride starts with the
extrapolation of the last one. A stride that ends far beside its extrapolation has a bend, as where two branches meet.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.constraints.attitude_charts import chart_rates, displace, displacement
from robot_dynamics.constraints.constrained_state import charted_state_at
from robot_dynamics.constraints.newton_iteration import (
    CLOSURE_TOLERANCE,
    MAX_STEP,
    MAX_STRIDE,
    NEWTON_TOLERANCE,
    iterate_newton,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.constraints.newton_iteration import (
        Advance,
        StepEvaluator,
    )
    from robot_dynamics.constraints.topology import ConstraintTopology

MAX_STRIDES = 300
MAX_STRIDE_ITERATIONS = 3
STRIDE_TOLERANCE = 1e-4
"""Residual at which a stride ends: the next one starts with the error of an extrapolation anyway."""
BLOCKED_RESIDUAL = 0.01
"""Residual of a stride above which the loops do not close there."""
MAX_RELATIVE_DEVIATION = 0.4
"""Part of a stride by which its end may deviate from the extrapolation."""
MAX_ABSOLUTE_DEVIATION = 1e-3
"""Further deviation [rad or characteristic lengths], for STRIDE_TOLERANCE and for rounding near singular positions."""
MAX_EXTRAPOLATION = 4.0
"""Longest extrapolation of the last stride of a trajectory, as a multiple of it."""


class ClosureResult(NamedTuple):
    """Closed positions of N samples.

    Attributes
    ----------
    t : ndarray, shape (N, m)
        Positions of the joints that mimic no other joint.
    residual : ndarray, shape (N, rows)
    quality : ndarray, shape (N,)
        Least ratio of a pivot of J_d to the squared norm of its column, 0 where J_d is singular.
    determinant_matrix : ndarray, shape (N, dependent, dependent)
        As in NewtonStep.
    has_crossed_singularity : ndarray of bool, shape (N,)
        Whether a singular position lies between the start of the search and t.
    has_bend : ndarray of bool, shape (N,)
        Whether the path has a bend within a stride, as where it changes the branch at a singular position.
    """

    t: Array
    residual: Array
    quality: Array
    determinant_matrix: Array
    has_crossed_singularity: BoolArray
    has_bend: BoolArray

    @property
    def is_closed(self) -> BoolArray:
        """(N,) whether the loops are closed."""
        largest: Array = np.abs(self.residual).max(axis=-1, initial=0)
        return largest <= CLOSURE_TOLERANCE

    def assign_samples(
        self, samples: IntArray | BoolArray, other: ClosureResult, other_samples: IntArray | BoolArray
    ) -> None:
        """Overwrite samples with samples of another ClosureResult."""
        for array, other_array in zip(self, other, strict=True):
            array[samples] = other_array[other_samples]


@dataclass(frozen=True, eq=False)
class BranchTracker:
    """Newton's method and continuation for the loops of one topology.

    topology: of a robot with loops; evaluate_step: the NewtonStep of positions, by `newton_step` or a compiled program.
    Positions t (N, m) are those of the joints that mimic no other joint.
    """

    topology: ConstraintTopology
    evaluate_step: StepEvaluator

    def project_onto_constraints(self, t: Array, tolerance: float = NEWTON_TOLERANCE) -> ClosureResult:
        """Closed positions near t (N, m). The independent joints keep their positions.

        tolerance: residual at which Newton's method ends.
        """
        t, (residual, _, pivots, squared_norms, determinant_matrix) = iterate_newton(
            self.evaluate_step,
            t,
            self.topology.dependent_columns,
            self._max_step,
            tolerance=tolerance,
            advance=self._advance,
        )
        quality = (pivots / squared_norms).min(axis=-1)
        has_crossed = np.zeros(len(t), dtype=bool)
        has_bend = np.zeros(len(t), dtype=bool)
        return ClosureResult(t, residual, quality, determinant_matrix, has_crossed, has_bend)

    def follow_path(
        self, t: Array, q: Array, max_stride: float = MAX_STRIDE, previous_positions: Array | None = None
    ) -> ClosureResult:
        """Closed positions at the end of the straight path of the independent joints to q.

        Parameters
        ----------
        t : ndarray, shape (N, m)
            Closed positions at the start.
        q : ndarray, shape (N, n)
            Positions of the independent joints at the end.
        max_stride : float
            Longest stride [rad or characteristic lengths]. Strides are longer where there would be more than
            MAX_STRIDES.
        previous_positions : ndarray, shape (N, m), optional
            Closed positions before t, which the first stride extrapolates. By default it follows the tangent.
        """
        columns = self.topology.independent_columns
        start = t[:, columns]
        distances = np.abs((q - start) / self.topology.column_units[columns])
        strides = max(1, int(min(np.ceil(distances.max(initial=0) / max_stride), MAX_STRIDES)))
        if previous_positions is None:
            direction = self._tangent(t, q)
        else:
            direction = self._extrapolation(previous_positions, t, q)
        before = self._step_back(t, direction / strides)
        has_bend = np.zeros(len(t), dtype=bool)
        for fraction in np.linspace(0, 1, strides + 1)[1:-1]:
            predicted = self._extrapolate(before, t)
            predicted[:, columns] = start + fraction * (q - start)
            before = t
            t, evaluation = iterate_newton(
                self.evaluate_step,
                predicted,
                self.topology.dependent_columns,
                self._max_step,
                MAX_STRIDE_ITERATIONS,
                STRIDE_TOLERANCE,
                self._advance,
            )
            is_blocked = np.abs(evaluation[0]).max(axis=-1) > BLOCKED_RESIDUAL
            # beyond a blocked position the loops may close again, in any assembly mode
            has_bend |= self._deviates(before, predicted, t) | is_blocked
            if is_blocked.all():
                break
        predicted = self._extrapolate(before, t)
        predicted[:, columns] = q
        result = self.project_onto_constraints(predicted)
        return result._replace(has_bend=has_bend | self._deviates(t, predicted, result.t))

    def continue_branch(self, q: Array, previous: Array, velocities: Array) -> ClosureResult:
        """Closed positions for q on the branch of previous positions.

        Parameters
        ----------
        q : ndarray, shape (N, n)
        previous : ndarray, shape (N, all joints)
            Closed positions.
        velocities : ndarray, shape (N, all joints) or (N, 0)
            Velocities at `previous`; with shape (N, 0) the path follows the tangent.

        Returns
        -------
        ClosureResult
            `has_crossed_singularity` is True where the path has a bend.
        """
        topology = self.topology
        t = previous[:, topology.non_mimic_joints]
        previous_positions = None
        if velocities.shape[-1]:
            rates = chart_rates(previous, velocities, topology.dependent_attitudes, topology.offset)
            rates = rates[:, topology.non_mimic_joints]
            columns = topology.independent_columns
            units = topology.column_units[columns]
            speed = np.linalg.norm(rates[:, columns] / units, axis=-1)
            distance = np.linalg.norm((q - t[:, columns]) / units, axis=-1)
            duration = np.divide(distance, speed, out=np.zeros(len(t)), where=speed > 0)
            previous_positions = self._step_back(t, duration[:, None] * rates)
        result = self.follow_path(t, q, previous_positions=previous_positions)
        return result._replace(has_crossed_singularity=result.has_bend)

    @cached_property
    def _max_step(self) -> Array:
        """(dependent,) longest step of each dependent joint in Newton's method."""
        return MAX_STEP * self.topology.column_units[self.topology.dependent_columns]

    @property
    def _advance(self) -> Advance | None:
        """Function that adds a step to positions, None where that is a sum."""
        return self._displace_dependent if self.topology.dependent_attitudes else None

    def _displace_dependent(self, t: Array, step: Array) -> Array:
        """Positions (..., m) from t (..., m) by a step (..., dependent) of the dependent joints."""
        topology = self.topology
        full_step = np.zeros_like(t)
        full_step[..., topology.dependent_columns] = step
        end = displace(t, full_step, topology.dependent_attitudes)
        end[..., topology.independent_columns] = t[..., topology.independent_columns]
        return end

    def _tangent(self, t: Array, q: Array) -> Array:
        """(N, m) displacement from t to q (N, n) along the tangent."""
        topology = self.topology
        if topology.attitudes != topology.dependent_attitudes:
            topology = replace(topology, attitudes=topology.dependent_attitudes)
        direction = np.zeros_like(t)
        direction[:, topology.independent_columns] = q - t[:, topology.independent_columns]
        state = charted_state_at(topology, topology.joint_positions(t))
        rates = state.expand_rates(direction[:, topology.independent_columns])
        direction[:, topology.dependent_columns] = rates[:, topology.dependent]
        return np.nan_to_num(direction)

    def _extrapolation(self, previous_positions: Array, t: Array, q: Array) -> Array:
        """(N, m) displacement from t that continues the one from `previous_positions` as far as q (N, n)."""
        columns = self.topology.independent_columns
        units = self.topology.column_units[columns]
        last = (t - previous_positions)[:, columns] / units
        remaining = (q - t[:, columns]) / units
        length = np.sum(last**2, axis=-1)
        ratio = np.sum(last * remaining, axis=-1) / np.where(length > 0, length, np.inf)
        ratio = np.clip(ratio, -MAX_EXTRAPOLATION, MAX_EXTRAPOLATION)
        extrapolation: Array = ratio[:, None] * displacement(previous_positions, t, self.topology.dependent_attitudes)
        return extrapolation

    def _extrapolate(self, before: Array, t: Array) -> Array:
        """(N, m) positions as far beyond t as t is from `before`."""
        attitudes = self.topology.dependent_attitudes
        return displace(t, displacement(before, t, attitudes), attitudes)

    def _step_back(self, t: Array, direction: Array) -> Array:
        """(N, m) positions from which the displacement `direction` (N, m) leads to t."""
        return displace(t, -direction, self.topology.dependent_attitudes)

    def _deviates(self, before: Array, predicted: Array, t: Array) -> BoolArray:
        """(N,) whether a stride from `before`, predicted to end at `predicted`, ends at t far beside it."""
        attitudes = self.topology.dependent_attitudes
        units = self.topology.column_units
        stride = np.abs(displacement(before, predicted, attitudes) / units)
        deviation = np.abs(displacement(predicted, t, attitudes) / units)
        limit = MAX_RELATIVE_DEVIATION * stride.max(axis=-1) + MAX_ABSOLUTE_DEVIATION
        return np.asarray(deviation.max(axis=-1) > limit)
