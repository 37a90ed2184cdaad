"""Angular motion of a link: products of angular velocities, and the matrix B of all its points (Renaud, eq. 2, 4).

With B_j = [ω̇_j] + [ω_j][ω_j] ([·] the matrix of the vector product) a point at r from O_j has the acceleration of O_j
and B_j r. The points of a joint axis belong to both links of the joint. So the third column of B_j, of the point z_j,
follows from the motion of the antecedent alone: neither the rate nor the acceleration of the joint is in it. Its
entries are xz + b, yz - a and -(xx + yy), with products of the components of ω_j and ω̇_j = (a, b, c): they
leave two products, two components of ω̇_j and some sums less to compute.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray


@dataclass(frozen=True, eq=False)
class AngularMotion:
    """Angular motion of a link.

    Attributes
    ----------
    omega, angular_acceleration : ndarray, shape (..., 3)
        ω_j and its derivative a_j, in the same axes.
    xy, xz, yz : ndarray, shape (...)
        Products of the components of ω_j.
    differences : tuple of ndarray
        yy - zz, zz - xx and xx - yy (...), of squares of these components.
    B : list of list of ndarray
        Entries (...) of the matrix B_j (3, 3).
    """

    omega: ScalarArray
    angular_acceleration: ScalarArray
    xy: ScalarArray
    xz: ScalarArray
    yz: ScalarArray
    differences: tuple[ScalarArray, ScalarArray, ScalarArray]
    B: list[list[ScalarArray]]

    def times(self, r: ScalarArray) -> ScalarArray:
        """B_j r (..., 3) for a vector r (..., 3)."""
        x, y, z = components(r)
        return vector_from_components(*(row[0] * x + row[1] * y + row[2] * z for row in self.B))


def angular_motion(omega: ScalarArray, angular_acceleration: ScalarArray) -> AngularMotion:
    """The AngularMotion of ω_j and ω̇_j (..., 3)."""
    x, y, z = components(omega)
    a, b, c = components(angular_acceleration)
    xx, yy, zz = x * x, y * y, z * z  # eq. 2
    xy, xz, yz = x * y, x * z, y * z
    B = [  # eq. 4
        [-(yy + zz), xy - c, xz + b],
        [xy + c, -(xx + zz), yz - a],
        [xz - b, yz + a, -(xx + yy)],
    ]
    return AngularMotion(omega, angular_acceleration, xy, xz, yz, (yy - zz, zz - xx, xx - yy), B)


def angular_motion_from_axis(
    omega: ScalarArray, axis_column: ScalarArray, spin: ScalarArray, reads_difference: bool = True
) -> AngularMotion:
    """The AngularMotion of a link.

    Parameters
    ----------
    omega : ndarray, shape (..., 3)
        ω_j.
    axis_column : ndarray, shape (..., 3)
        The third column of B_j.
    spin : ndarray, shape (...)
        The third component of ω̇_j.
    reads_difference : bool
        Whether zz - xx is needed besides B. Two sums with it then replace the square and the sum in B00.
    """
    x, y, z = components(omega)
    xx, zz = x * x, z * z
    xy, xz, yz = x * y, x * z, y * z
    u, v, w = components(axis_column)
    a = yz - v
    b = u - xz
    difference = xx - zz
    first = w + difference if reads_difference else -(y * y + zz)
    second = -(xx + zz)
    B = [[first, xy - spin, u[()]], [xy + spin, second, v[()]], [xz - b, yz + a, w[()]]]
    angular_acceleration = vector_from_components(a, b, spin)
    return AngularMotion(omega, angular_acceleration, xy, xz, yz, (second - w, -difference, first - second), B)


def permuted_angular_motion(R: ScalarArray, motion: AngularMotion) -> AngularMotion:
    """The same AngularMotion in other axes, the columns (3,) of R, which are axes of the motion or their opposites."""
    order = [int(np.flatnonzero(R[:, column])[0]) for column in range(3)]
    signs = [int(R[row, column]) for column, row in enumerate(order)]
    parity = 1 if (order[1] - order[0]) % 3 == 1 else -1
    products = {frozenset((0, 1)): motion.xy, frozenset((0, 2)): motion.xz, frozenset((1, 2)): motion.yz}
    xy, xz, yz = (signs[i] * signs[j] * products[frozenset((order[i], order[j]))] for i, j in ((0, 1), (0, 2), (1, 2)))
    first, second, third = (parity * motion.differences[row] for row in order)
    B = [[signs[i] * signs[j] * motion.B[order[i]][order[j]] for j in range(3)] for i in range(3)]
    omega, angular_acceleration = (
        vector_from_components(*(sign * vector[..., row] for sign, row in zip(signs, order, strict=True)))
        for vector in (motion.omega, motion.angular_acceleration)
    )
    return AngularMotion(omega, angular_acceleration, xy, xz, yz, (first, second, third), B)


def components(vector: ScalarArray) -> tuple[ScalarArray, ScalarArray, ScalarArray]:
    """The components (...) of a vector (..., 3)."""
    return vector[..., 0], vector[..., 1], vector[..., 2]


def vector_from_components(*entries: ScalarArray) -> ScalarArray:
    """The vector (..., k) of k components (...)."""
    return np.stack(np.broadcast_arrays(*entries), axis=-1)
