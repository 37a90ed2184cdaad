"""Least-squares fits of base parameters, friction and offsets to recordings, with the covariance of their errors.

In coordinates in which the errors of the description have variance 1 (`description_prior`), singular values of the
weighted columns tell how much the data show of each direction. A direction is seen if the data determine it better than
the description does. The other directions keep the values of the description. The standard deviations come from the
scatter between blocks of samples (`block_scatter`), and are at least those of white noise.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.block_scatter import held_out_squares
from robot_dynamics.identification.description_prior import build_description_prior
from robot_dynamics.identification.fit_warnings import block_warnings, excitation_warnings, sign_warnings
from robot_dynamics.identification.identification_model import FRICTION_PREFIXES
from robot_dynamics.identification.sample_sums import NO_SAMPLES
from robot_dynamics.identification.seen_directions import (
    drop_uncertain_directions,
    error_covariance,
    solve_seen_directions,
)
from robot_dynamics.identification.triangular_factors import solve_least_squares

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.identification.description_prior import DescriptionPrior
    from robot_dynamics.identification.identification_model import IdentificationModel, JointEffortModel
    from robot_dynamics.identification.motion_blocks import MotionBlocks
    from robot_dynamics.identification.sample_sums import FactorSums, FitQuality
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.identification.seen_directions import SeenSolution
    from robot_dynamics.identification.triangular_factors import TriangularFactors

FitMethod: TypeAlias = Literal["weighted", "ordinary", "robust"]

REWEIGHTING_ITERATIONS = 6
MAX_DEVIATION_OF_SEEN = 0.5  # standard deviation of parameters that count as seen, over that of the description
FRICTION_REPRODUCIBILITY = 0.02  # relative standard deviation of friction between runs, by temperature and age
MAX_RESIDUAL_GROWTH = 1.01  # of the squared residuals, without the parameters that are not essential
MAX_RELATIVE_DEVIATION = 0.1  # standard deviation of an essential parameter, relative to its value


@dataclass(frozen=True, eq=False)
class Fit:
    """Result of a fit of P parameters to the efforts of n joints.

    Attributes
    ----------
    model : IdentificationModel
        Model whose `names` (P,) are those of the parameters.
    values : (P,) array
        Identified values, in SI units.
    standard_deviations : (P,) array
        Standard deviations of the errors of the values.
    covariance : (P, P) array
        Covariance of the errors of the values.
    prior : DescriptionPrior
        Values of the description, and their errors.
    seen : (P,) array of bool
        Whether the data determine a parameter clearly better than the description does.
    directions : (P, k) array
        Directions in which the parameters were fitted; the others keep the values of the description.
    condition : float
        Condition number of the columns, each scaled to length 1.
    blocks : MotionBlocks
        Triangular factors of blocks of samples.
    factors : TriangularFactors
        Triangular factors of all samples.
    white_share : float
        Number of independent samples per row, for white noise before the filter.
    noise_inflation : float
        Variance of the errors between blocks over that of white noise, in the geometric mean.
    weights : (n,) array
        Weights of the squared residuals of each joint.
    held_out_rms : (n,) array
        RMS residual in the band of blocks of samples, for fits without the block.
    training_quality : FitQuality
        Residuals on the samples that were fitted.
    validation_quality : FitQuality or None
        Residuals on the samples for validation.
    method : {"weighted", "ordinary", "robust"}
        Method of least squares.
    warnings : tuple of str
        Sentences on parameters that the motion excites too little, and on implausible values.
    notes : dict
        Sentences on samples that were left out, by the name of the recording.
    """

    model: IdentificationModel
    values: Array
    standard_deviations: Array
    covariance: Array
    prior: DescriptionPrior
    seen: BoolArray
    directions: Array
    condition: float
    blocks: MotionBlocks
    factors: TriangularFactors
    white_share: float
    noise_inflation: float
    weights: Array
    held_out_rms: Array
    training_quality: FitQuality
    validation_quality: FitQuality | None
    method: FitMethod
    warnings: tuple[str, ...]
    notes: dict[str, tuple[str, ...]]

    @property
    def deviations_between_runs(self) -> Array:
        """(P,) standard deviations of the values, with the change of friction between runs."""
        is_friction = np.array([name.startswith(FRICTION_PREFIXES) for name in self.model.names])
        change = FRICTION_REPRODUCIBILITY * self.values * is_friction
        deviations: Array = np.hypot(self.standard_deviations, change)
        return deviations


def fit_parameters(
    samples: Samples[JointEffortModel],
    *,
    method: FitMethod = "weighted",
    validation: Samples[JointEffortModel] | None = None,
) -> Fit:
    """Fit the parameters of an identification model to samples.

    Parameters
    ----------
    samples : Samples
        Samples of recordings, with the model to fit.
    method : {"weighted", "ordinary", "robust"}
        ``"ordinary"`` gives all joints the same weight. ``"weighted"`` weights each joint by the inverse variance of
        its residuals. ``"robust"`` also reduces the weight of residuals beyond 1.345 standard deviations (Huber).
    validation : Samples, optional
        Samples that are not fitted, on which the fit is validated.

    Returns
    -------
    Fit
        Identified values with their covariance, quality and warnings.

    Raises
    ------
    RecordingError
        If there are too few samples, or the recordings cannot be used.
    """
    solved = solve_parameters(samples, method=method)
    model = samples.model.identification_model
    factors = solved.factors
    solution = solved.solution
    covariance, inflation = error_covariance(solved.prior, solution, solved.scatter, solved.white_share)
    standard_deviations = np.sqrt(np.diagonal(covariance))
    excitation = solve_least_squares(*factors.weighted_system(solution.weights))
    seen = excitation.excited & (standard_deviations < MAX_DEVIATION_OF_SEEN * solved.prior.deviations)
    held_out = held_out_squares(solved.blocks, solution.weights, solution.directions, solution.values).sum(axis=0)
    return Fit(
        model=model,
        values=solution.values,
        standard_deviations=standard_deviations,
        covariance=covariance,
        prior=solved.prior,
        seen=seen,
        directions=solution.directions,
        condition=excitation.condition,
        blocks=solved.blocks,
        factors=factors,
        white_share=solved.white_share,
        noise_inflation=inflation,
        weights=1 / solution_variances(factors, solution),
        held_out_rms=np.sqrt(held_out / np.maximum(factors.samples, 1)),
        training_quality=samples.quality(solution.values),
        validation_quality=None if validation is None else validation.quality(solution.values),
        method=method,
        warnings=(
            *excitation_warnings(model, excitation.excited),
            *block_warnings(solved.blocks),
            *sign_warnings(model, solution.values, standard_deviations, seen),
        ),
        notes=samples.notes,
    )


@dataclass(frozen=True, eq=False)
class SolvedParameters:
    """Values of a fit without their uncertainty and quality.

    scatter: (k, k) covariance of the errors along the k directions of the solution, from the scatter between blocks;
    white_share: number of independent samples per row.
    """

    solution: SeenSolution
    scatter: Array
    prior: DescriptionPrior
    blocks: MotionBlocks
    factors: TriangularFactors
    white_share: float


def solve_parameters(samples: Samples[JointEffortModel], *, method: FitMethod = "weighted") -> SolvedParameters:
    """Find the values of a fit in one pass over the samples, or several with the robust method.

    Raises RecordingError if there are too few samples, or the recordings cannot be used.
    """
    sums = samples.accumulate_factors()
    factors, white_share = require_enough_samples(sums)
    efforts = factors.effort_rms
    prior = build_description_prior(samples.model.identification_model, efforts)
    weights = 1 / np.maximum(efforts, 1e-6 * efforts.max()) ** 2
    weights = weights if method != "ordinary" else np.full_like(weights, weights.mean())
    solution = solve_seen_directions(factors, prior, weights, 0.0)
    for _ in range(REWEIGHTING_ITERATIONS):
        variance = solution_variances(factors, solution)
        if method == "robust":
            sums = samples.accumulate_factors(solution.values, np.sqrt(variance))
            factors, white_share = require_enough_samples(sums)
        weights = 1 / variance if method != "ordinary" else np.full_like(variance, 1 / variance.mean())
        solution = solve_seen_directions(factors, prior, weights, white_share)
    assert sums.blocks is not None  # `require_enough_samples` refuses samples without blocks
    solution, scatter = drop_uncertain_directions(sums.blocks, factors, prior, solution, white_share)
    return SolvedParameters(solution, scatter, prior, sums.blocks, factors, white_share)


def require_enough_samples(sums: FactorSums) -> tuple[TriangularFactors, float]:
    """Return the factors and the number of independent samples per row. Raises RecordingError if there are too few."""
    factors = sums.factors
    if factors is None:
        raise RecordingError(NO_SAMPLES)
    n = factors.triangles.shape[0]
    P = factors.triangles.shape[2] - 1
    rows = factors.samples.sum()
    independent = sums.effective_samples.sum()
    if independent < 2 * P:
        raise RecordingError(
            f"too few samples for {P} parameters: {rows / n:.0f} filtered samples of {n} joints that move count as "
            f"{independent:.0f} independent samples, at least {2 * P} are needed"
        )
    return factors, float(independent / rows)


def residual_variances(squares: Array, efforts: Array, samples: IntArray, P: int) -> Array:
    """Estimate the variances (n,) of residuals from their sums of squares (n,), corrected for P fitted parameters.

    efforts: (n, rows) effort column of the triangular factors, which sets the level of rounding; samples: (n,).
    """
    levels = np.square(efforts).sum(axis=1)
    rounding = 1e-12 * np.where(levels > 0, levels, levels.max(initial=1.0))
    variances: Array = np.maximum(squares, rounding) / np.maximum(1.0, samples - P / len(squares))
    return variances


def select_essential_parameters(fit: Fit) -> BoolArray:
    """Select the parameters (P,) that the residuals depend on.

    The parameter with the largest relative standard deviation is removed repeatedly, until the squared residuals have
    grown by 1 % or all remaining parameters are known to 10 %.
    """
    A, b = fit.factors.weighted_system(fit.weights)
    selected = fit.seen & (fit.standard_deviations > 0)
    if not selected.any():
        return selected
    kept = np.where(selected, 0.0, fit.values)  # of parameters that are not seen
    b = b - A @ kept
    solution = solve_least_squares(A, b, selected)
    scale = fit.standard_deviations / np.maximum(np.sqrt(np.diagonal(solution.covariance)), 1e-300)
    max_residual = MAX_RESIDUAL_GROWTH * _weighted_residual(fit, solution.values + kept)
    while selected.sum() > 1:
        deviations = np.sqrt(np.diagonal(solution.covariance)) * scale
        relative = np.where(selected, deviations / np.maximum(np.abs(solution.values), 1e-300), -1)
        worst = int(np.argmax(relative))
        if relative[worst] < MAX_RELATIVE_DEVIATION:
            break
        fewer = selected.copy()
        fewer[worst] = False
        candidate = solve_least_squares(A, b, fewer)
        if _weighted_residual(fit, candidate.values + kept) > max_residual:
            break
        selected = fewer
        solution = candidate
    return selected


def solution_variances(factors: TriangularFactors, solution: SeenSolution) -> Array:
    """Variances (n,) of the residuals of a solution."""
    squares = factors.residual_sum_of_squares(solution.values)
    P = solution.directions.shape[1]
    return residual_variances(squares, factors.triangles[:, :, -1], factors.samples, P)


def _weighted_residual(fit: Fit, values: Array) -> float:
    """Sum of the weighted squares of the residuals of all joints."""
    return float((fit.weights * fit.factors.residual_sum_of_squares(values)).sum())
