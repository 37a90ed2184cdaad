"""Least squares in the directions of the parameters that the data show better than the description does.

In coordinates in which the errors of the description have variance 1 (`description_prior`), the singular values of the
weighted columns tell how much the data show of each direction: a direction has the variance 1 / s² for residuals of
variance 1. Directions with a variance above 1 keep the values of the description. As the directions are singular
vectors, those that are left out do not change the others.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.identification.block_scatter import block_covariance

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.description_prior import DescriptionPrior
    from robot_dynamics.identification.motion_blocks import MotionBlocks
    from robot_dynamics.identification.triangular_factors import TriangularFactors

MIN_WHITE_PART = 0.5  # least variance over that of white noise: few blocks may scatter little by chance
ROUNDING = 1e-12  # relative singular value of directions that are not excited


@dataclass(frozen=True, eq=False)
class SeenSolution:
    """Values (P,) that were fitted with weights (n,) of the joints in k directions.

    basis: (P, k) orthonormal directions, in units of the errors of the description; singular_values: (k,) of the
    weighted columns in these directions; directions: (P, k) in units of the parameters, with orthonormal weighted
    columns.
    """

    values: Array
    weights: Array
    basis: Array
    singular_values: Array
    directions: Array


def solve_seen_directions(
    factors: TriangularFactors, prior: DescriptionPrior, weights: Array, effective_share: float
) -> SeenSolution:
    """Fit the directions that the data show better than the description, for white noise.

    effective_share: number of independent samples per row; 0: fit all directions that are excited at all.
    """
    A, b = factors.weighted_system(weights)
    U, s, Vt = np.linalg.svd(A @ prior.root, full_matrices=False)
    is_seen = s > ROUNDING * s[0]
    if effective_share > 0:
        is_seen &= s**2 * effective_share > 1
    return _build(prior, weights, Vt[is_seen].T, s[is_seen], U[:, is_seen].T @ (b - A @ prior.values))


def _build(
    prior: DescriptionPrior, weights: Array, basis: Array, singular_values: Array, coefficients: Array
) -> SeenSolution:
    directions = prior.root @ (basis / singular_values)
    return SeenSolution(prior.values + directions @ coefficients, weights, basis, singular_values, directions)


def drop_uncertain_directions(
    blocks: MotionBlocks, factors: TriangularFactors, prior: DescriptionPrior, solution: SeenSolution, share: float
) -> tuple[SeenSolution, Array]:
    """Drop directions whose deviation between blocks exceeds that of the description, the worst half at a time.

    Returns the solution, and the covariance (k, k) of its k directions.
    """
    A, b = factors.weighted_system(solution.weights)
    while True:
        scatter = block_covariance(blocks, solution.weights, solution.directions, solution.values)
        variances = np.maximum(np.diagonal(scatter), 1 / share) / solution.singular_values**2
        is_seen = variances < 1
        if is_seen.all():
            return solution, scatter
        is_seen |= variances < np.median(variances[~is_seen])
        coefficients = (A @ solution.directions[:, is_seen]).T @ (b - A @ prior.values)
        solution = _build(
            prior, solution.weights, solution.basis[:, is_seen], solution.singular_values[is_seen], coefficients
        )


def error_covariance(
    prior: DescriptionPrior, solution: SeenSolution, scatter: Array, share: float
) -> tuple[Array, float]:
    """Covariance (P, P) of the values, and by what factor variances exceed those of white noise.

    The variance of each direction is that of the scatter between blocks. Errors of different directions count as
    independent, as they are for white noise: a few dozen blocks tell their variances, not all their covariances.
    Directions that are not seen have the covariance of the description.
    """
    directions = solution.directions
    variances = np.maximum(np.diagonal(scatter), MIN_WHITE_PART / share)
    inflation = float(np.exp(np.mean(np.log(np.maximum(np.diagonal(scatter) * share, 1))))) if len(scatter) else 1.0
    unseen = prior.root - prior.root @ solution.basis @ solution.basis.T
    return (directions * variances) @ directions.T + unseen @ unseen.T, inflation
