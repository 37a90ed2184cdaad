"""Constant placements of frames: homogeneous matrices (4, 4), the pose of a frame j in a frame i, written iTj."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, ScalarArray


def placement(rotation: ArrayLike | None = None, translation: ArrayLike | None = None) -> Array:
    """Return the (4, 4) matrix of a rotation (3, 3) and a translation (3,) [m]; default: the identity."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if translation is not None:
        matrix[:3, 3] = translation
    return matrix


def invert_placement(matrix: Array) -> Array:
    """Return jTi (4, 4) of iTj (4, 4), by the transposed rotation."""
    rotation = matrix[:3, :3].T
    return placement(rotation, -rotation @ matrix[:3, 3])


def to_scipy_rotation(matrices: Array) -> Rotation:
    """Return rotation matrices (3, 3) or (N, 3, 3) as a SciPy Rotation; SciPy 1.11 refuses read-only arrays itself."""
    return Rotation.from_matrix(np.array(matrices))


def rotation_with_z_along(axis: ArrayLike) -> Array:
    """Return a rotation (3, 3) whose third column is the direction of `axis` (3,).

    An axis along x, y or z, of either sign, gives entries that are exactly 0 and ±1. Such entries keep traced
    programs small.
    """
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.zeros(3)
    x[np.argmin(np.abs(z))] = 1.0
    x -= z * (z @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def rotation_from_roll_pitch_yaw(roll: float, pitch: float, yaw: float) -> Array:
    """Return the rotation (3, 3) Rot(z, yaw) Rot(y, pitch) Rot(x, roll) of three angles [rad], URDF's convention."""
    cr, cp, cy = np.cos([roll, pitch, yaw])
    sr, sp, sy = np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def rotation_from_quaternion(quaternion: ArrayLike) -> Array:
    """Return the rotation (3, 3) of a quaternion w, x, y, z of any length.

    Turns by right angles about axes of the frame give entries that are exactly 0 and ±1.
    """
    w, x, y, z = np.asarray(quaternion, dtype=float)
    rotation: Array = Rotation.from_quat([x, y, z, w]).as_matrix()
    rounded = np.round(rotation)
    return rounded if np.abs(rotation - rounded).max() < 1e-15 else rotation


def roll_pitch_yaw(rotation: ScalarArray) -> tuple[float, float, float]:
    """Return the angles [rad] from which `rotation_from_roll_pitch_yaw` makes this rotation (3, 3).

    Near a pitch of a right angle roll and yaw are nearly interchangeable. Yaw is computed from the rotation with roll
    removed, so that the three angles reproduce the rotation there too.
    """
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    y = np.cos(roll) * rotation[:, 1] - np.sin(roll) * rotation[:, 2]  # second column of Rot(z, yaw) Rot(y, pitch)
    yaw = np.arctan2(-y[0], y[1])
    return float(roll) + 0.0, float(pitch) + 0.0, float(yaw) + 0.0  # + 0.0: no negative zero
