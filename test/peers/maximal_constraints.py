"""Constraints of joints and closed loops on bodies with six coordinates each.

Everything is in the world. A body's coordinates are the position of its frame's origin and its orientation; its
velocity is [v; ω] and its acceleration the time derivative [v̇; ω̇].
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.model.vector_product import skew


class Rows(NamedTuple):
    """Second derivatives of some quantities: coefficients (m, 6 · bodies) times all accelerations, plus bias (m,).

    The same coefficients times all velocities are their first derivatives.
    """

    coefficients: np.ndarray
    bias: np.ndarray

    def times(self, matrix):
        """Rows of the quantities `matrix` (k, m) times these."""
        return Rows(matrix @ self.coefficients, matrix @ self.bias)

    def __sub__(self, other):
        return Rows(self.coefficients - other.coefficients, self.bias - other.bias)


def stacked(rows):
    return Rows(np.vstack([part.coefficients for part in rows]), np.concatenate([part.bias for part in rows]))


class Handle(NamedTuple):
    """A frame fixed to a body: number of the body and of all bodies, origin (3,) of the body, and the frame itself,
    rotation (3, 3) and position (3,); velocity (6,) of the body."""

    body: int
    bodies: int
    origin: np.ndarray
    rotation: np.ndarray
    position: np.ndarray
    velocity: np.ndarray

    @property
    def arm(self):
        return self.position - self.origin

    @property
    def spin(self):
        return self.velocity[3:]

    @property
    def point_velocity(self):
        return self.velocity[:3] + np.cross(self.spin, self.arm)

    def _rows(self, block, bias):
        coefficients = np.zeros((len(block), 6 * self.bodies))
        coefficients[:, 6 * self.body : 6 * self.body + 6] = block
        return Rows(coefficients, bias)

    def point(self):
        """The three rows of the frame's origin: p̈ = v̇ + ω̇ × r + ω × (ω × r)."""
        block = np.hstack([np.eye(3), -skew(self.arm)])
        return self._rows(block, np.cross(self.spin, np.cross(self.spin, self.arm)))

    def turning(self):
        """The three rows of the angular acceleration."""
        return self._rows(np.hstack([np.zeros((3, 3)), np.eye(3)]), np.zeros(3))

    def seen(self, axes, vector, rate):
        """Rows (m) that rotating axes (m, 3), fixed to this body, add to the second derivative of axes · vector.

        For e fixed to the body, d²/dt² (e·u) = e·ü + 2 (ω × e)·u̇ + (ω̇ × e + ω × (ω × e))·u.
        """
        block = np.hstack([np.zeros((len(axes), 3)), np.cross(axes, vector)])
        turned = np.cross(self.spin, axes)
        return self._rows(block, 2 * turned @ rate + np.cross(self.spin, turned) @ vector)


def coincidence(a, b):
    """Three rows: the origins of Handles a and b coincide."""
    return b.point() - a.point()


def weld(a, b):
    """Six rows: the frames of Handles a and b coincide whole."""
    return stacked([coincidence(a, b), b.turning() - a.turning()])


def projected_shift(a, b, axes):
    """Rows of axes · (p_b − p_a) for axes (m, 3) fixed to the body of Handle a."""
    shift, rate = b.position - a.position, b.point_velocity - a.point_velocity
    parts = (b.point() - a.point()).times(axes), a.seen(axes, shift, rate)
    return Rows(sum(part.coefficients for part in parts), sum(part.bias for part in parts))


def projected_spin(a, b, axes):
    """Rows of axes · (ω_b − ω_a), once more differentiated, for axes (m, 3) fixed to the body of Handle a."""
    rows = (b.turning() - a.turning()).times(axes)
    return Rows(rows.coefficients, np.cross(a.spin, axes) @ (b.spin - a.spin))


def joint_constraint(prismatic, a, b):
    """Five rows: Handle b may rotate about the z axis of Handle a, or slide along it, only."""
    across = a.rotation[:, :2].T
    if prismatic:
        return stacked([projected_shift(a, b, across), b.turning() - a.turning()])
    return stacked([coincidence(a, b), projected_spin(a, b, across)])


def joint_variable(prismatic, a, b):
    """One row: the joint's variable, the angle about the z axis of Handle a or the distance along it."""
    along = a.rotation[:, 2:].T
    return (projected_shift if prismatic else projected_spin)(a, b, along)
