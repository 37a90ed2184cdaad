"""Screws: twists and wrenches [linear; angular] (..., 6), and how they pass from frame to frame.

Frame j is placed in its antecedent's frame i by the rotation R = iRj (..., 3, 3) and the position P = iPj (..., 3).
The screw transformation jTi = [Rᵀ, -Rᵀ P̂; 0, Rᵀ] is never written out: its zeros and its products are known.
"""

import numpy as np

from robot_dynamics.model.inertia import skew

BASE_ROWS = tuple(f"base.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz")
"""Names of the six components of a twist of the base or of a wrench on it."""
YZX, ZXY = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a, b):
    """a × b over the last axis."""
    return a.take(YZX, -1) * b.take(ZXY, -1) - a.take(ZXY, -1) * b.take(YZX, -1)


def apply(matrix, vector):
    """matrix vector, for (..., m, k) and (..., k)."""
    return (matrix @ vector[..., None])[..., 0]


def apply_transposed(R, vector):
    """Rᵀ vector."""
    return (vector[..., None, :] @ R)[..., 0, :]


def dot(a, b):
    """a · b over the last axis, which stays: (..., 1)."""
    return (a[..., None, :] @ b[..., None])[..., 0]


def screw(linear, angular):
    """Stack two vectors (..., 3) to a screw (..., 6)."""
    if linear.shape != angular.shape:
        linear, angular = np.broadcast_arrays(linear, angular)
    return np.concatenate([linear, angular], axis=-1)


def twist_to_successor(R, P, V):
    """jTi iV: the twist (or acceleration) of frame i, at the origin of frame j and in its axes."""
    linear, angular = V[..., :3], V[..., 3:]
    return screw(apply_transposed(R, linear + cross(angular, P)), apply_transposed(R, angular))


def wrench_to_antecedent(R, P, f):
    """jTiᵀ jf: the wrench at the origin of frame j, at the origin of frame i and in its axes."""
    force = apply(R, f[..., :3])
    return screw(force, apply(R, f[..., 3:]) + cross(P, force))


def inertia_to_antecedent(R, P, J):
    """jTiᵀ jJ jTi for a symmetric (..., 6, 6)."""
    transposed = np.swapaxes(R, -1, -2)
    A, B, D = (R @ block @ transposed for block in (J[..., :3, :3], J[..., :3, 3:], J[..., 3:, 3:]))
    offset = skew(P)
    AP = A @ offset
    upper = B - AP  # the coupling block at the new origin
    lower = D + offset @ B + np.swapaxes(offset @ B, -1, -2) - offset @ AP
    top = np.concatenate(np.broadcast_arrays(A, upper), axis=-1)
    bottom = np.concatenate(np.broadcast_arrays(np.swapaxes(upper, -1, -2), lower), axis=-1)
    return np.concatenate([top, bottom], axis=-2)


def concatenate_vectors(vectors):
    """Vectors (..., k), each of its own length, one after the other."""
    if not vectors:
        return np.zeros(0)
    batch = np.broadcast_shapes(*(vector.shape[:-1] for vector in vectors))
    return np.concatenate([np.broadcast_to(vector, (*batch, vector.shape[-1])) for vector in vectors], axis=-1)


def stack_vectors(rows):
    """Vectors (..., k) as rows: (..., number of vectors, k)."""
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def stack_matrices(matrices):
    """Matrices (..., m, k) on top of each other."""
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    return np.concatenate([np.broadcast_to(matrix, (*batch, *matrix.shape[-2:])) for matrix in matrices], axis=-2)
