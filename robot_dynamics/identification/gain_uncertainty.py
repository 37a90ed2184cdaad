"""Uncertainty of identified drive gains and of the parameters identified with them, from the scatter between blocks.

Errors of the model, mostly of friction, are larger than the noise of currents: deviations for white noise are several
times too small. The residuals of the gain problem are linearised at the solution; the rest is that of `block_scatter`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.identification.block_scatter import cluster_covariance
from robot_dynamics.identification.gain_problem import GainProblem
from robot_dynamics.identification.seen_directions import MIN_WHITE_PART
from robot_dynamics.identification.triangular_factors import TriangularFactors

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.motion_blocks import MotionBlocks

MIN_SINGULAR_VALUE = 1e-9  # relative, of columns of length 1; smaller ones are directions that the motion does not show


def gain_covariance(blocks: MotionBlocks, x: Array, weights: Array, white_share: float) -> Array:
    """Covariance (k, k) of the errors of the inverse gains.

    Parameters
    ----------
    blocks : MotionBlocks
        Blocks with factors of [X L y] of the k motors.
    x : (P + k,) array
        Solution of the gain problem.
    weights : (k,) array
        Inverse variances of the residuals.
    white_share : float
        Number of independent samples per row, for white noise before the filter.

    Returns
    -------
    (k, k) array
        Covariance; its variances are at least MIN_WHITE_PART of those of white noise.
    """
    k = len(weights)
    everything = slice(None)
    return _covariance(blocks, x, weights, white_share, everything)[-k:, -k:]


def parameter_covariance(
    blocks: MotionBlocks, x: Array, weights: Array, white_share: float, inverse_gain_covariance: Array
) -> Array:
    """Covariance (P, P) of the errors of the parameters, with those of the inverse gains.

    Arguments as above; x may have fewer parameters than the blocks have columns: the first ones.
    """
    P = len(x) - len(weights)
    by_parameters = slice(P)
    covariance = _covariance(blocks, x, weights, white_share, by_parameters)
    J = _weighted_jacobian(blocks, x, weights)
    directions = _orthonormal_directions(J[:, :P])
    change = -directions @ ((J[:, :P] @ directions).T @ J[:, P:])  # of the parameters, by the inverse gains
    total: Array = covariance + change @ inverse_gain_covariance @ change.T
    return total


def _covariance(blocks: MotionBlocks, x: Array, weights: Array, white_share: float, unknowns: slice) -> Array:
    """Covariance of some of the unknowns, the others fixed."""
    roots = np.sqrt(weights)[:, None]
    directions = _orthonormal_directions(_weighted_jacobian(blocks, x, weights)[:, unknowns])
    count = len(x) - len(weights)
    problems = (GainProblem(factors.triangles).restricted(count) for factors in blocks.factors)
    scatter = cluster_covariance(
        (roots[..., None] * (problem.jacobian(x)[..., unknowns] @ directions), roots * problem.residuals(x))
        for problem in problems
    )
    covariance = directions @ scatter @ directions.T
    least = MIN_WHITE_PART / white_share * np.square(directions).sum(axis=1)
    variances = np.diagonal(covariance)
    growth = np.sqrt(np.maximum(variances, least) / np.where(variances > 0, variances, 1.0))
    enlarged: Array = covariance * growth * growth[:, None] + np.diag(np.where(variances > 0, 0.0, least))
    return enlarged


def _weighted_jacobian(blocks: MotionBlocks, x: Array, weights: Array) -> Array:
    """Weighted derivatives (rows, P + k) of the signals of all blocks with respect to x."""
    triangles = TriangularFactors.sum(blocks.factors).triangles
    problem = GainProblem(triangles).restricted(len(x) - len(weights))
    rows = np.sqrt(weights)[:, None, None] * problem.jacobian(x)
    jacobian: Array = rows.reshape(-1, len(x))
    return jacobian


def _orthonormal_directions(J: Array) -> Array:
    """Directions (P, r) in which the columns J (rows, P) are orthonormal."""
    lengths = np.linalg.norm(J, axis=0)
    lengths = np.where(lengths > 0, lengths, 1.0)
    _, s, Vt = np.linalg.svd(J / lengths, full_matrices=False)
    is_shown = s > MIN_SINGULAR_VALUE * s[0]
    directions: Array = (Vt[is_shown].T / s[is_shown]) / lengths[:, None]
    return directions
