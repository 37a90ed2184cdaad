"""Modified Denavit-Hartenberg parameters: six numbers per frame, and the placement of the frame (Khalil, section 2).

    iTj = Rot(z, γ) Trans(z, b) Rot(x, α) Trans(x, d) Rot(z, θ) Trans(z, r)

The model keeps the placement; the six numbers serve to read and write it. Every placement has such numbers: the angles
are Euler angles z-x-z, and with n the common normal of z_i and z_j, γ turns x_i onto n, b moves along z_i to n, d along
n to z_j, and θ and r continue along z_j. Where the axes are nearly parallel their normal is far away, and b and r are
huge and cancel each other. Two rows, a fixed frame that translates and a rotation about its origin, avoid that loss.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.placement import placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray

ROUNDING = 2e-15  # angles [rad] and lengths [m] below this are rounding errors
# [rad] At this angle the common normal is fifty times as far away as the axes are apart. An inertia about an origin
# there would lose the square of that factor, three digits of sixteen.
NEARLY_PARALLEL = 0.02


class MDHParameters(NamedTuple):
    """One row of an MDH table, at zero joint position: angles [rad], lengths [m]. The joint variable adds to θ or r."""

    gamma: float = 0.0
    b: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    r: float = 0.0


def placement_from_mdh(row: MDHParameters) -> Array:
    """Return iTj (4, 4) of a row of MDH parameters."""
    rotation = _about_z(row.gamma) @ _about_x(row.alpha)
    c, s = cosine_sine(row.alpha)
    translation = _about_z(row.gamma) @ np.array([row.d, -row.r * s, row.b + row.r * c])
    return placement(rotation @ _about_z(row.theta), translation)


def joint_displacement(prismatic: bool, position: float) -> Array:
    """Return the placement (4, 4) by which a joint at a position turns its link about z, or moves it along z."""
    return placement_from_mdh(MDHParameters(r=position) if prismatic else MDHParameters(theta=position))


def mdh_from_placement(matrix: ScalarArray) -> list[MDHParameters]:
    """Return the rows, one or two, whose placements multiply to `matrix`, iTj (4, 4).

    Where the parameters are not unique, γ is within a right angle of zero, and b is zero.
    """
    R, P = matrix[:3, :3], matrix[:3, 3]
    sine = math.hypot(R[0, 2], R[1, 2])
    if sine < 2 * ROUNDING:
        return [_parallel_axes(R, P)]
    if sine < NEARLY_PARALLEL and np.abs(P).max() > ROUNDING:
        gamma, d = _polar_within_half_turn(P[1], P[0])
        offset = MDHParameters(gamma=gamma, b=clean_length(P[2]), d=d)
        return [offset, *mdh_from_placement(placement(_about_z(-gamma) @ R))]
    gamma = _angle_in_half_turn(R[0, 2], -R[1, 2])
    axis = _about_z(-gamma) @ R[:, 2]  # (0, -sin α, cos α)
    alpha = clean_angle(math.atan2(-axis[1], axis[2]))
    x, y, z = _about_z(-gamma) @ P
    c, s = cosine_sine(alpha)
    r = clean_length(-y / s)
    return [MDHParameters(gamma, clean_length(z - r * c), alpha, clean_length(x), _theta(R, gamma, alpha), r)]


def _parallel_axes(R: ScalarArray, P: ScalarArray) -> MDHParameters:
    """Return the row of a rotation (3, 3) and a translation (3,) between axes that are parallel or opposite."""
    alpha = 0.0 if R[2, 2] > 0 else math.pi
    gamma, d = _polar_within_half_turn(P[1], P[0])
    return MDHParameters(gamma, 0.0, alpha, d, _theta(R, gamma, alpha), clean_length(P[2] if alpha == 0 else -P[2]))


def _theta(R: ScalarArray, gamma: float, alpha: float) -> float:
    """Return θ of a rotation (3, 3), from its γ and α."""
    remainder = _about_x(-alpha) @ _about_z(-gamma) @ R
    return clean_angle(math.atan2(remainder[1, 0], remainder[0, 0]))


def _polar_within_half_turn(y: float, x: float) -> tuple[float, float]:
    """Return (γ, d) with d·(cos γ, sin γ) = (x, y), γ within a right angle of zero."""
    distance = math.hypot(x, y)
    if distance < ROUNDING:
        return 0.0, 0.0
    gamma = _angle_in_half_turn(y, x)
    c, s = cosine_sine(gamma)
    return gamma, float(c * x + s * y)


def _angle_in_half_turn(y: float, x: float) -> float:
    """Return the angle in (-π/2, π/2] of the line along (x, y), in either direction."""
    angle = clean_angle(math.atan2(y, x))
    if angle > math.pi / 2:
        angle -= math.pi
    elif angle <= -math.pi / 2:
        angle += math.pi
    return clean_angle(angle)


def clean_angle(angle: float) -> float:
    """Return an angle [rad] without rounding error, where it is a multiple of π/4 but for rounding."""
    nearest = round(angle / (math.pi / 4)) * (math.pi / 4)
    return nearest if abs(angle - nearest) < ROUNDING else angle


def clean_length(length: float) -> float:
    """Return a length [m], zero where it is only rounding."""
    return float(length) if abs(length) > ROUNDING else 0.0


def cosine_sine(angle: float) -> tuple[float, float]:
    """Return cosine and sine, exactly 0 and ±1 at the floating-point multiples of a right angle."""
    c, s = math.cos(angle), math.sin(angle)
    if abs(c) < 1e-15:
        return 0.0, math.copysign(1.0, s)
    if abs(s) < 1e-15:
        return math.copysign(1.0, c), 0.0
    return c, s


def _about_z(angle: float) -> Array:
    """Return the rotation (3, 3) about z."""
    c, s = cosine_sine(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle: float) -> Array:
    """Return the rotation (3, 3) about x."""
    c, s = cosine_sine(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
