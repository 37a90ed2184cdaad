"""Rotation vectors within one step: a chart of SO(3) that begins at the attitude where the step begins.

R(t) = R₀ exp(φ̂(t)) with φ = 0 at the beginning of the step. R stays a rotation whatever the integrator makes of φ, and
no quaternion has to be normalised. Source of both formulas: Iserles, Munthe-Kaas, Nørsett and Zanna, Lie-group methods,
Acta Numerica 9 (2000), appendix B.

The functions compute on Python floats, or on symbols: they run several times in each step, where arrays of three
numbers would cost ten times as much. `constraints.attitude_angles.rotation_exponential` is the exponential for batches.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.procedures import procedure

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

MAX_SQUARED_ANGLE = 1e6
"""Squared angle [rad²] beyond which a rotation within one step is meaningless: the integration diverges."""
SERIES_SQUARED_ANGLE = 0.05
"""Squared angle [rad²] below which the series are exact to rounding."""


@procedure
def exponential(phi: Any) -> Any:
    """Rotation matrix (3, 3) of a rotation vector φ (3,) [rad]: I + sin θ/θ φ̂ + (1 - cos θ)/θ² φ̂², θ = |φ|.

    The matrix is nan beyond MAX_SQUARED_ANGLE.
    """
    x, y, z = phi.tolist()
    square = x * x + y * y + z * z
    if not square < MAX_SQUARED_ANGLE:
        s = np.nan
        c = np.nan
    elif square < SERIES_SQUARED_ANGLE:
        s = 1 - square / 6 * (1 - square / 20 * (1 - square / 42 * (1 - square / 72 * (1 - square / 110))))
        c = 0.5 - square / 24 * (1 - square / 30 * (1 - square / 56 * (1 - square / 90 * (1 - square / 132))))
    else:
        angle = np.sqrt(square)
        ratio = np.sin(angle / 2) / angle
        s = np.sin(angle) / angle
        c = 2 * ratio * ratio
    return np.array(
        [
            [1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
            [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
            [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)],
        ]
    )


@procedure
def rotation_vector_rate(phi: Any, omega: Any) -> Any:
    """φ̇ (3,) [rad/s] of R = R₀ exp(φ̂) for the angular velocity ω (3,) in the axes of R.

    φ̇ = ω + φ × ω/2 + k φ × (φ × ω) with k = (1 - θ/2 cot θ/2)/θ²; nan beyond MAX_SQUARED_ANGLE.
    """
    x, y, z = phi.tolist()
    a, b, c = omega.tolist()
    square = x * x + y * y + z * z
    if not square < MAX_SQUARED_ANGLE:
        k = np.nan
    elif square < SERIES_SQUARED_ANGLE:
        k = 1 / 12 + square / 720 * (1 + square / 42 * (1 + square / 40 * (1 + square * 10 / 396)))
    else:
        half = np.sqrt(square) / 2
        k = (1 - half * np.cos(half) / np.sin(half)) / square
    u, v, w = y * c - z * b, z * a - x * c, x * b - y * a
    return [
        a + u / 2 + k * (y * w - z * v),
        b + v / 2 + k * (z * u - x * w),
        c + w / 2 + k * (x * v - y * u),
    ]


def orthonormalize(R: Array) -> Array:
    """R (3, 3) without its rounding errors: one step of Newton's method to the nearest rotation."""
    orthonormal: Array = R @ (1.5 * np.eye(3) - 0.5 * (R.T @ R))
    return orthonormal
