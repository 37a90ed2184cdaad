"""Modified Denavit-Hartenberg parameters: six numbers a frame, and the placement they stand for (Khalil, section 2).

    iTj = Rot(z, γ) Trans(z, b) Rot(x, α) Trans(x, d) Rot(z, θ) Trans(z, r)

The placement is the truth, the numbers a way to write it. Any placement can be written: the angles are Euler angles
z-x-z, and with n the common normal of z_i and z_j, γ turns x_i onto n, b moves along z_i to n, d along n to z_j, and
θ and r go on along z_j. Where the axes are nearly parallel their normal is far away, b and r are huge and cancel each
other; written as two rows, a fixed frame that translates and a rotation about its origin, nothing is lost.
"""

import math
from typing import NamedTuple

import numpy as np

from robot_dynamics.model.placement import placement

ROUNDING = 2e-15  # angles [rad] and lengths [m] below this are rounding
# [rad] at this angle the common normal is fifty times as far away as the axes are apart; an inertia about an origin
# there would lose the square of it, three digits of sixteen
NEARLY_PARALLEL = 0.02


class MDHParameters(NamedTuple):
    """One row of an MDH table: angles [rad], lengths [m]. The joint variable is zero; it adds to θ or to r."""

    gamma: float = 0.0
    b: float = 0.0
    alpha: float = 0.0
    d: float = 0.0
    theta: float = 0.0
    r: float = 0.0


def placement_from_mdh(row):
    """iTj (4, 4) of a Row."""
    rotation = _about_z(row.gamma) @ _about_x(row.alpha)
    c, s = cosine_sine(row.alpha)
    translation = _about_z(row.gamma) @ np.array([row.d, -row.r * s, row.b + row.r * c])
    return placement(rotation @ _about_z(row.theta), translation)


def mdh_from_placement(matrix):
    """The Rows, one or two, whose placements multiply to `matrix`, iTj (4, 4).

    Where there is a choice γ is within a right angle of zero, and b is zero.
    """
    R, P = matrix[:3, :3], matrix[:3, 3]
    sine = math.hypot(R[0, 2], R[1, 2])
    if sine < 2 * ROUNDING:
        return [_parallel(R, P)]
    if sine < NEARLY_PARALLEL and np.abs(P).max() > ROUNDING:
        gamma, d = _folded(P[1], P[0])
        offset = MDHParameters(gamma=gamma, b=clean_length(P[2]), d=d)
        return [offset, *mdh_from_placement(placement(_about_z(-gamma) @ R))]
    gamma = _angle_in_half_turn(R[0, 2], -R[1, 2])
    toward = _about_z(-gamma) @ R[:, 2]  # (0, -sin α, cos α)
    alpha = clean_angle(math.atan2(-toward[1], toward[2]))
    x, y, z = _about_z(-gamma) @ P
    c, s = cosine_sine(alpha)
    r = clean_length(-y / s)
    return [MDHParameters(gamma, clean_length(z - r * c), alpha, clean_length(x), _theta(R, gamma, alpha), r)]


def _parallel(R, P):
    """The Row of axes that are parallel, or opposite."""
    alpha = 0.0 if R[2, 2] > 0 else math.pi
    gamma, d = _folded(P[1], P[0])
    return MDHParameters(gamma, 0.0, alpha, d, _theta(R, gamma, alpha), clean_length(P[2] if alpha == 0 else -P[2]))


def _theta(R, gamma, alpha):
    turned = _about_x(-alpha) @ _about_z(-gamma) @ R
    return clean_angle(math.atan2(turned[1, 0], turned[0, 0]))


def _folded(y, x):
    """(γ, d) with d·(cos γ, sin γ) = (x, y), γ within a right angle of zero."""
    distance = math.hypot(x, y)
    if distance < ROUNDING:
        return 0.0, 0.0
    gamma = _angle_in_half_turn(y, x)
    c, s = cosine_sine(gamma)
    return gamma, float(c * x + s * y)


def _angle_in_half_turn(y, x):
    """The angle in (-π/2, π/2] of a line in the direction (x, y) or against it."""
    angle = clean_angle(math.atan2(y, x))
    if angle > math.pi / 2:
        angle -= math.pi
    elif angle <= -math.pi / 2:
        angle += math.pi
    return clean_angle(angle)


def clean_angle(angle):
    """The angle [rad], an exact multiple of π/4 where it is one but for rounding."""
    nearest = round(angle / (math.pi / 4)) * (math.pi / 4)
    return nearest if abs(angle - nearest) < ROUNDING else angle


def clean_length(length):
    """The length [m], zero where it is rounding."""
    return float(length) if abs(length) > ROUNDING else 0.0


def cosine_sine(angle):
    """Cosine and sine, exactly 0 and ±1 at the floating-point multiples of a right angle."""
    c, s = math.cos(angle), math.sin(angle)
    if abs(c) < 1e-15:
        return 0.0, math.copysign(1.0, s)
    if abs(s) < 1e-15:
        return math.copysign(1.0, c), 0.0
    return c, s


def _about_z(angle):
    c, s = cosine_sine(angle)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def _about_x(angle):
    c, s = cosine_sine(angle)
    return np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
