"""Natural frequencies and modes of M ẍ + K x = 0, for symmetric M and K that need not be definite."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eigh

from robot_dynamics.errors import SingularModelError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

MASSLESS = 1e-12  # a scaled mass below this is a rounding error
ZERO_EIGENVALUE = 1e-12  # an eigenvalue below this fraction of the largest belongs to a mechanism
MIN_SCALE = 1e-300  # against division by zero


def natural_frequencies(mass: Array, stiffness: Array) -> Array:
    """Return ascending frequencies (n,) [Hz] of matrices (n, n): sqrt(eig(M⁻¹ K)) / 2π.

    Frequencies of motions without stiffness are zero, those of motions without mass inf.
    """
    if not mass.size:  # which SciPy 1.11 refuses
        return np.zeros(0)
    scale = _scale(mass)
    M = mass / scale
    K = stiffness / scale
    if _is_definite(M):
        return _frequencies(eigh(K, M, eigvals_only=True, check_finite=False))
    return _frequencies(_condensed_modes(M, K)[0])


def modes(mass: Array, stiffness: Array) -> tuple[Array, Array]:
    """Return frequencies (n,) [Hz] and shapes (n, n): each row φ has φᵀ M φ = 1, or is zero for a massless motion."""
    if not mass.size:
        return np.zeros(0), np.zeros((0, 0))
    scale = _scale(mass)
    M = mass / scale
    K = stiffness / scale
    values, vectors = eigh(K, M, check_finite=False) if _is_definite(M) else _condensed_modes(M, K)
    return _frequencies(values), (vectors / np.sqrt(np.diagonal(scale))[:, None]).T


def _frequencies(eigenvalues: Array) -> Array:
    """Return frequencies (n,) [Hz] of ascending eigenvalues; rounding errors become zero."""
    finite = eigenvalues[np.isfinite(eigenvalues)]
    threshold = ZERO_EIGENVALUE * np.abs(finite[-1]) if len(finite) else 0.0
    return np.asarray(np.sqrt(np.where(eigenvalues > threshold, eigenvalues, 0.0)) / (2 * math.pi))


def _scale(mass: Array) -> Array:
    """Return (n, n) the outer product of the units of the coordinates: kg and kg m² do not compare."""
    diagonal = np.diagonal(mass)
    units = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return np.outer(units, units)


def _is_definite(M: Array) -> bool:
    try:
        pivots = np.diagonal(cholesky(M, check_finite=False))
    except LinAlgError:
        return False
    return bool(pivots.min() ** 2 > MASSLESS)


def _condensed_modes(M: Array, K: Array) -> tuple[Array, Array]:
    """Return eigenvalues (n,) and vectors (n, n), with massless motions condensed statically."""
    masses, directions = eigh(M, check_finite=False)
    is_massless = masses <= MASSLESS * max(masses.max(), MIN_SCALE)
    massless = directions[:, is_massless]
    massive = directions[:, ~is_massless]
    massless_stiffness = massless.T @ K @ massless
    try:
        cholesky(massless_stiffness / max(np.abs(massless_stiffness).max(), MIN_SCALE), check_finite=False)
    except LinAlgError:
        raise SingularModelError(
            "some motion has neither mass nor stiffness. Give the links that it moves a mass, or hold their joints"
        ) from None
    coupling = -np.linalg.solve(massless_stiffness, massless.T @ K @ massive)
    basis = massive + massless @ coupling
    values, vectors = eigh(basis.T @ K @ basis, np.diag(masses[~is_massless]), check_finite=False)
    count = is_massless.sum()
    return np.append(values, [np.inf] * count), np.hstack([basis @ vectors, np.zeros((len(M), count))])
