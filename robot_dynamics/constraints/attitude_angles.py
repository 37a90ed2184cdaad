"""Rotations and their yaw, pitch and roll: R = Rz(ψ) Ry(θ) Rx(φ).

All but the exponential and the logarithm take arrays of numbers or of symbols.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.procedures import arctangent, rounded, select

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray

VERTICAL_PITCH_COSINE = 1e-14
"""Cosine of pitch below which yaw is rounding."""


def axis_rotation(axis: int, angle: Any) -> ScalarArray:
    """Rotations (..., 3, 3) by angles (...) about an axis of the frame, 0, 1 or 2."""
    angle = np.asarray(angle)
    R = np.zeros((*angle.shape, 3, 3), dtype=np.result_type(float, angle))
    i = (axis + 1) % 3
    j = (axis + 2) % 3
    R[..., axis, axis] = 1
    R[..., i, i] = np.cos(angle)
    R[..., j, j] = R[..., i, i]
    R[..., j, i] = np.sin(angle)
    R[..., i, j] = -R[..., j, i]
    return R


def rotation_from_angles(angles: ScalarArray) -> ScalarArray:
    """Rotations (..., 3, 3) of yaw, pitch and roll (..., 3)."""
    R: ScalarArray = (
        axis_rotation(2, angles[..., 0]) @ axis_rotation(1, angles[..., 1]) @ axis_rotation(0, angles[..., 2])
    )
    return R


def rotation_exponential(vector: Array) -> Array:
    """Rotations (..., 3, 3) of rotation vectors (..., 3)."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    x, y, z = (vector[..., k] for k in range(3))
    zero = np.zeros_like(x)
    K = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vector.shape[:-1], 3, 3)
    R: Array = np.eye(3) + np.sinc(angle / np.pi) * K + np.sinc(angle / (2 * np.pi)) ** 2 / 2 * (K @ K)
    return R


def rotation_logarithm(R: Array) -> Array:
    """Rotation vectors (..., 3) of rotations (..., 3, 3) by less than half a turn."""
    skew_part = (R - np.swapaxes(R, -1, -2)) / 2
    sines = np.stack([skew_part[..., 2, 1], skew_part[..., 0, 2], skew_part[..., 1, 0]], axis=-1)
    sine = np.linalg.norm(sines, axis=-1)
    angle = np.arctan2(sine, (np.trace(R, axis1=-2, axis2=-1) - 1) / 2)
    vector: Array = sines * np.where(sine > 0, angle / np.where(sine > 0, sine, 1.0), 1.0)[..., None]
    return vector


def angles_from_rotation(R: ScalarArray, yaw: Any = 0.0) -> ScalarArray:
    """Yaw, pitch and roll of rotations, pitch within ±90°.

    Parameters
    ----------
    R : ndarray, shape (..., 3, 3)
    yaw : ndarray, shape (...), or float
        Yaw where pitch is ±90° to the last digits, where yaw and roll turn about one axis.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    horizontal = np.sqrt(R[..., 0, 0] * R[..., 0, 0] + R[..., 1, 0] * R[..., 1, 0])
    yaw = select(horizontal > VERTICAL_PITCH_COSINE, arctangent(R[..., 1, 0], R[..., 0, 0]), yaw)
    sine = np.sin(yaw)
    cosine = np.cos(yaw)
    pitch = arctangent(-R[..., 2, 0], cosine * R[..., 0, 0] + sine * R[..., 1, 0])
    roll = arctangent(sine * R[..., 0, 2] - cosine * R[..., 1, 2], cosine * R[..., 1, 1] - sine * R[..., 0, 1])
    return np.stack([yaw, pitch, roll], axis=-1)


def nearest_angles(R: ScalarArray, near: ScalarArray) -> ScalarArray:
    """Yaw, pitch and roll of rotations, nearest to given angles.

    Parameters
    ----------
    R : ndarray, shape (..., 3, 3)
    near : ndarray, shape (..., 3)
        Where pitch is ±90° to the last digits, yaw is taken from here.

    Returns
    -------
    ndarray, shape (..., 3)
    """
    angles = angles_from_rotation(R, near[..., 0])
    candidates = np.stack([angles, angles * [1, -1, 1] + np.pi])
    differences = candidates - near
    differences = differences - 2 * np.pi * rounded(differences / (2 * np.pi))
    squared_distances = (differences * differences).sum(axis=-1)
    is_second = np.asarray(squared_distances[1] < squared_distances[0])
    nearest: ScalarArray = near + select(is_second[..., None], differences[1], differences[0])
    return nearest
