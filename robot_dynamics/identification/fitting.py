"""Least-squares fits of base parameters, friction and offsets to recordings, with the covariance of their errors."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.sample_sums import NO_SAMPLES
from robot_dynamics.identification.triangular_factors import (
    solve_least_squares,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.identification_model import IdentificationModel, JointEffortModel
    from robot_dynamics.identification.sample_sums import FactorSums, FitQuality
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.identification.triangular_factors import (
        LeastSquaresSolution,
        TriangularFactors,
    )

FitMethod: TypeAlias = Literal["weighted", "ordinary", "robust"]

REWEIGHTING_ITERATIONS = 6
MAX_GOOD_CONDITION_NUMBER = 200.0
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
    condition : float
        Condition number of the columns, each scaled to length 1.
    factors : TriangularFactors
        Triangular factors of all samples.
    weights : (n,) array
        Weights of the squared residuals of each joint.
    training_quality : FitQuality
        Residuals on the samples that were fitted.
    validation_quality : FitQuality or None
        Residuals on the samples for validation.
    method : {"weighted", "ordinary", "robust"}
        Method of least squares.
    warnings : tuple of str
        Sentences on parameters that the motion excites too little.
    notes : tuple of str
        Sentences on samples that were left out.
    """

    model: IdentificationModel
    values: Array
    standard_deviations: Array
    covariance: Array
    condition: float
    factors: TriangularFactors
    weights: Array
    training_quality: FitQuality
    validation_quality: FitQuality | None
    method: FitMethod
    warnings: tuple[str, ...]
    notes: tuple[str, ...]


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
    factors, effective_share = require_enough_samples(samples.accumulate_factors())
    P = factors.triangles.shape[2] - 1
    weights = np.ones(factors.triangles.shape[0])
    solution = solve_least_squares(*factors.weighted_system(weights))
    for _ in range(REWEIGHTING_ITERATIONS):
        variance = _residual_variances(factors, solution, P)
        if method != "ordinary":
            weights = variance.mean() / variance
        if method == "robust":
            sums = samples.accumulate_factors(solution.values, np.sqrt(variance))
            factors, effective_share = require_enough_samples(sums)
        solution = solve_least_squares(*factors.weighted_system(weights))
    variance = _residual_variances(factors, solution, P)
    variance_per_row = np.mean(variance * weights) if method != "ordinary" else variance.mean()
    covariance = solution.covariance * variance_per_row / effective_share
    model = samples.model.identification_model
    return Fit(
        model=model,
        values=solution.values,
        standard_deviations=np.sqrt(np.diagonal(covariance)),
        covariance=covariance,
        condition=solution.condition,
        factors=factors,
        weights=1 / variance,
        training_quality=samples.quality(solution.values),
        validation_quality=None if validation is None else validation.quality(solution.values),
        method=method,
        warnings=tuple(_excitation_warnings(model, solution)),
        notes=tuple(samples.notes),
    )


def require_enough_samples(sums: FactorSums) -> tuple[TriangularFactors, float]:
    """Return the factors and the number of independent samples per row. Raises RecordingError if there are too few."""
    factors = sums.factors
    if factors is None:
        raise RecordingError(NO_SAMPLES)
    n = factors.triangles.shape[0]
    P = factors.triangles.shape[2] - 1
    if n * sums.effective_samples < 2 * P:
        raise RecordingError(
            f"too few samples for {P} parameters: {sums.rows} filtered samples of {n} joints count as "
            f"{n * sums.effective_samples:.0f} independent samples, at least {2 * P} are needed"
        )
    return factors, sums.effective_samples / sums.rows


def residual_variances(squares: Array, efforts: Array, samples: int, P: int) -> Array:
    """Estimate the variances (n,) of residuals from their sums of squares (n,), corrected for P fitted parameters.

    efforts: (n, rows) effort column of the triangular factors, which sets the level of rounding.
    """
    rounding = 1e-12 * np.square(efforts).sum(axis=1)
    variances: Array = np.maximum(squares, rounding) / max(1.0, samples - P / len(squares))
    return variances


def select_essential_parameters(fit: Fit) -> BoolArray:
    """Select the parameters (P,) that the residuals depend on.

    The parameter with the largest relative standard deviation is removed repeatedly, until the squared residuals have
    grown by 1 % or all remaining parameters are known to 10 %.
    """
    A, b = fit.factors.weighted_system(fit.weights)
    selected = fit.standard_deviations > 0
    solution = solve_least_squares(A, b, selected)
    scale = fit.standard_deviations / np.maximum(np.sqrt(np.diagonal(solution.covariance)), 1e-300)
    max_residual = MAX_RESIDUAL_GROWTH * _weighted_residual(fit, solution)
    while selected.sum() > 1:
        deviations = np.sqrt(np.diagonal(solution.covariance)) * scale
        relative = np.where(selected, deviations / np.maximum(np.abs(solution.values), 1e-300), -1)
        worst = int(np.argmax(relative))
        if relative[worst] < MAX_RELATIVE_DEVIATION:
            break
        fewer = selected.copy()
        fewer[worst] = False
        candidate = solve_least_squares(A, b, fewer)
        if _weighted_residual(fit, candidate) > max_residual:
            break
        selected = fewer
        solution = candidate
    return selected


def _residual_variances(factors: TriangularFactors, solution: LeastSquaresSolution, P: int) -> Array:
    squares = factors.residual_sum_of_squares(solution.values)
    return residual_variances(squares, factors.triangles[:, :, -1], factors.samples, P)


def _weighted_residual(fit: Fit, solution: LeastSquaresSolution) -> float:
    """Sum of the weighted squares of the residuals of all joints."""
    return float((fit.weights * fit.factors.residual_sum_of_squares(solution.values)).sum())


def _excitation_warnings(model: IdentificationModel, solution: LeastSquaresSolution) -> Iterator[str]:
    if not solution.excited.all():
        names = [name for name, excited in zip(model.names, solution.excited, strict=True) if not excited]
        yield f"the motion does not excite {', '.join(names)}"
    if solution.condition > MAX_GOOD_CONDITION_NUMBER:
        yield (
            f"condition number {solution.condition:.0f}: the motion hardly distinguishes the parameters; use an "
            f"excitation trajectory with a condition number below {MAX_GOOD_CONDITION_NUMBER:.0f}, better below 100"
        )
