"""Continuation of closed positions at one sample, as procedures: from a sample of a motion to the next one.

They follow `BranchTracker.continue_branch` and `follow_path`. Samples that need another way have a status that is not
zero, and the caller takes these functions.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.constraints.branch_tracker import MAX_EXTRAPOLATION
from robot_dynamics.constraints.newton_iteration import MAX_STRIDE
from robot_dynamics.constraints.sample_closure import ClosedSample, SampleClosure
from robot_dynamics.procedures import is_finite, largest, magnitude, procedure, select

if TYPE_CHECKING:
    from robot_dynamics.constraints.sample_closure import Sample

TANGENT_STEP = 1e-6
"""Step of the finite difference for the tangent [rad or characteristic lengths]. It determines where the first stride
of a path begins, and not where the path ends."""


class SampleContinuation(SampleClosure):
    """Procedures that continue a branch at one sample. Parameters as of SampleClosure."""

    @procedure
    def continue_along_tangent(self, q: Sample, previous: Sample) -> Any:
        """ClosedSample for q (n,) of the independent joints, from closed positions `previous` (all joints,)."""
        t = previous[self._topology.non_mimic_joints]
        return self._continue(q, t, self._tangent_to(t, q))

    @procedure
    def continue_with_velocities(self, q: Sample, previous: Sample, velocities: Sample) -> Any:
        """ClosedSample for q (n,), from closed positions and velocities (all joints,) there."""
        t = previous[self._topology.non_mimic_joints]
        rates = self._chart_rates(previous, velocities)[self._topology.non_mimic_joints]
        units = self._topology.column_units[self._independent]
        speed = _length(rates[self._independent] / units)
        distance = _length((q - t[self._independent]) / units)
        duration = select(speed > 0, distance / select(speed > 0, speed, 1.0), 0.0)
        before, is_flat = self._displaced(t, -(duration * rates))
        return self._continue_from_both(q, before, t, is_flat & is_finite(velocities))

    @procedure
    def continue_sequence(self, q: Sample, previous: Sample, before_previous: Sample) -> Any:
        """ClosedSample for q (n,), from the closed positions (all joints,) of the two samples before it.

        As `BranchTracker.follow_path` it accepts bends, which measured positions have everywhere.
        """
        columns = self._topology.non_mimic_joints
        return self._continue_from_both(q, before_previous[columns], previous[columns], True, accepts_bends=True)

    @procedure
    def _continue_from_both(
        self, q: Sample, before: Sample, t: Sample, is_valid: Any, accepts_bends: bool = False
    ) -> Any:
        direction, is_flat = self._extrapolation(before, t, q)
        closed = self._continue(q, t, direction, accepts_bends)
        return ClosedSample(closed.t, closed.status + select(is_valid & is_flat, 0.0, 1.0))

    @procedure
    def _continue(self, q: Sample, t: Sample, direction: Sample, accepts_bends: bool = False) -> Any:
        """ClosedSample for q (n,) at the end of the path from t (m,) that starts with a displacement (m,)."""
        is_valid = is_finite(q) & is_finite(t) & is_finite(direction)
        t, _, is_regular = self._follow_path(t, direction, q, MAX_STRIDE, accepts_bends)
        return ClosedSample(t, select(is_valid & is_regular, 0.0, 1.0))

    @procedure
    def _tangent_to(self, t: Sample, q: Sample) -> Any:
        """As BranchTracker._tangent: the displacement (m,) from t to q (n,) along the tangent, by differences.

        The step of Newton's method changes by the displacement of the dependent joints, with its sign reversed.
        """
        displacement = q - t[self._independent]
        length = largest(magnitude(displacement) / self._topology.column_units[self._independent])
        fraction = TANGENT_STEP / select(length > TANGENT_STEP, length, TANGENT_STEP)
        moved = self._with_independent(t, t[self._independent] + fraction * displacement)
        change = self._evaluate(moved).step - self._evaluate(t).step
        return self._merge(displacement, change / fraction)

    def _extrapolation(self, before: Sample, t: Sample, q: Sample) -> tuple[Any, Any]:
        """As BranchTracker._extrapolation: a displacement (m,), and whether no pitch is steep."""
        units = self._topology.column_units[self._independent]
        last = (t[self._independent] - before[self._independent]) / units
        remaining = (q - t[self._independent]) / units
        squared_length = last @ last
        ratio = (last @ remaining) / select(squared_length > 0, squared_length, np.inf)
        ratio = select(ratio > MAX_EXTRAPOLATION, MAX_EXTRAPOLATION, ratio)
        ratio = select(ratio < -MAX_EXTRAPOLATION, -MAX_EXTRAPOLATION, ratio)
        step, is_flat = self._displacement(before, t)
        return ratio * step, is_flat

    def _chart_rates(self, q: Sample, velocities: Sample) -> Any:
        """As attitude_charts.chart_rates: rates (all joints,) in the charts."""
        rates = list(velocities[: len(self._topology.offset)])
        for attitude in self._topology.dependent_attitudes:
            yaw, pitch, roll = attitude.joints
            angle = q[pitch] - self._topology.offset[pitch]
            rates[roll] = rates[roll] - np.sin(angle) * rates[yaw]
            rates[yaw] = np.cos(angle) * rates[yaw]
        return np.array(rates)


def _length(vector: Any) -> Any:
    """The Euclidean length of a vector of numbers or symbols."""
    return np.sqrt(vector @ vector)
