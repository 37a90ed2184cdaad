"""Random walks over the closed positions of a robot with loops: the constraint manifold e(q) = 0.

A stride follows a tangent of the manifold in all joints alike, and steps of least length lead back to the manifold. So
a walk passes dead points of motors, and all positions at which the independent joints do not determine the others.
Other branches begin where the rank of the loop equations falls. Strides become as short as the distance to such a
position, so that none crosses it into another branch.

Source: Rheinboldt, "On the computation of multi-dimensional solution manifolds of parametrized equations" (1988).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.constraints.loop_equations import RANK_TOLERANCE, loop_equations
from robot_dynamics.constraints.newton_iteration import CLOSURE_TOLERANCE
from robot_dynamics.constraints.topology import build_topology

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot

WALKERS = 16
"""Walks at the same time."""
STRIDES_PER_WALKER = 60
MAX_STRIDE = 0.3
"""Longest stride [rad or characteristic lengths]."""
MAX_PART_OF_DISTANCE = 0.4
"""Longest stride, as a part of the distance to where the rank falls."""
MIN_STRIDE = 1e-3
"""Stride below which the walk changes its direction."""
SINGULAR_RATIO = 1e-3
"""Least singular value, as a part of that at the start, of positions that a walk reaches."""
MAX_RELATIVE_DEVIATION = 0.3
"""Part of a stride by which the manifold may deviate from its end."""
RANDOM_TURN = 0.3
"""Random part of the next direction, where there are several."""
CHORD_STEPS = 3
"""Steps back to the manifold with the Jacobian of the last position."""
NEWTON_STEPS = 3
"""Further steps, each with its own Jacobian."""


class Tangent(NamedTuple):
    """Tangent of the manifold at positions t (N, m), in joint units.

    Attributes
    ----------
    basis : ndarray, shape (N, m, n)
        Orthonormal columns along the manifold.
    pseudo_inverse : ndarray, shape (N, m, rows)
        Of the Jacobian.
    least_singular_value : ndarray, shape (N,)
        Least singular value of the Jacobian within its rank.
    """

    basis: Array
    pseudo_inverse: Array
    least_singular_value: Array


@dataclass(frozen=True, eq=False)
class ConstraintManifold:
    """Closed positions q = S t + offset of all joints of a ConstraintTopology: e(q) = 0.

    Attributes
    ----------
    topology : ConstraintTopology
    units : ndarray, shape (m,)
        Change of each joint t that counts as one radian [rad or m].
    lower, upper : ndarray, shape (joints,)
        Limits of positions.
    rank : int
        Of the loop equations.
    """

    topology: ConstraintTopology
    units: Array
    lower: Array
    upper: Array
    rank: int

    def joint_positions(self, t: Array) -> Array:
        """Positions (N, joints) of all joints."""
        return self.topology.joint_positions(t)

    def tangent(self, t: Array) -> Tangent:
        """The Tangent at positions t (N, m)."""
        J = loop_equations(self.topology.robot, self.joint_positions(t)).jacobian @ self.topology.S * self.units
        U, s, Vt = np.linalg.svd(np.nan_to_num(J, posinf=0, neginf=0))
        r = self.rank
        V = np.swapaxes(Vt, -1, -2)
        pseudo_inverse = V[..., :r] / np.maximum(s[:, None, :r], 1e-300) @ np.swapaxes(U[..., :r], -1, -2)
        return Tangent(V[..., r:], pseudo_inverse, s[:, r - 1])

    def random_walks(self, rng: np.random.Generator) -> Array:
        """(WALKERS * STRIDES_PER_WALKER, m) positions t on random walks from the reference positions."""
        with np.errstate(all="ignore"):  # strides to positions without a finite residual are not taken
            t = np.tile(self.topology.reference_positions, (WALKERS, 1))
            tangent = self.tangent(t)
            min_singular_value = SINGULAR_RATIO * tangent.least_singular_value
            fractions = np.ones(WALKERS)
            directions = _random_directions(tangent, rng)
            visited = []
            for _ in range(STRIDES_PER_WALKER):
                strides = fractions * _max_stride(tangent)
                end, is_reached = self._stride(t, tangent, strides[:, None] * directions)
                end_tangent = self.tangent(np.where(is_reached[:, None], end, t))
                is_reached &= end_tangent.least_singular_value > min_singular_value
                t = np.where(is_reached[:, None], end, t)
                tangent = _select(is_reached, end_tangent, tangent)
                visited.append(t)
                fractions = np.where(is_reached, np.minimum(1.0, 2 * fractions), fractions / 4)
                is_turning = fractions * _max_stride(tangent) < MIN_STRIDE
                fractions = np.where(is_turning, 1.0, fractions)
                new_directions = _random_directions(tangent, rng)
                directions = np.where(is_turning[:, None], new_directions, _turn(tangent, directions, rng))
        return np.concatenate(visited)

    def _stride(self, t: Array, tangent: Tangent, step: Array) -> tuple[Array, BoolArray]:
        """Positions (N, m) on the manifold near t + step.

        Also returns (N,) whether these are on the manifold, near the end of the step and within limits.
        """
        end = t + step * self.units
        for _ in range(CHORD_STEPS):
            end = end - self._correction(tangent.pseudo_inverse, self._residual(end))
        residual = self._residual(end)
        for _ in range(NEWTON_STEPS):
            size = np.abs(residual).max(axis=-1)
            is_open = (size > 1e-2 * CLOSURE_TOLERANCE) & (size < 1)
            if not is_open.any():
                break
            end[is_open] -= self._correction(self.tangent(end[is_open]).pseudo_inverse, residual[is_open])
            residual[is_open] = self._residual(end[is_open])
        deviation = np.linalg.norm((end - t) / self.units - step, axis=-1)
        is_near = deviation < MAX_RELATIVE_DEVIATION * np.linalg.norm(step, axis=-1)
        is_closed = np.abs(residual).max(axis=-1) <= CLOSURE_TOLERANCE
        q = self.joint_positions(end)
        is_within_limits = ((q >= self.lower) & (q <= self.upper)).all(axis=-1)
        return end, is_closed & is_near & is_within_limits

    def _residual(self, t: Array) -> Array:
        """Residual (N, rows) at positions t (N, m)."""
        return loop_equations(self.topology.robot, self.joint_positions(t)).residual

    def _correction(self, pseudo_inverse: Array, residual: Array) -> Array:
        """Displacement (N, m) of least length that a residual (N, rows) belongs to."""
        correction: Array = np.nan_to_num((pseudo_inverse @ residual[..., None])[..., 0]) * self.units
        return correction


def build_constraint_manifold(robot: Robot) -> ConstraintManifold:
    """The ConstraintManifold of a robot with loops, within the limits of all its joints.

    Raises DescriptionError where the loops cannot be closed.
    """
    topology = build_topology(robot)
    q = topology.joint_positions(topology.reference_positions)
    lower, upper = np.array([(joint.limits.lower, joint.limits.upper) for joint in robot.joints]).T
    J = loop_equations(robot, q).jacobian @ topology.S * topology.column_units
    s = np.linalg.svd(J, compute_uv=False)
    rank = int((s > RANK_TOLERANCE * s[0]).sum())
    return ConstraintManifold(topology, topology.column_units, np.minimum(lower, q), np.maximum(upper, q), rank)


def _max_stride(tangent: Tangent) -> Array:
    """(N,) longest stride at a tangent."""
    return np.minimum(MAX_STRIDE, MAX_PART_OF_DISTANCE * tangent.least_singular_value)


def _select(is_reached: BoolArray, end: Tangent, start: Tangent) -> Tangent:
    """The Tangent at the end for walkers that reached it, at the start for the others."""
    return Tangent(
        *(
            np.where(is_reached.reshape(-1, *[1] * (new.ndim - 1)), new, old)
            for new, old in zip(end, start, strict=True)
        )
    )


def _random_directions(tangent: Tangent, rng: np.random.Generator) -> Array:
    """(N, m) random unit vectors along the manifold."""
    walkers, _, n = tangent.basis.shape
    return _normalize((tangent.basis @ rng.normal(size=(walkers, n, 1)))[..., 0])


def _turn(tangent: Tangent, directions: Array, rng: np.random.Generator) -> Array:
    """(N, m) unit vectors along the manifold that continue directions (N, m), turned at random where possible."""
    components = np.swapaxes(tangent.basis, -1, -2) @ directions[..., None]
    if components.shape[1] > 1:
        components = components + RANDOM_TURN * rng.normal(size=components.shape) / np.sqrt(components.shape[1])
    return _normalize((tangent.basis @ components)[..., 0])


def _normalize(vectors: Array) -> Array:
    """Unit vectors (N, m)."""
    unit: Array = vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
    return unit
