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

from robot_dynamics.newton_euler.coupling import coupling
from robot_dynamics.newton_euler.loops import loop_equations
from robot_dynamics.newton_euler.mobility import CLOSES, RANK

WALKERS = 16  # that walk side by side
STRIDES = 60  # of each
STRIDE = 0.3  # [rad or characteristic lengths] the longest
NEAR = 0.4  # of the way to where the rank falls, that a stride may take
SHORTEST = 1e-3  # stride: before it is shorter the walk turns
SINGULAR = 1e-3  # part of the least singular value at the beginning: where it is less no walk leads
BESIDE = 0.3  # of a stride: how far beside its end the manifold may be
SWERVE = 0.3  # of a direction that is random, where there are many
CHORD_STEPS = 3  # back to the manifold with the Jacobian of the position before
NEWTON_STEPS = 3  # and with its own


class Tangent(NamedTuple):
    """The manifold at positions t (N, m), joints counted in units of `reach`.

    basis: (N, m, n) orthonormal columns along it; inverse: (N, m, rows) pseudo-inverse of the Jacobian; least: (N,) its
    least singular value that is not zero everywhere.
    """

    basis: np.ndarray
    inverse: np.ndarray
    least: np.ndarray


@dataclass(frozen=True, eq=False)
class ClosedManifold:
    """The closed configurations of a Coupling: positions q = S t + offset of all joints with e(q) = 0.

    reach (m,): what counts as a radian of each of the joints t; lower, upper (joints,): limits of positions; rank: of
    the loops' equations.
    """

    coupling: object
    reach: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rank: int

    def positions(self, t):
        """(N, joints) of all joints."""
        return t @ self.coupling.S.T + self.coupling.offset

    def tangent(self, t):
        """The Tangent at positions t (N, m)."""
        J = loop_equations(self.coupling.robot, self.positions(t)).jacobian @ self.coupling.S * self.reach
        U, s, Vt = np.linalg.svd(np.nan_to_num(J, posinf=0, neginf=0))
        r = self.rank
        V = np.swapaxes(Vt, -1, -2)
        inverse = V[..., :r] / np.maximum(s[:, None, :r], 1e-300) @ np.swapaxes(U[..., :r], -1, -2)
        return Tangent(V[..., r:], inverse, s[:, r - 1])

    def walks(self, chance):
        """(WALKERS * STRIDES, m) positions t on random walks from where the loops are known to be closed."""
        with np.errstate(all="ignore"):  # positions without a finite residual are not gone to
            t = np.tile(self.coupling.closed, (WALKERS, 1))
            here, passed = self.tangent(t), []
            regular, shares = SINGULAR * here.least, np.ones(WALKERS)
            directions = _directions(here, chance)
            for _ in range(STRIDES):
                lengths = shares * np.minimum(STRIDE, NEAR * here.least)
                there, reached = self._stride(t, here, lengths[:, None] * directions)
                ahead = self.tangent(np.where(reached[:, None], there, t))
                reached &= ahead.least > regular
                t, here = np.where(reached[:, None], there, t), _chosen(reached, ahead, here)
                passed.append(t)
                shares = np.where(reached, np.minimum(1.0, 2 * shares), shares / 4)
                turning = shares * np.minimum(STRIDE, NEAR * here.least) < SHORTEST
                shares = np.where(turning, 1.0, shares)
                directions = np.where(turning[:, None], _directions(here, chance), _onwards(here, directions, chance))
        return np.concatenate(passed)

    def _stride(self, t, here, step):
        """(positions (N, m) on the manifold beside t + step, (N,) whether they are there, near the end of the step and
        within limits)."""
        there = t + step * self.reach
        for _ in range(CHORD_STEPS):
            there = there - self._back(here.inverse, self._residual(there))
        residual = self._residual(there)
        for _ in range(NEWTON_STEPS):
            size = np.abs(residual).max(axis=-1)
            open_ = (size > 1e-2 * CLOSES) & (size < 1)
            if not open_.any():
                break
            there[open_] -= self._back(self.tangent(there[open_]).inverse, residual[open_])
            residual[open_] = self._residual(there[open_])
        beside = np.linalg.norm((there - t) / self.reach - step, axis=-1)
        near, q = beside < BESIDE * np.linalg.norm(step, axis=-1), self.positions(there)
        closed = np.abs(residual).max(axis=-1) <= CLOSES
        return there, closed & near & ((q >= self.lower) & (q <= self.upper)).all(axis=-1)

    def _residual(self, t):
        return loop_equations(self.coupling.robot, self.positions(t)).residual

    def _back(self, inverse, residual):
        return np.nan_to_num((inverse @ residual[..., None])[..., 0]) * self.reach


def closed_manifold(robot):
    """The ClosedManifold of a robot with loops, within the limits of all its joints.

    Raises DescriptionError where the loops cannot be closed.
    """
    closed = coupling(robot)
    unit = robot.characteristic_length
    reach = np.array([unit if robot.joints[number].prismatic else 1.0 for number in closed.free])
    q = closed.S @ closed.closed + closed.offset
    lower, upper = np.array([(joint.limits.lower, joint.limits.upper) for joint in robot.joints]).T
    s = np.linalg.svd(loop_equations(robot, q).jacobian @ closed.S * reach, compute_uv=False)
    return ClosedManifold(closed, reach, np.minimum(lower, q), np.maximum(upper, q), int((s > RANK * s[0]).sum()))


def _chosen(reached, ahead, here):
    """The Tangent of those walkers that reached their end, ahead, and of the others, here."""
    return Tangent(*(np.where(reached.reshape(-1, *[1] * (new.ndim - 1)), new, old)
                     for new, old in zip(ahead, here, strict=True)))  # fmt: skip


def _directions(here, chance):
    """(N, m) random unit vectors along the manifold."""
    walkers, _, n = here.basis.shape
    return _unit((here.basis @ chance.normal(size=(walkers, n, 1)))[..., 0])


def _onwards(here, directions, chance):
    """(N, m) unit vectors along the manifold that go on as directions (N, m) do, and swerve where there is room."""
    along = np.swapaxes(here.basis, -1, -2) @ directions[..., None]
    if along.shape[1] > 1:
        along = along + SWERVE * chance.normal(size=along.shape) / np.sqrt(along.shape[1])
    return _unit((here.basis @ along)[..., 0])


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=-1, keepdims=True), 1e-300)
