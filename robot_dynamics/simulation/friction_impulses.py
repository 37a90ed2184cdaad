"""Joint friction as impulses at the end of a step: dry friction that sticks, and stiff viscous friction.

Dry friction changes the velocities v* that result from everything else as far as it can: v = v* + W p with |p| ≤ F h.
The impulse p opposes the remaining motion, or is the one that holds the joint at rest. A force F sign(q̇) in explicit
steps would chatter instead. Viscous friction that is too strong for explicit steps is treated here as well, with
p = -Fv h v. Source: J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988 (time stepping).

F is that of the velocity at the start of the step and of the load, Fs + Fst / (1 + (q̇/vs)²) ± Fsa + μ |Γ_l|. The load
Γ_l is that of a joint that slides at the effort of its motor, y / (1 ± μ sign(y)) with y the effort less the rest of
the friction. A joint at rest thus breaks away where the effort that would hold its load without friction differs from
the effort by F at that load: there both loads are equal.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.model.joint_friction import FRICTION_FIELDS
from robot_dynamics.newton_euler.friction import load_friction, loads_from_net_efforts, signs
from robot_dynamics.procedures import as_array, largest, magnitude, procedure, select, solve, zeros

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.model.joint import Joint

BLOCK_EXCHANGES = 8
"""Sets of sticking joints from which joints are exchanged one by one, which ends with the solution."""
MAX_EXCHANGES = 60
"""Sets of sticking joints that are tried before the iteration."""
REGULARIZATION = 1e-15
"""Relative change of the diagonal with which the impulses of all joints can be solved for."""
DEPENDENT_REGULARIZATION = 1e-12
"""The same where joints do not move independently."""
STICKING_RATIO = 1e3
"""Velocity of a joint that sticks, relative to the largest one and to the regularization, at which a solution fails."""
MAX_SWEEPS = 200
CONVERGENCE_TOLERANCE = 1e-12
"""Change in one sweep, relative to the largest impulse, at which the iteration ends."""


@dataclass(frozen=True, eq=False)
class ImpulsiveFriction:
    """Friction of the joints of a robot that acts as impulses during a step of length h.

    Attributes
    ----------
    joints : ndarray, shape (k,)
        Numbers of the joints with such friction.
    frictional_joints : tuple of Joint
        These joints, with all of their friction.
    step : float
        Length of a step h [s].
    viscous_gains, viscous_asymmetries : ndarray, shape (k,)
        Viscous impulses per velocity, Fv h and Fva h; zero where viscous friction is a force.
    """

    joints: IntArray
    frictional_joints: tuple[Joint, ...]
    step: float
    viscous_gains: Array
    viscous_asymmetries: Array

    @cached_property
    def _coefficients(self) -> dict[str, Array]:
        """Numbers (k,) of the friction of the joints, by the name of the field."""
        joints = self.frictional_joints
        coefficients = {field: np.array([getattr(joint, field) for joint in joints]) for field in FRICTION_FIELDS}
        has_stribeck_curve = coefficients["stribeck_friction"] != 0
        coefficients["stribeck_velocity"] = np.where(has_stribeck_curve, coefficients["stribeck_velocity"], 1.0)
        return coefficients

    @cached_property
    def constant_limits(self) -> tuple[Array, Array] | None:
        """Lowest and highest impulse (k,) of dry friction; None where they depend on velocities or loads."""
        if any(joint.stribeck_friction or joint.load_friction for joint in self.frictional_joints):
            return None
        dry = self._coefficients["coulomb_friction"]
        asymmetry = self._coefficients["coulomb_asymmetry"]
        return -self.step * (dry + asymmetry), self.step * (dry - asymmetry)

    def limits(self, velocities: Any, efforts: Any) -> tuple[Any, Any]:
        """Lowest and highest impulse (k,) [N m s or N s] of dry friction.

        velocities: (k,) at the start of the step; efforts: (k,) of the motors, read where friction depends on the load.
        """
        if self.constant_limits is not None:
            return self.constant_limits
        numbers = self._coefficients
        ratios = velocities / numbers["stribeck_velocity"]
        dry = numbers["coulomb_friction"] + numbers["stribeck_friction"] / (1 + ratios * ratios)
        viscous = numbers["viscous_friction"] * velocities + numbers["viscous_asymmetry"] * magnitude(velocities)
        limits = []
        for direction in (1.0, -1.0):
            friction = dry + direction * numbers["coulomb_asymmetry"]
            net_efforts = efforts - viscous - direction * friction
            directions = np.full(len(friction), direction)
            loads = loads_from_net_efforts(self.frictional_joints, directions, net_efforts)
            friction_of_loads = load_friction(self.frictional_joints, directions, loads)
            limits.append(-self.step * (direction * friction + friction_of_loads))
        return limits[0], limits[1]

    @procedure
    def apply(
        self, response: Any, joint_shares: Any, velocities: Any, applied_impulses: Any, limits: tuple[Any, Any]
    ) -> Any:
        """Impulses (k,) of friction, and the change (m,) of all rates by those that the rates do not contain yet.

        response (m, k): change of all rates for unit impulses; joint_shares (n, k): velocities of the joints for unit
        rates, which are the last n of m; velocities (k,) of the joints; applied_impulses (k,): those that the rates
        contain already; limits: lowest and highest impulse (k,) of dry friction.
        """
        W = joint_shares.T @ response[len(response) - len(joint_shares) :]
        velocities = velocities - W @ applied_impulses
        viscous_gains = self.viscous_gains
        if self.viscous_asymmetries.any():
            viscous_gains = viscous_gains + self.viscous_asymmetries * signs(velocities)
        is_dependent = joint_shares.shape[1] > joint_shares.shape[0]
        impulses = friction_impulses(W, velocities, limits, viscous_gains, is_dependent)
        return impulses, response @ (impulses - applied_impulses)


@procedure
def friction_impulses(
    W: Any, velocities: Any, limits: tuple[Any, Any], viscous: Any, is_dependent: bool = False
) -> Any:
    """Impulses p (k,) [N m s or N s] of friction.

    W (k, k): change of the velocities (k,) for unit impulses; limits: lowest and highest impulse (k,) of dry friction;
    viscous (k,): Fv h; is_dependent: whether there are more joints than coordinates.

    Where all joints continue to slide, their limits are the solution. Otherwise the joints that stick are searched for;
    Gauss-Seidel iterations follow where the search fails.
    """
    size = len(velocities)
    right_side = np.concatenate([velocities[:, None], W], axis=1)
    damped = solve(np.eye(size) + W * viscous, right_side)
    damped_velocities = damped[:, 0]
    damped_W = damped[:, 1:]
    impulses = _dry_impulses(damped_W, damped_velocities, *limits, is_dependent)
    return impulses - viscous * (damped_velocities + damped_W @ impulses)


@procedure
def _dry_impulses(W: Any, velocities: Any, lowest: Any, highest: Any, is_dependent: bool) -> Any:
    """Impulses (k,) within the limits (k,) that bring the joints to rest or oppose their motion."""
    size = len(velocities)
    sliding = [select(velocities[k] > 0, lowest[k], select(velocities[k] < 0, highest[k], 0.0)) for k in range(size)]
    impulses = as_array(np.array(sliding))
    if not largest(-((velocities + W @ impulses) * velocities)) <= 0:
        tolerance = CONVERGENCE_TOLERANCE * largest(np.concatenate([highest, -lowest]))
        W, velocities = as_array(W), as_array(velocities)
        lowest, highest = as_array(lowest), as_array(highest)
        regularization = DEPENDENT_REGULARIZATION if is_dependent else REGULARIZATION
        solution, is_solved = _exchange_sticking_joints(
            W, velocities, lowest, highest, impulses, tolerance, regularization
        )
        if is_solved:
            impulses = solution
        else:
            impulses = _relax(W, velocities, lowest, highest, impulses, tolerance)
    return impulses


@procedure
def _exchange_sticking_joints(
    W: Any,
    velocities: Any,
    lowest: Any,
    highest: Any,
    sliding_impulses: Any,
    tolerance: Any,
    regularization: float,
) -> Any:
    """Impulses (k,) by solving for the joints that stick, and whether the joints that stick were found.

    All joints that violate a condition change at once between sticking and sliding; later one at a time. Source: J. J.
    Júdice and F. M. Pires, A block principal pivoting algorithm for large-scale strictly monotone linear
    complementarity problems, Computers and Operations Research 21 (1994).
    """
    size = len(velocities)
    directions = zeros(size)  # of the impulses: -1 and 1 at the limits, 0 where a joint sticks
    for k in range(size):
        velocity = velocities[k] + W[k] @ sliding_impulses
        opposite = select(velocity > 0, -1.0, 1.0)
        directions[k] = select(velocity * velocities[k] > 0, opposite, 0.0)
    impulses = as_array(sliding_impulses)
    accuracy = STICKING_RATIO * regularization * largest(magnitude(velocities))
    is_solved: Any = False
    for exchange in range(MAX_EXCHANGES):
        rows = zeros(size, size)
        right_side = zeros(size, 1)
        for k in range(size):
            if directions[k] == 0:
                rows[k] = W[k]
                rows[k, k] = (1 + regularization) * W[k, k]
                right_side[k, 0] = -velocities[k]
            else:
                rows[k, k] = 1.0
                right_side[k, 0] = select(directions[k] < 0, lowest[k], highest[k])
        impulses = as_array(solve(rows, right_side)[:, 0])
        is_solved = True
        is_exact: Any = True
        for k in range(size):
            velocity = velocities[k] + W[k] @ impulses
            direction = directions[k]
            if direction == 0:
                is_exact = is_exact & (magnitude(velocity) <= accuracy + tolerance * W[k, k])
                direction = select(impulses[k] > highest[k] + tolerance, 1.0, direction)
                direction = select(impulses[k] < lowest[k] - tolerance, -1.0, direction)
            else:
                direction = select(velocity * direction > tolerance * W[k, k], 0.0, direction)
            can_change = is_solved | (exchange < BLOCK_EXCHANGES)
            is_solved = is_solved & (direction == directions[k])
            directions[k] = select(can_change, direction, directions[k])
        is_solved = is_solved & is_exact
        if is_solved:
            break
    return impulses, is_solved


@procedure
def _relax(W: Any, velocities: Any, lowest: Any, highest: Any, impulses: Any, tolerance: Any) -> Any:
    """Impulses (k,) by Gauss-Seidel iterations with projection onto the limits, from given ones."""
    size = len(velocities)
    impulses = as_array(impulses)
    for _ in range(MAX_SWEEPS):
        change = 0.0
        for k in range(size):
            previous = impulses[k]
            sticking = previous - (velocities[k] + W[k] @ impulses) / W[k, k]
            raised = select(sticking > lowest[k], sticking, lowest[k])
            impulses[k] = select(raised < highest[k], raised, highest[k])
            change = select(magnitude(impulses[k] - previous) > change, magnitude(impulses[k] - previous), change)
        if change <= tolerance:
            break
    return impulses
