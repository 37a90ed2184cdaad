"""Quaternions in the order of the viewer: w first."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.model.placement import to_scipy_rotation

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array


def quaternions_wxyz(rotations: Array) -> Array:
    """Return unit quaternions (..., 4) w, x, y, z of one rotation matrix (3, 3) or of several (N, 3, 3)."""
    quaternions: Array = to_scipy_rotation(rotations).as_quat()[..., [3, 0, 1, 2]]
    return quaternions
