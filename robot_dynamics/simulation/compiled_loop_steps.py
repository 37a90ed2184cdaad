"""Steps of a robot with loops on a fixed base in machine code, in one set of independent coordinates.

The procedures follow `step_integrator`, `constrained_motion` and `branch`. A step that comes near a singular position,
that needs other coordinates, or that must be taken in parts, ends the run: it is taken by these modules.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.constraints.attitude_charts import STEEP_PITCH_COSINE, angle_steps
from robot_dynamics.procedures import largest, magnitude, procedure, select, solve, zeros
from robot_dynamics.simulation.branch import MAX_CORRECTION
from robot_dynamics.simulation.compiled_steps import RECORDED_STEPS
from robot_dynamics.simulation.constrained_motion import DEGRADATION_RATIO, MAX_TRAVEL, NEAR_SINGULAR_QUALITY
from robot_dynamics.simulation.friction_impulses import friction_impulses
from robot_dynamics.simulation.runge_kutta import increment
from robot_dynamics.simulation.step_integrator import MIN_RATE_SCALE, TOLERANCE

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.sample_closure import SampleClosure
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction


class CompiledLoopSteps:
    """Steps as procedures.

    Parameters
    ----------
    topology : ConstraintTopology
        With the independent joints whose velocities are integrated.
    closure : SampleClosure
        Of this topology.
    state_derivative : callable
        Velocities (all joints,) and accelerations (n,), from positions (all joints,), rates (n,) and efforts
        (all joints,).
    inertia_matrix : callable
        A (n, n) at positions (all joints,).
    friction : ImpulsiveFriction
        With constant limits and without asymmetric viscous friction.
    units : ndarray, shape (n,)
        Change of each rate that counts as much as one radian [rad or m].
    step : float
        Length of a step [s].
    """

    def __init__(
        self,
        topology: ConstraintTopology,
        closure: SampleClosure,
        state_derivative: Callable[[Any, Any, Any], Any],
        inertia_matrix: Callable[[Any], Any],
        friction: ImpulsiveFriction,
        units: Array,
        step: float,
    ) -> None:
        self._topology = topology
        self._closure = closure
        self._state_derivative = state_derivative
        self._inertia_matrix = inertia_matrix
        self._friction = friction
        assert friction.constant_limits is not None
        self._limits = friction.constant_limits
        self._units = units
        self._joint_units = topology.joint_units
        self._loop_joints = sorted(topology.robot.joints_in_loops)
        self._step = step

    @procedure
    def advance(self, q: Any, rates: Any, efforts: Any, best_quality: Any, steps: Any) -> Any:
        """Positions (all joints,) and rates (n,) after a number (1,) of steps, or fewer if one ends the run.

        Returns them with the number (1,) of steps, and the quality of the coordinates (2,): best and present.
        """
        done = 0.0
        best = best_quality[0]
        quality = best_quality[0]
        is_regular: Any = True
        while done < steps[0] and is_regular:
            end_q, end_rates, end_quality, is_regular = self._advance_once(q, rates, efforts)
            is_regular = is_regular & (end_quality >= DEGRADATION_RATIO * best)
            if is_regular:
                q = end_q
                rates = end_rates
                quality = end_quality
                best = select(quality > best, quality, best)
                done = done + 1.0
        return q, rates, np.array([done]), np.array([best, quality])

    @procedure
    def record(self, q: Any, rates: Any, efforts: Any, best_quality: Any, steps: Any) -> Any:
        """As CompiledSteps.record, with positions and efforts of all joints; best and present quality (2,) follow."""
        joints = self._joint_count
        efforts = efforts.reshape(RECORDED_STEPS, joints)
        positions = zeros(RECORDED_STEPS, joints)
        velocities = zeros(RECORDED_STEPS, len(self._units))
        done = 0.0
        best = best_quality[0]
        quality = best_quality[0]
        is_regular: Any = True
        for k in range(RECORDED_STEPS):
            if is_regular and done < steps[0]:
                end_q, end_rates, end_quality, is_regular = self._advance_once(q, rates, efforts[k])
                is_regular = is_regular & (end_quality >= DEGRADATION_RATIO * best)
                if is_regular:
                    q = end_q
                    rates = end_rates
                    quality = end_quality
                    best = select(quality > best, quality, best)
                    positions[k] = q
                    velocities[k] = rates
                    done = done + 1.0
        return positions, velocities, np.array([done]), np.array([best, quality])

    @procedure
    def _advance_once(self, q: Any, rates: Any, efforts: Any) -> Any:
        """Positions, rates and quality one step later, and whether the step is regular."""
        size = self._joint_count
        step = self._step
        impulses = np.zeros(len(self._friction.joints))
        velocities, accelerations = self._state_derivative(q, rates, efforts)
        speed = largest(magnitude(velocities[self._loop_joints]) / self._joint_units[self._loop_joints])
        is_regular = (step * speed <= MAX_TRAVEL) & self._has_flat_pitch(q)
        if len(impulses):
            impulses, _ = self._friction_response(q, rates + step * accelerations, impulses)
            efforts = efforts + self._at_friction_joints(impulses / step)

        def derivative(_: Any, y: Any) -> Any:
            velocities, accelerations = self._state_derivative(y[:size], y[size:], efforts)
            return np.concatenate([self._angle_rates(y[:size], velocities), accelerations])

        y = np.concatenate([q, rates])
        change, y_error = increment(derivative, 0.0, y, step)
        end = y + change
        end_rates = end[size:]
        scale = MIN_RATE_SCALE + largest(magnitude(end_rates) / self._units)
        is_regular = is_regular & (largest(magnitude(y_error[size:]) / self._units) <= TOLERANCE * scale)
        t, quality, is_closed = self._closure.project(end[:size])
        correction, is_flat = self._closure.correction(end[:size][self._topology.non_mimic_joints], t)
        is_regular = is_regular & is_closed & is_flat & (correction <= MAX_CORRECTION)
        is_regular = is_regular & (quality >= NEAR_SINGULAR_QUALITY)
        closed = self._closure.joint_positions(t)
        if len(impulses):
            _, response = self._friction_response(closed, end_rates, impulses)
            end_rates = end_rates + response
        return closed, end_rates, quality, is_regular

    @procedure
    def _friction_response(self, q: Any, rates: Any, applied_impulses: Any) -> Any:
        """Impulses (k,) of friction, and the change (n,) of the rates by those that they do not contain yet."""
        friction = self._friction
        no_efforts = np.zeros(self._joint_count)
        columns = [self._state_derivative(q, unit, no_efforts)[0][friction.joints] for unit in np.eye(len(self._units))]
        shares = np.array(columns)
        response = solve(self._inertia_matrix(q), shares)
        W = shares.T @ response
        velocities = shares.T @ rates - W @ applied_impulses
        impulses = friction_impulses(W, velocities, self._limits, friction.viscous_gains)
        return impulses, response @ (impulses - applied_impulses)

    @property
    def _joint_count(self) -> int:
        """Number of all joints."""
        return len(self._topology.S)

    def _at_friction_joints(self, values: Any) -> Any:
        """Values (k,) of the joints with friction as an array (all joints,)."""
        return np.eye(self._joint_count)[:, self._friction.joints] @ values

    def _has_flat_pitch(self, q: Any) -> Any:
        """Whether the pitch of no platform is steep at q (all joints,)."""
        is_flat: Any = True
        for (_, pitch, _), _ in self._topology.attitudes:
            cosine = np.cos(q[pitch] - self._topology.offset[pitch])
            is_flat = is_flat & (magnitude(cosine) >= STEEP_PITCH_COSINE)
        return is_flat

    def _angle_rates(self, q: Any, chart_rates: Any) -> Any:
        """Velocities (all joints,) from rates in the charts of platforms, at positions q (all joints,)."""
        velocities = list(chart_rates)
        for (yaw, pitch, roll), _ in self._topology.attitudes:
            angle = q[pitch] - self._topology.offset[pitch]
            velocities[yaw], velocities[roll] = angle_steps(
                velocities[yaw], velocities[roll], np.sin(angle), np.cos(angle)
            )
        return np.array(velocities)
