"""Static equilibrium of unactuated joints: springs, gravity and wrenches in balance, the motors locked.

With Γ_f the forces at these joints of the inverse model at rest, f(q_f) = Γ_f(q_f) + k (q_f - q₀) is the unbalanced
force, and K its derivative, the stiffness against a small displacement. From the start positions the joints move
downhill, as with strong damping: steps -(K + μ 1)⁻¹ f, with the least μ that makes the matrix positive definite, none
longer than MAX_ROTATION and none beyond the balance along its direction. Joints are scaled by their own stiffness, so
that a soft one beside a stiff one counts. Near a stable equilibrium μ is zero, and the steps are Newton's. Joints that
start in balance stay there, stable or not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, Protocol, TypeVar

import numpy as np

from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.walker_orin import bias

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.model.robot import Robot

MAX_ITERATIONS = 300
MAX_HALVINGS = 30
MAX_ROTATION = 0.2
"""Longest step [rad] of joints that rotate a link."""
MAX_TRANSLATION = 5.0
"""Longest step [m] of joints that only translate links: gravity along such a joint does not change."""
DISPLACEMENT = 1e-6
"""Displacement [rad or m] for the derivative by central differences."""
MIN_STIFFNESS = 1e-6
"""Least eigenvalue of the scaled stiffness with which a step is taken."""
NEUTRAL_STIFFNESS = 1e-9
"""Least eigenvalue of the scaled stiffness of a stable equilibrium."""
RELATIVE_BALANCE_TOLERANCE = 1e-14
"""Unbalanced force, as a part of weights, wrenches and springs, at which joints do not move."""


class EquilibriumState(Protocol):
    """Positions of all joints, and how they move with the independent ones, as a ConstrainedState has them."""

    @property
    def robot(self) -> Robot: ...

    @property
    def q(self) -> Array:
        """(..., all joints)."""

    @property
    def chart_q(self) -> Array:
        """Positions (..., all joints) that belong to `robot`."""

    @property
    def G(self) -> Array:
        """(..., all joints, m): rates of all joints for unit rates of the independent ones."""

    def projected(self, forces: Array, /) -> Array:
        """Gᵀ forces (..., m), from forces (..., all joints)."""


StateT = TypeVar("StateT", bound=EquilibriumState)


@dataclass(frozen=True, eq=False)
class StaticBalance(Generic[StateT]):
    """Result of `find_equilibrium`.

    Attributes
    ----------
    constrained_state : EquilibriumState
    is_stable : ndarray of bool, shape (...)
        For loads with a potential. Wrenches that turn with their links may excite an equilibrium that is stable here.
    residual : ndarray, shape (..., unactuated)
        Unbalanced forces.
    scale : ndarray, shape (..., unactuated)
        Weights, wrenches and the forces of springs at 1 rad or m, to compare the residual with.
    """

    constrained_state: StateT
    is_stable: BoolArray
    residual: Array
    scale: Array


@dataclass(frozen=True, eq=False)
class _StaticForces(Generic[StateT]):
    """Unbalanced forces of the unactuated joints; fields as the parameters of `find_equilibrium`."""

    robot: Robot
    state_near: Callable[[Array, Array], StateT]
    q: Array
    unactuated: Sequence[int]
    base_acceleration: Array
    external_wrenches: Mapping[int, Array]

    def state(self, positions: Array, near: Array) -> StateT:
        """State with the unactuated joints at positions (..., unactuated), near positions (..., all joints)."""
        q = np.array(np.broadcast_to(self.q, (*positions.shape[:-1], self.q.shape[-1])))
        q[..., self.unactuated] = positions
        return self.state_near(q, near)

    def evaluate(self, positions: Array, near: Array) -> Array:
        """Unbalanced forces (..., unactuated); arguments as for `state`."""
        state = self.state(positions, near)
        at_rest = np.zeros_like(state.q)
        static_forces = bias(
            state.robot,
            state.chart_q,
            at_rest,
            base_acceleration=self.base_acceleration,
            external_wrenches=self.external_wrenches,
        )
        springs = spring_force(self.robot, state.q, at_rest)
        return state.projected(static_forces[..., -len(self.robot.joints) :] + springs)[..., self.unactuated]

    def stiffness(self, positions: Array, near: Array) -> Array:
        """Derivative (..., unactuated, unactuated) of the unbalanced forces by the positions."""
        size = positions.shape[-1]
        steps = DISPLACEMENT * np.eye(size).reshape(size, *(1,) * (positions.ndim - 1), size)
        columns = (self.evaluate(positions + steps, near) - self.evaluate(positions - steps, near)) / (2 * DISPLACEMENT)
        return np.moveaxis(columns, 0, -1)


def find_equilibrium(
    robot: Robot,
    state_near: Callable[[Array, Array], StateT],
    start: StateT,
    q: Array,
    free: Sequence[int],
    base_acceleration: Array,
    external_wrenches: Mapping[int, Array],
) -> StaticBalance[StateT]:
    """Find positions of the unactuated joints at which springs, gravity and wrenches are in balance.

    Parameters
    ----------
    robot : Robot
    state_near : callable
        Returns the EquilibriumState for positions (..., m) of the independent joints, near positions
        (..., all joints).
    start : EquilibriumState
        Where the search starts.
    q : ndarray, shape (..., m)
        Positions of the independent joints there.
    free : sequence of int
        Numbers, among the independent joints, of those without a motor.
    base_acceleration : ndarray, shape (..., 6)
        Gravity subtracted.
    external_wrenches : mapping of int to ndarray
        jf_e (..., 6) by link number.
    """
    static_forces = _StaticForces(robot, state_near, q, free, base_acceleration, external_wrenches)
    state = start
    positions = q[..., free]
    forces = static_forces.evaluate(positions, state.q)
    positions = np.array(np.broadcast_to(positions, forces.shape))  # the batch of base and wrenches too
    G = state.G[..., free]
    scale = _force_scale(robot, G, base_acceleration, external_wrenches)
    max_step = _max_step(robot, G)
    for _ in range(MAX_ITERATIONS):
        if not np.isfinite(forces).all():
            return StaticBalance(state, np.zeros(forces.shape[:-1], dtype=bool), forces, scale)
        before = positions
        is_balanced = np.asarray((np.abs(forces) <= RELATIVE_BALANCE_TOLERANCE * scale).all(axis=-1))
        positions, forces = _step_downhill(static_forces, state.q, positions, forces, is_balanced, max_step)
        state = static_forces.state(positions, state.q)
        if np.all(np.abs(positions - before) <= 1e-15 * (1 + np.abs(positions))):
            break
    _, K = _scale_by_own_stiffness(static_forces.stiffness(positions, state.q))
    is_stable = _least_eigenvalue(K) > NEUTRAL_STIFFNESS
    return StaticBalance(state, is_stable, forces, scale)


def _max_step(robot: Robot, G: Array) -> Array:
    """(unactuated,) longest step of each unactuated joint, G (..., all joints, unactuated)."""
    is_revolute = np.array([not joint.prismatic for joint in robot.joints])
    translates_only = ~np.any((G != 0) & is_revolute[:, None], axis=tuple(range(G.ndim - 1)))
    return np.where(translates_only, MAX_TRANSLATION, MAX_ROTATION)


def _force_scale(robot: Robot, G: Array, base_acceleration: Array, external_wrenches: Mapping[int, Array]) -> Array:
    """(..., unactuated) forces to compare with: weights, wrenches, and forces of the joint's springs at 1 rad or m."""
    stiffness = np.array([joint.spring.stiffness if joint.spring else 0.0 for joint in robot.joints])
    masses = np.array([link.inertia.mass for link in robot.links])
    for number in range(len(robot.joints), 0, -1):  # mass of the subtree of each joint
        masses[robot.joints[number - 1].antecedent] += masses[number]
    loads = (masses[1:] @ np.abs(G)) * np.linalg.norm(base_acceleration, axis=-1, keepdims=True)
    loads = loads + sum(np.linalg.norm(wrench, axis=-1, keepdims=True) for wrench in external_wrenches.values())
    scale: Array = loads + stiffness @ (G * G)
    return scale


def _scale_by_own_stiffness(K: Array) -> tuple[Array, Array]:
    """(s, s K s): 1/√|K_ii| of each joint (..., unactuated), 1 without stiffness, and the scaled K."""
    own = np.abs(np.diagonal(K, axis1=-2, axis2=-1))
    s = 1 / np.sqrt(np.where(own > 1e-12 * own.max(axis=-1, keepdims=True), own, 1.0))
    return s, s[..., :, None] * K * s[..., None, :]


def _least_eigenvalue(K: Array) -> Array:
    """Least eigenvalue (...) of the symmetric part of K (..., k, k)."""
    least: Array = np.linalg.eigvalsh((K + np.swapaxes(K, -1, -2)) / 2).min(axis=-1)
    return least


def _step_downhill(
    static_forces: _StaticForces[StateT],
    near: Array,
    positions: Array,
    forces: Array,
    is_balanced: BoolArray,
    max_step: Array,
) -> tuple[Array, Array]:
    """Positions and unbalanced forces after one step; without a step where a sample is balanced or no step helps."""
    s, K = _scale_by_own_stiffness(static_forces.stiffness(positions, near))
    least = _least_eigenvalue(K)
    damping = np.where(least < MIN_STIFFNESS, MIN_STIFFNESS - least + np.abs(least), 0.0)
    matrix = K + damping[..., None, None] * np.eye(K.shape[-1])
    step = -s * solve_each(matrix, s * forces)
    step = step / np.maximum(1.0, np.abs(step / max_step).max(axis=-1, keepdims=True))
    descent = -(forces * step).sum(axis=-1, keepdims=True)
    fraction = np.ones((*step.shape[:-1], 1))
    for _ in range(MAX_HALVINGS):
        new_forces = static_forces.evaluate(positions + fraction * step, near)
        is_beyond = (new_forces * step).sum(axis=-1, keepdims=True) > 0.5 * np.abs(descent)
        if not is_beyond.any():
            break
        fraction = np.where(is_beyond, fraction / 2, fraction)
    is_stuck = is_beyond | ~(descent > 0) | is_balanced[..., None]
    fraction = np.where(is_stuck, 0.0, fraction)
    return positions + fraction * step, np.where(is_stuck, forces, new_forces)
