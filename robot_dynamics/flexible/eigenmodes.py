"""Natural frequencies and modes of M ẍ + K x = 0, for symmetric M and K, neither of which need be definite."""

import math

import numpy as np
from scipy.linalg import LinAlgError, cholesky, eigh

from robot_dynamics.errors import SingularModelError

MASSLESS = 1e-12  # a share of mass below this is rounding
ZERO_EIGENVALUE = 1e-12  # an eigenvalue below this part of the greatest is that of a mechanism


def natural_frequencies(mass, stiffness):
    """Frequencies (n,) [Hz] of matrices (n, n), ascending: sqrt(eig(M⁻¹ K)) / 2π. Those of motions without stiffness
    are zero, those of motions without mass inf."""
    if not mass.size:  # which SciPy 1.11 refuses
        return np.zeros(0)
    scale = _scale(mass)
    M, K = mass / scale, stiffness / scale
    if _is_definite(M):
        return _hertz(eigh(K, M, eigvals_only=True, check_finite=False))
    return _hertz(_condensed(M, K)[0])


def modes(mass, stiffness):
    """(frequencies (n,), shapes (n, n)): as `natural_frequencies`, and for each a row φ with φᵀ M φ = 1, or zeros."""
    if not mass.size:
        return np.zeros(0), np.zeros((0, 0))
    scale = _scale(mass)
    M, K = mass / scale, stiffness / scale
    values, vectors = eigh(K, M, check_finite=False) if _is_definite(M) else _condensed(M, K)
    return _hertz(values), (vectors / np.sqrt(np.diagonal(scale))[:, None]).T


def _hertz(values):
    """Frequencies (n,) [Hz] of ascending eigenvalues; what is rounding beside the greatest is zero."""
    finite = values[np.isfinite(values)]
    least = ZERO_EIGENVALUE * np.abs(finite[-1]) if len(finite) else 0.0
    return np.sqrt(np.where(values > least, values, 0.0)) / (2 * math.pi)


def _scale(mass):
    """(n, n) outer product of what each coordinate is counted by: kg and kg m² do not compare."""
    diagonal = np.diagonal(mass)
    sizes = np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    return np.outer(sizes, sizes)


def _is_definite(M):
    try:
        pivots = np.diagonal(cholesky(M, check_finite=False))
    except LinAlgError:
        return False
    return bool(pivots.min() ** 2 > MASSLESS)


def _condensed(M, K):
    """(eigenvalues (n,), vectors (n, n)), motions without mass being where they have no force."""
    shares, directions = eigh(M, check_finite=False)
    massless = shares <= MASSLESS * max(shares.max(), 1e-300)
    still, moving = directions[:, massless], directions[:, ~massless]
    held = still.T @ K @ still
    try:
        cholesky(held / max(np.abs(held).max(), 1e-300), check_finite=False)
    except LinAlgError:
        raise SingularModelError(
            "some motion meets neither mass nor stiffness. Give the links that it moves a mass, or hold their joints"
        ) from None
    follow = -np.linalg.solve(held, still.T @ K @ moving)
    basis = moving + still @ follow
    values, vectors = eigh(basis.T @ K @ basis, np.diag(shares[~massless]), check_finite=False)
    without = massless.sum()
    return np.append(values, [np.inf] * without), np.hstack([basis @ vectors, np.zeros((len(M), without))])
