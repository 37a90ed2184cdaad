"""Uncertainty of a fit from the scatter between blocks of samples, for residuals of any distribution.

The residuals of a joint in a block form a cluster. The estimator is the cluster-robust covariance with the correction
CR3, which is the jackknife that leaves out one cluster at a time: a cluster pulls the fit towards itself, so that its
residuals are smaller than those of a fit without it.

Source: Bell and McCaffrey, "Bias reduction in standard errors for linear regression with multi-stage samples" (2002);
MacKinnon, Nielsen and Webb, "Cluster-robust inference: a guide to empirical practice" (2023).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from scipy.stats import norm
from scipy.stats import t as student

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.motion_blocks import MotionBlocks
    from robot_dynamics.identification.triangular_factors import TriangularFactors

MIN_BLOCKS = 4  # fewer blocks tell next to nothing of the scatter
MIN_REMAINDER = 1e-8  # least part of the information on a direction that counts as left without a cluster


def block_covariance(blocks: MotionBlocks, weights: Array, directions: Array, values: Array) -> Array:
    """Estimate the covariance (k, k) of the errors along k directions.

    Parameters
    ----------
    blocks : MotionBlocks
        Blocks that were fitted.
    weights : (n,) array
        Weights of the squared residuals of each joint.
    directions : (P, k) array
        Directions in which the P parameters were fitted, scaled so that the weighted columns are orthonormal.
    values : (P,) array
        Fitted values.

    Returns
    -------
    (k, k) array
        Covariance of the coefficients of the directions.
    """
    roots = np.sqrt(weights)[:, None]
    return cluster_covariance(_weighted_rows(factors, roots, directions, values) for factors in blocks.factors)


def joint_covariance(factors: TriangularFactors, weights: Array, directions: Array, values: Array) -> Array:
    """Estimate the covariance (k, k) of the errors along k directions from the scatter between joints.

    Errors of the gain or of the friction of a joint last as long as a recording: the scatter between blocks does not
    show them. The residuals of a joint form a cluster. With the correction CR2 the estimate is unbiased for white
    noise, also in directions that one joint determines nearly alone.

    factors: of the rows of all blocks; other arguments as those of `block_covariance`.
    """
    columns, residuals = _weighted_rows(factors, np.sqrt(weights)[:, None], directions, values)
    U, s, Vt = np.linalg.svd(columns, full_matrices=False)
    correction = s / np.sqrt(np.maximum(1 - s**2, MIN_REMAINDER))
    scores = np.einsum("nik,ni,nri,nr->nk", Vt, correction, U, residuals)
    covariance: Array = scores.T @ scores
    return covariance


def cluster_covariance(blocks: Iterable[tuple[Array, Array]]) -> Array:
    """Estimate the covariance (k, k) of the errors of k coefficients from blocks with a cluster for each joint.

    blocks: at least one, with columns (n, rows, k) and residuals (n, rows). The columns of all blocks together are
    orthonormal.
    """
    scores = [_score_without_cluster(columns, residuals) for columns, residuals in blocks]
    rows = np.concatenate(scores)
    covariance: Array = rows.T @ rows * _few_blocks_factor(len(scores))
    return covariance


def _few_blocks_factor(count: int) -> float:
    """Factor of the jackknife variance of a number of blocks: with very few, Student's interval is much wider."""
    if count >= MIN_BLOCKS:
        return (count - 1) / count
    quantile = student.ppf(0.975, max(count - 1, 1)) / norm.ppf(0.975)
    return float(quantile**2)


def held_out_squares(blocks: MotionBlocks, weights: Array, directions: Array, values: Array) -> Array:
    """Sums of squares (B, n) of the residuals of B blocks, each for a fit without this block; arguments as above."""
    roots = np.sqrt(weights)[:, None]
    squares: list[Array] = []
    for factors in blocks.factors:
        columns, residuals = _weighted_rows(factors, roots, directions, values)
        k = columns.shape[-1]
        change = _score_without_cluster(columns.reshape(-1, k), residuals.ravel())
        held_out: Array = (residuals + columns @ change) / roots
        squares.append(np.square(held_out).sum(axis=1))
    return np.array(squares)


def _weighted_rows(factors: TriangularFactors, roots: Array, directions: Array, values: Array) -> tuple[Array, Array]:
    """Columns (n, rows, k) and residuals (n, rows) of a block, times the roots (n, 1) of the weights of the joints."""
    X = factors.triangles[..., :-1]
    return roots[..., None] * (X @ directions), roots * (factors.triangles[..., -1] - X @ values)


def _score_without_cluster(A: Array, r: Array) -> Array:
    """Changes (..., k) of the coefficients if rows A (..., N, k) with residuals r (..., N) are left out.

    The columns of all rows together are orthonormal; the change is then (1 - AᵀA)⁻¹ Aᵀ r. Directions that only these
    rows determine do not change.
    """
    transposed = np.swapaxes(A, -1, -2)
    remainder = (1 + MIN_REMAINDER) * np.eye(A.shape[-1]) - transposed @ A
    scores: Array = np.asarray(np.linalg.solve(remainder, transposed @ r[..., None])[..., 0], dtype=float)
    return scores
