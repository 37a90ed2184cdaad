"""Constant placements of frames: homogeneous matrices (4, 4), the pose of a frame j in a frame i, written iTj."""

import numpy as np


def placement(rotation=None, translation=None):
    """The (4, 4) matrix of a rotation (3, 3) and a translation (3,) [m]; either may be left out."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if translation is not None:
        matrix[:3, 3] = translation
    return matrix


def inverse(matrix):
    """jTi from iTj, by the transposed rotation."""
    rotation = matrix[:3, :3].T
    return placement(rotation, -rotation @ matrix[:3, 3])


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
