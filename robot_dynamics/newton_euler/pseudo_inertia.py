"""Pseudo-inertias: the ten inertial parameters of a body as a symmetric matrix (4, 4).

    P = [[½ tr(J) 1 - J, MS], [MSᵀ, M]] = ∫ [r; 1] [r; 1]ᵀ dm

A body with these parameters can exist if P is positive semidefinite; this includes the triangle inequality of the
principal moments of inertia. Source: P. Wensing, S. Kim, J.-J. Slotine, Linear matrix inequalities for physically
consistent inertial parameter identification, IEEE Robotics and Automation Letters 3 (2018).
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.newton_euler.regressor import LINK_PARAMETERS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

TRIANGLE = tuple((row, column) for column in range(4) for row in range(column + 1))
"""Rows and columns of the upper triangle of a pseudo-inertia, column by column."""

PSEUDO_INERTIA_ENTRIES: tuple[dict[str, float], ...] = (
    {"XX": -0.5, "YY": 0.5, "ZZ": 0.5},
    {"XY": -1.0},
    {"XX": 0.5, "YY": -0.5, "ZZ": 0.5},
    {"XZ": -1.0},
    {"YZ": -1.0},
    {"XX": 0.5, "YY": 0.5, "ZZ": -0.5},
    {"MX": 1.0},
    {"MY": 1.0},
    {"MZ": 1.0},
    {"M": 1.0},
)
"""Entries of the upper triangle, in this order, as sums of LINK_PARAMETERS."""


def _basis() -> Array:
    """Pseudo-inertias (10, 4, 4) of bodies of which one of LINK_PARAMETERS is 1 and the others are 0."""
    basis = np.zeros((len(LINK_PARAMETERS), 4, 4))
    for (row, column), entries in zip(TRIANGLE, PSEUDO_INERTIA_ENTRIES, strict=True):
        for key, factor in entries.items():
            basis[LINK_PARAMETERS.index(key), [row, column], [column, row]] = factor
    return basis


_BASIS = _basis()
# tr(_DUAL_BASIS[j] _BASIS[k]) is 1 where j = k, else 0
_DUAL_BASIS = np.linalg.pinv(_BASIS.reshape(len(_BASIS), 16)).T.reshape(_BASIS.shape)


def pseudo_inertias(parameters: Array) -> Array:
    """Return pseudo-inertias (..., 4, 4) of LINK_PARAMETERS (..., 10)."""
    matrices: Array = np.tensordot(parameters, _BASIS, axes=1)
    return matrices


def link_parameters(matrices: Array) -> Array:
    """Return LINK_PARAMETERS (..., 10) of pseudo-inertias (..., 4, 4)."""
    parameters: Array = np.tensordot(matrices, _DUAL_BASIS, axes=((-2, -1), (1, 2)))
    return parameters


def dual_matrices(gradients: Array) -> Array:
    """Return the symmetric matrices B (..., 4, 4) with tr(B P) = gᵀ θ, for gradients g (..., 10) by LINK_PARAMETERS."""
    matrices: Array = np.tensordot(gradients, _DUAL_BASIS, axes=1)
    return matrices
