"""Steps of a robot with loops in machine code, in one set of independent coordinates.

The procedures follow `constrained_motion` and `branch` too. A step that comes near a singular position, or that needs
other coordinates, ends the run.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.constraints.attitude_charts import STEEP_PITCH_COSINE, angle_steps, pitch_sine_cosine
from robot_dynamics.procedures import largest, magnitude, procedure
from robot_dynamics.simulation.compiled_steps import CompiledSteps, keep_best
from robot_dynamics.simulation.step_limits import (
    DEGRADATION_RATIO,
    MAX_CORRECTION,
    MAX_TRAVEL,
    NEAR_SINGULAR_QUALITY,
)
from robot_dynamics.simulation.step_parts import limit_travel

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.sample_closure import SampleClosure
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.simulation.compiled_steps import StepEnvironment
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction


class CompiledLoopSteps(CompiledSteps):
    """Steps as procedures.

    Parameters
    ----------
    topology : ConstraintTopology
        With the independent joints whose velocities are integrated.
    closure : SampleClosure
        Of this topology.
    state_derivative : callable
        Velocities (all joints,) and accelerations (n,), of a moving base with its acceleration (6,), from positions
        (all joints,), rates (n,) and efforts (all joints,).
    inertia_matrix : callable
        A (m, m) at positions (all joints,).
    friction : ImpulsiveFriction
    units : ndarray, shape (m,)
        Change of each rate that counts as much as one radian [rad or m].
    environment : StepEnvironment
    step : float
        Length of a step [s].
    """

    _has_loops = True

    def __init__(
        self,
        topology: ConstraintTopology,
        closure: SampleClosure,
        state_derivative: Callable[..., Any],
        inertia_matrix: Callable[[Any], Any],
        friction: ImpulsiveFriction,
        units: Array,
        environment: StepEnvironment,
        step: float,
    ) -> None:
        super().__init__(inertia_matrix, friction, units, len(topology.S), environment, step)
        self._topology = topology
        self._closure = closure
        self._state_derivative = state_derivative
        self._loop_joints = sorted(topology.robot.joints_in_loops)

    def _model(self, q: Any, joint_rates: Any, efforts: Any, *others: Any) -> tuple[Any, ...]:
        return tuple(self._state_derivative(q, joint_rates, efforts, *others))

    def _position_rates(self, q: Any, velocities: Any) -> Any:
        rates = list(velocities)
        for attitude in self._topology.attitudes:
            yaw, _, roll = attitude.joints
            sine, cosine = pitch_sine_cosine(q, attitude, self._topology.offset)
            rates[yaw], rates[roll] = angle_steps(rates[yaw], rates[roll], sine[()], cosine[()])
        return np.array(rates)

    def _loop_speed(self, velocities: Any) -> Any:
        joints = self._loop_joints
        return largest(magnitude(velocities[joints]) / self._topology.joint_units[joints])

    def can_begin(self, q: Any) -> Any:
        is_flat: Any = True
        for attitude in self._topology.attitudes:
            _, cosine = pitch_sine_cosine(q, attitude, self._topology.offset)
            is_flat = is_flat & (magnitude(cosine[()]) >= STEEP_PITCH_COSINE)
        return is_flat

    def limit(self, length: Any, speed: Any) -> Any:
        return limit_travel(length, speed, MAX_TRAVEL, self._step)

    @procedure
    def close(self, q: Any, qualities: Any) -> Any:
        t, quality, is_closed = self._closure.project(q)
        correction, is_flat = self._closure.correction(q[self._topology.non_mimic_joints], t)
        is_regular = is_closed & is_flat & (correction <= MAX_CORRECTION) & (quality >= NEAR_SINGULAR_QUALITY)
        is_regular = is_regular & (quality >= DEGRADATION_RATIO * qualities[0])
        closed = self._closure.joint_positions(t)
        return closed, keep_best(qualities, quality), is_regular & self.can_begin(closed)

    def _shares_at(self, q: Any) -> Any:
        no_efforts = np.zeros(self._position_count)
        others = [np.zeros(6), np.zeros(3)] if self._has_moving_base else []
        others += [np.zeros(6)] * self._environment.wrench_count
        units = np.eye(self._joint_count)
        velocities = [self._model(q, unit, no_efforts, *others)[0][self._friction.joints] for unit in units]
        return np.array(velocities)

    def _efforts_at_joints(self, joint_shares: Any, efforts: Any) -> Any:
        return efforts[self._friction.joints]

    def _efforts_from_joints(self, joint_shares: Any, values: Any) -> Any:
        return np.eye(self._position_count)[:, self._friction.joints] @ values
