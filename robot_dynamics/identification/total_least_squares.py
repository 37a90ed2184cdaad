"""Total least squares with exact columns: noisy γ + known β ≈ 0, where only the columns `noisy` have errors.

Ordinary least squares count all errors as those of the right-hand side; coefficients of noisy columns are then too
small. The exact columns are eliminated by projection. The errors of the noisy columns are independent, with known
relative sizes; scaled to equal size, the smallest singular value belongs to the solution.

Source: Golub, Hoffman and Stewart, "A generalization of the Eckart-Young-Mirsky matrix approximation theorem" (1987);
Van Huffel and Vandewalle, "Analysis and properties of the generalized total least squares problem AX ≈ B when some or
all columns in A are subject to error" (1989).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.identification.triangular_factors import solve_least_squares

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array


class Relation(NamedTuple):
    """Coefficients of a linear relation between columns, up to a common factor: noisy (k,) and known (m,)."""

    noisy: Array
    known: Array


def solve_total_least_squares(noisy: Array, known: Array, noise: Array) -> Relation:
    """Minimise |noisy γ + known β|² / |noise γ|².

    Parameters
    ----------
    noisy : (N, k) array
        Columns with errors.
    known : (N, m) array
        Columns without errors.
    noise : (k,) array
        RMS of the errors of each noisy column, times any common factor.

    Returns
    -------
    Relation
        γ, with |noise γ| = 1, and β.
    """
    scaled = noisy / noise
    fits = np.stack([solve_least_squares(known, column).values for column in scaled.T], axis=1)
    coefficients = np.linalg.svd(scaled - known @ fits)[2][-1]
    return Relation(coefficients / noise, -fits @ coefficients)
