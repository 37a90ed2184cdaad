"""Steps of a simulation in machine code: of a robot without loops on a fixed base, whose efforts are held.

The procedures follow `step_integrator` and `time_stepping`. A step of which the error is too large ends the run: it is
then taken in parts by these modules.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.procedures import largest, magnitude, procedure, solve, zeros
from robot_dynamics.simulation.friction_impulses import friction_impulses
from robot_dynamics.simulation.runge_kutta import increment
from robot_dynamics.simulation.step_integrator import MIN_RATE_SCALE, TOLERANCE

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction

RECORDED_STEPS = 50
"""Steps of one call that records all of them."""


class CompiledSteps:
    """Steps as procedures.

    Parameters
    ----------
    direct : callable
        Accelerations (n,) from positions, velocities and efforts (n,).
    inertia_matrix : callable
        A (n, n) at positions (n,).
    friction : ImpulsiveFriction
        With constant limits and without asymmetric viscous friction.
    shares : ndarray, shape (n, k)
        Velocity of each joint with friction for unit rates of the joints.
    units : ndarray, shape (n,)
        Change of each rate that counts as much as one radian [rad or m].
    step : float
        Length of a step [s].
    """

    def __init__(
        self,
        direct: Callable[[Any, Any, Any], Any],
        inertia_matrix: Callable[[Any], Any],
        friction: ImpulsiveFriction,
        shares: Array,
        units: Array,
        step: float,
    ) -> None:
        self._direct = direct
        self._inertia_matrix = inertia_matrix
        self._friction = friction
        assert friction.constant_limits is not None
        self._limits = friction.constant_limits
        self._shares = shares
        self._units = units
        self._step = step

    @procedure
    def advance(self, q: Any, qd: Any, efforts: Any, steps: Any) -> Any:
        """Positions and velocities (n,) after a number (1,) of steps, or fewer if one fails; and their number (1,)."""
        done = 0.0
        is_regular: Any = True
        while done < steps[0] and is_regular:
            end_q, end_qd, is_regular = self._advance_once(q, qd, efforts)
            if is_regular:
                q = end_q
                qd = end_qd
                done = done + 1.0
        return q, qd, np.array([done])

    @procedure
    def record(self, q: Any, rates: Any, efforts: Any, steps: Any) -> Any:
        """Positions and velocities (RECORDED_STEPS, n) after each step with its efforts (RECORDED_STEPS n,).

        The number (1,) of steps that were taken follows: at most `steps` (1,), fewer if one fails.
        """
        size = len(self._units)
        efforts = efforts.reshape(RECORDED_STEPS, size)
        positions = zeros(RECORDED_STEPS, size)
        velocities = zeros(RECORDED_STEPS, size)
        done = 0.0
        is_regular: Any = True
        for k in range(RECORDED_STEPS):
            if is_regular and done < steps[0]:
                end_q, end_rates, is_regular = self._advance_once(q, rates, efforts[k])
                if is_regular:
                    q = end_q
                    rates = end_rates
                    positions[k] = q
                    velocities[k] = rates
                    done = done + 1.0
        return positions, velocities, np.array([done])

    @procedure
    def _advance_once(self, q: Any, qd: Any, efforts: Any) -> Any:
        """Positions and velocities (n,) one step later, and whether the error is small enough."""
        size = len(self._units)
        y = np.concatenate([q, qd])
        impulses = np.zeros(len(self._friction.joints))
        if len(impulses):
            accelerations = self._direct(q, qd, efforts)
            predicted = qd + self._step * accelerations
            impulses, _ = self._friction_response(q, predicted, impulses)
            efforts = efforts + self._shares @ impulses / self._step

        def derivative(_: Any, y: Any) -> Any:
            return np.concatenate([y[size:], self._direct(y[:size], y[size:], efforts)])

        change, y_error = increment(derivative, 0.0, y, self._step)
        end = y + change
        rates = end[size:]
        scale = MIN_RATE_SCALE + largest(magnitude(rates) / self._units)
        is_regular = largest(magnitude(y_error[size:]) / self._units) <= TOLERANCE * scale
        if len(impulses):
            _, response = self._friction_response(end[:size], rates, impulses)
            rates = rates + response
        return end[:size], rates, is_regular

    @procedure
    def _friction_response(self, q: Any, rates: Any, applied_impulses: Any) -> Any:
        """Impulses (k,) of friction, and the change (n,) of the rates by those that they do not contain yet."""
        friction = self._friction
        response = solve(self._inertia_matrix(q), self._shares)
        W = self._shares.T @ response
        velocities = self._shares.T @ rates - W @ applied_impulses
        impulses = friction_impulses(W, velocities, self._limits, friction.viscous_gains)
        return impulses, response @ (impulses - applied_impulses)
