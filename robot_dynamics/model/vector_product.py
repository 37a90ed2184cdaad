"""The matrix of the vector product."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray


def skew(vector: ScalarArray) -> ScalarArray:
    """Return the matrices (..., 3, 3) of the vector product with `vector` (..., 3): skew(a) @ b = a × b."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
