"""Angular motion of a link: products of angular velocities, and the matrix B of all its points (Renaud, eq. 2, 4)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray


class AngularMotion:
    """Angular motion of a link.

    Attributes
    ----------
    omega, angular_acceleration : ndarray, shape (..., 3)
        ω_j and its derivative a_j, in the same axes.
    xx, yy, zz, xy, xz, yz : ndarray, shape (...)
        Products of the components of ω_j.
    B : list of list of ndarray
        Entries (...) of the matrix B_j (3, 3).
    """

    def __init__(self, omega: ScalarArray, angular_acceleration: ScalarArray) -> None:
        self.omega = omega
        self.angular_acceleration = angular_acceleration
        x, y, z = components(omega)
        a, b, c = components(angular_acceleration)
        self.xx = x * x  # eq. 2
        self.yy = y * y
        self.zz = z * z
        self.xy = x * y
        self.xz = x * z
        self.yz = y * z
        self.B = [  # eq. 4
            [-(self.yy + self.zz), self.xy - c, self.xz + b],
            [self.xy + c, -(self.xx + self.zz), self.yz - a],
            [self.xz - b, self.yz + a, -(self.xx + self.yy)],
        ]

    def times(self, r: ScalarArray) -> ScalarArray:
        """B_j r (..., 3) for a vector r (..., 3)."""
        x, y, z = components(r)
        return vector_from_components(*(row[0] * x + row[1] * y + row[2] * z for row in self.B))


def components(vector: ScalarArray) -> tuple[ScalarArray, ScalarArray, ScalarArray]:
    """The components (...) of a vector (..., 3)."""
    return vector[..., 0], vector[..., 1], vector[..., 2]


def vector_from_components(*entries: ScalarArray) -> ScalarArray:
    """The vector (..., k) of k components (...)."""
    return np.stack(np.broadcast_arrays(*entries), axis=-1)
