"""Screws: twists and wrenches [linear; angular] (..., 6), and their transformation between frames.

Frame j is placed in its antecedent's frame i by the rotation R = iRj (..., 3, 3) and the position P = iPj (..., 3).
The screw transformation jTi = [Rᵀ, -Rᵀ P̂; 0, Rᵀ] is never formed: its zeros and its products are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.vector_product import skew

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray

BASE_ROWS = tuple(f"base.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz")
"""Names of the six components of a twist of the base or of a wrench on it."""
YZX = np.array([1, 2, 0])
ZXY = np.array([2, 0, 1])


def cross(a: ScalarArray, b: ScalarArray) -> ScalarArray:
    """Vector product a × b (..., 3)."""
    product: ScalarArray = a.take(YZX, -1) * b.take(ZXY, -1) - a.take(ZXY, -1) * b.take(YZX, -1)
    return product


def apply(matrix: ScalarArray, vector: ScalarArray) -> ScalarArray:
    """Product (..., m) of a matrix (..., m, k) and a vector (..., k)."""
    product: ScalarArray = (matrix @ vector[..., None])[..., 0]
    return product


def apply_transposed(matrix: ScalarArray, vector: ScalarArray) -> ScalarArray:
    """Product (..., k) of the transpose of a matrix (..., m, k) and a vector (..., m)."""
    product: ScalarArray = (vector[..., None, :] @ matrix)[..., 0, :]
    return product


def dot(a: ScalarArray, b: ScalarArray) -> ScalarArray:
    """Scalar product (..., 1) of vectors (..., k)."""
    product: ScalarArray = (a[..., None, :] @ b[..., None])[..., 0]
    return product


def screw(linear: ScalarArray, angular: ScalarArray) -> ScalarArray:
    """Screw (..., 6) of two vectors (..., 3)."""
    if linear.shape != angular.shape:
        linear, angular = np.broadcast_arrays(linear, angular)
    return np.concatenate([linear, angular], axis=-1)


def twist_to_successor(R: ScalarArray, P: ScalarArray, V: ScalarArray) -> ScalarArray:
    """jTi iV: a twist or acceleration (..., 6) of frame i, expressed at the origin of frame j in its axes."""
    linear = V[..., :3]
    angular = V[..., 3:]
    return screw(apply_transposed(R, linear + cross(angular, P)), apply_transposed(R, angular))


def wrench_to_antecedent(R: ScalarArray, P: ScalarArray, f: ScalarArray) -> ScalarArray:
    """jTiᵀ jf: a wrench (..., 6) at the origin of frame j, expressed at the origin of frame i in its axes."""
    force = apply(R, f[..., :3])
    return screw(force, apply(R, f[..., 3:]) + cross(P, force))


def inertia_to_antecedent(R: ScalarArray, P: ScalarArray, J: ScalarArray) -> ScalarArray:
    """jTiᵀ jJ jTi (..., 6, 6) for a symmetric spatial inertia J (..., 6, 6)."""
    transposed = np.swapaxes(R, -1, -2)
    A, B, D = (R @ block @ transposed for block in (J[..., :3, :3], J[..., :3, 3:], J[..., 3:, 3:]))
    offset = skew(P)
    AP = A @ offset
    upper = B - AP  # the coupling block at the new origin
    lower = D + offset @ B + np.swapaxes(offset @ B, -1, -2) - offset @ AP
    top = np.concatenate(np.broadcast_arrays(A, upper), axis=-1)
    bottom = np.concatenate(np.broadcast_arrays(np.swapaxes(upper, -1, -2), lower), axis=-1)
    return np.concatenate([top, bottom], axis=-2)


def concatenate_vectors(vectors: Sequence[ScalarArray]) -> ScalarArray:
    """Concatenate vectors (..., k) of different lengths; their batch axes are broadcast."""
    if not vectors:
        return np.zeros(0)
    batch = np.broadcast_shapes(*(vector.shape[:-1] for vector in vectors))
    return np.concatenate([np.broadcast_to(vector, (*batch, vector.shape[-1])) for vector in vectors], axis=-1)


def stack_vectors(rows: Sequence[ScalarArray]) -> ScalarArray:
    """Stack vectors (..., k) as rows of a matrix (..., rows, k)."""
    return np.stack(np.broadcast_arrays(*rows), axis=-2)


def stack_matrices(matrices: Sequence[ScalarArray]) -> ScalarArray:
    """Stack matrices (..., m, k) of different heights on top of each other; their batch axes are broadcast."""
    batch = np.broadcast_shapes(*(matrix.shape[:-2] for matrix in matrices))
    return np.concatenate([np.broadcast_to(matrix, (*batch, *matrix.shape[-2:])) for matrix in matrices], axis=-2)
