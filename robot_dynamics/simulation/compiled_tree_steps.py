"""Steps of a robot without loops in machine code."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from robot_dynamics.simulation.compiled_steps import CompiledSteps

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.compiled_steps import StepEnvironment
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction


class CompiledTreeSteps(CompiledSteps):
    """Steps as procedures.

    Parameters
    ----------
    direct : callable
        Accelerations (n,), of a moving base with its acceleration (6,), from positions, velocities and efforts (n,).
    inertia_matrix : callable
        A (m, m) at positions (n,).
    friction : ImpulsiveFriction
    joint_shares : ndarray, shape (n, k)
        Velocity of each joint with friction for unit rates of the joints.
    units : ndarray, shape (m,)
        Change of each rate that counts as much as one radian [rad or m].
    environment : StepEnvironment
    step : float
        Length of a step [s].
    """

    _has_loops = False

    def __init__(
        self,
        direct: Callable[..., Any],
        inertia_matrix: Callable[[Any], Any],
        friction: ImpulsiveFriction,
        joint_shares: Array,
        units: Array,
        environment: StepEnvironment,
        step: float,
    ) -> None:
        super().__init__(inertia_matrix, friction, units, len(joint_shares), environment, step)
        self._direct = direct
        self._joint_shares = joint_shares

    def _model(self, q: Any, joint_rates: Any, efforts: Any, *others: Any) -> tuple[Any, ...]:
        results = self._direct(q, joint_rates, efforts, *others)
        return joint_rates, *(results if self._has_moving_base else (results,))

    def _position_rates(self, q: Any, velocities: Any) -> Any:
        return velocities

    def _loop_speed(self, velocities: Any) -> Any:
        return 0.0

    def can_begin(self, q: Any) -> Any:
        return True

    def limit(self, length: Any, speed: Any) -> Any:
        return length

    def close(self, q: Any, qualities: Any) -> tuple[Any, Any, Any]:
        return q, qualities, True

    def _shares_at(self, q: Any) -> Any:
        return self._joint_shares

    def _efforts_at_joints(self, joint_shares: Any, efforts: Any) -> Any:
        return joint_shares.T @ efforts

    def _efforts_from_joints(self, joint_shares: Any, values: Any) -> Any:
        return joint_shares @ values
