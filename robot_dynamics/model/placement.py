"""Constant placements of frames: homogeneous matrices (4, 4), the pose of a frame j in a frame i, written iTj."""

import numpy as np
from scipy.spatial.transform import Rotation


def placement(rotation=None, translation=None):
    """The (4, 4) matrix of a rotation (3, 3) and a translation (3,) [m]; either may be left out."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if translation is not None:
        matrix[:3, 3] = translation
    return matrix


def invert_placement(matrix):
    """jTi from iTj, by the transposed rotation."""
    rotation = matrix[:3, :3].T
    return placement(rotation, -rotation @ matrix[:3, 3])


def to_scipy_rotation(matrices: np.ndarray) -> Rotation:
    """Rotation matrices (3, 3) or (N, 3, 3) as SciPy's Rotation; read-only ones too, which SciPy 1.11 refuses."""
    return Rotation.from_matrix(np.array(matrices))


def rotation_with_z_along(axis):
    """A rotation (3, 3) whose third column is the direction of `axis` (3,).

    About that axis it is chosen so that an axis along x, y or z, of either sign, gives entries 0 and ±1 exactly:
    this is what later makes programs small.
    """
    z = np.asarray(axis, dtype=float) / np.linalg.norm(axis)
    x = np.zeros(3)
    x[np.argmin(np.abs(z))] = 1.0
    x -= z * (z @ x)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])


def rotation_from_roll_pitch_yaw(roll, pitch, yaw):
    """The rotation (3, 3) Rot(z, yaw) Rot(y, pitch) Rot(x, roll) of three angles [rad], as URDF means them."""
    (cr, cp, cy), (sr, sp, sy) = np.cos([roll, pitch, yaw]), np.sin([roll, pitch, yaw])
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def roll_pitch_yaw(rotation):
    """Three angles [rad] that `rotation_from_roll_pitch_yaw` turns into this rotation (3, 3).

    Near a pitch of a right angle roll and yaw are hardly told apart; yaw is what remains when roll is undone, so that
    the rotation is exact there too.
    """
    roll = np.arctan2(rotation[2, 1], rotation[2, 2])
    pitch = np.arctan2(-rotation[2, 0], np.hypot(rotation[0, 0], rotation[1, 0]))
    y = np.cos(roll) * rotation[:, 1] - np.sin(roll) * rotation[:, 2]  # second column of Rot(z, yaw) Rot(y, pitch)
    return tuple(float(angle) + 0.0 for angle in (roll, pitch, np.arctan2(-y[0], y[1])))  # + 0.0: no minus zero
