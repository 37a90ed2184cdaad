"""Closed configurations of a robot with loops from the whole range that it reaches: walks on the manifold e(q) = 0.

A stride goes along a tangent of the manifold, in all joints alike, and is brought back to it by steps of least length:
so a walk passes dead points of motors, and all positions at which the independent joints do not place the others.
Where the rank of the loops' equations falls, other branches begin. Strides become as short as the way to such a
position, so that none leads across it into another branch.

Source: Rheinboldt, "On the computation of multi-dimensional solution manifolds of parametrized equations" (1988).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.constraints.mobility import CLOSURE_TOLERANCE, RANK_TOLERANCE
from robot_dynamics.constraints.topology import build_topology

WALKERS = 16  # that walk side by side
STRIDES_PER_WALKER = 60  # of each
MAX_STRIDE = 0.3  # [rad or characteristic lengths] the longest
MAX_PART_OF_DISTANCE = 0.4  # of the way to where the rank falls, that a stride may take
MIN_STRIDE = 1e-3  # stride: before it is shorter the walk turns
SINGULAR_RATIO = 1e-3  # part of the least singular value at the beginning: where it is less no walk leads
MAX_RELATIVE_DEVIATION = 0.3  # of a stride: how far beside its end the manifold may be
RANDOM_TURN = 0.3  # of a direction that is random, where there are many
CHORD_STEPS = 3  # back to the manifold with the Jacobian of the position before
NEWTON_STEPS = 3  # and with its own


class Tangent(NamedTuple):
    """The manifold at positions t (N, m), joints counted in units of `reach`.

    basis: (N, m, n) orthonormal columns along it; inverse: (N, m, rows) pseudo-inverse of the Jacobian; least: (N,) its
    least singular value that is not zero everywhere.
    """

    basis: np.ndarray
    pseudo_inverse: np.ndarray
    least_singular_value: np.ndarray


@dataclass(frozen=True, eq=False)
class ConstraintManifold:
    """The closed configurations of a Coupling: positions q = S t + offset of all joints with e(q) = 0.

    reach (m,): what counts as a radian of each of the joints t; lower, upper (joints,): limits of positions; rank: of
    the loops' equations.
    """

    topology: object
    units: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rank: int

    def joint_positions(self, t):
        """(N, joints) of all joints."""
        return t @ self.topology.S.T + self.topology.offset

    def tangent(self, t):
        """The Tangent at positions t (N, m)."""
        J = loop_equations(self.topology.robot, self.joint_positions(t)).jacobian @ self.topology.S * self.units
        U, s, Vt = np.linalg.svd(np.nan_to_num(J, posinf=0, neginf=0))
        r = self.rank
        V = np.swapaxes(Vt, -1, -2)
        pseudo_inverse = V[..., :r] / np.maximum(s[:, None, :r], 1e-300) @ np.swapaxes(U[..., :r], -1, -2)
        return Tangent(V[..., r:], pseudo_inverse, s[:, r - 1])

    def random_walks(self, rng):
        """(WALKERS * STRIDES, m) positions t on random walks from where the loops are known to be closed."""
        with np.errstate(all="ignore"):  # positions without a finite residual are not gone to
            t = np.tile(self.topology.reference_positions, (WALKERS, 1))
            here, passed = self.tangent(t), []
            regular, shares = SINGULAR_RATIO * here.least_singular_value, np.ones(WALKERS)
            directions = _directions(here, rng)
            for _ in range(STRIDES_PER_WALKER):
                lengths = shares * np.minimum(MAX_STRIDE, MAX_PART_OF_DISTANCE * here.least_singular_value)
                there, reached = self._stride(t, here, lengths[:, None] * directions)
                ahead = self.tangent(np.where(reached[:, None], there, t))
                reached &= ahead.least_singular_value > regular
                t, here = np.where(reached[:, None], there, t), _chosen(reached, ahead, here)
                passed.append(t)
                shares = np.where(reached, np.minimum(1.0, 2 * shares), shares / 4)
                turning = shares * np.minimum(MAX_STRIDE, MAX_PART_OF_DISTANCE * here.least_singular_value) < MIN_STRIDE
                shares = np.where(turning, 1.0, shares)
                directions = np.where(turning[:, None], _directions(here, rng), _onwards(here, directions, rng))
        return np.concatenate(passed)

    def _stride(self, t, here, step):
        """(positions (N, m) on the manifold beside t + step, (N,) whether they are there, near the end of the step and
        within limits)."""
        there = t + step * self.units
        for _ in range(CHORD_STEPS):
            there = there - self._back(here.pseudo_inverse, self._residual(there))
        residual = self._residual(there)
        for _ in range(NEWTON_STEPS):
            size = np.abs(residual).max(axis=-1)
            open_ = (size > 1e-2 * CLOSURE_TOLERANCE) & (size < 1)
            if not open_.any():
                break
            there[open_] -= self._back(self.tangent(there[open_]).pseudo_inverse, residual[open_])
            residual[open_] = self._residual(there[open_])
        beside = np.linalg.norm((there - t) / self.units - step, axis=-1)
        near, q = beside < MAX_RELATIVE_DEVIATION * np.linalg.norm(step, axis=-1), self.joint_positions(there)
        closed = np.abs(residual).max(axis=-1) <= CLOSURE_TOLERANCE
        return there, closed & near & ((q >= self.lower) & (q <= self.upper)).all(axis=-1)

    def _residual(self, t):
        return loop_equations(self.topology.robot, self.joint_positions(t)).residual

    def _back(self, pseudo_inverse, residual):
        return np.nan_to_num((pseudo_inverse @ residual[..., None])[..., 0]) * self.units


def build_constraint_manifold(robot):
    """The ClosedManifold of a robot with loops, within the limits of all its joints.

    Raises DescriptionError where the loops cannot be closed.
    """
    closed = build_topology(robot)
    unit = robot.characteristic_length
    units = np.array([unit if robot.joints[number].prismatic else 1.0 for number in closed.non_mimic_joints])
    q = closed.S @ closed.reference_positions + closed.offset
    lower, upper = np.array([(joint.limits.lower, joint.limits.upper) for joint in robot.joints]).T
    s = np.linalg.svd(loop_equations(robot, q).jacobian @ closed.S * units, compute_uv=False)
    return ConstraintManifold(
        closed, units, np.minimum(lower, q), np.maximum(upper, q), int((s > RANK_TOLERANCE * s[0]).sum())
    )


def _chosen(reached, ahead, here):
    """The Tangent of those walkers that reached their end, ahead, and of the others, here."""
    return Tangent(*(np.where(reached.reshape(-1, *[1] * (new.ndim - 1)), new, old)
                     for new, old in zip(ahead, here, strict=True)))  # fmt: skip


def _directions(here, rng):
    """(N, m) random unit vectors along the manifold."""
    walkers, _, n = here.basis.shape
    return _unit((here.basis @ rng.normal(size=(walkers, n, 1)))[..., 0])


def _onwards(here, directions, rng):
    """(N, m) unit vectors along the manifold that go on as directions (N, m) do, and swerve where there is room."""
    along = np.swapaxes(here.basis, -1, -2) @ directions[..., None]
    if along.shape[1] > 1:
        along = along + RANDOM_TURN * rng.normal(size=along.shape) / np.sqrt(along.shape[1])
    return _unit((here.basis @ along)[..., 0])


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
