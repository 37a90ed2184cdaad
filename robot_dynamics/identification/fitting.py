"""Base parameters, frictions and offsets that fit recordings, with what is known of their errors."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.identification_model import IdentificationModel
from robot_dynamics.identification.samples import NO_SAMPLES, FitQuality
from robot_dynamics.identification.triangular_factors import TriangularFactors, solve_least_squares

METHODS = ("weighted", "ordinary", "robust")
REWEIGHTING_ITERATIONS = 6  # of weights
MAX_GOOD_CONDITION_NUMBER = 200.0


@dataclass(frozen=True, eq=False)
class Fit:
    """values (P,) of columns.names, and deviations (P,), the standard deviations of their errors; covariance (P, P);
    condition: number of the columns, each of length 1; factors: of all samples, weights (n,) of the joints in them;
    trained: the Quality on what was fitted; warnings: sentences; notes: what was left out."""

    model: IdentificationModel
    values: np.ndarray
    standard_deviations: np.ndarray
    covariance: np.ndarray
    condition: float
    factors: TriangularFactors
    weights: np.ndarray
    training_quality: FitQuality
    validation_quality: FitQuality | None
    method: str
    warnings: tuple
    notes: tuple


def fit_parameters(samples, *, method="weighted", validation=None):
    """The Fit of columns to Samples; validation: Samples that it is tried on.

    method: ordinary: all joints count the same; weighted: each by the variance that it turns out to have; robust:
    residuals beyond 1.345 standard deviations count less too (Huber). Raises RecordingError.
    """
    factors, effective_samples = require_enough_samples(samples.accumulate_factors())
    n, P = factors.triangles.shape[0], factors.triangles.shape[2] - 1
    weights = np.ones(n)
    solution = solve_least_squares(*factors.weighted_system(weights))
    for _ in range(REWEIGHTING_ITERATIONS):
        variance = residual_variances(
            factors.residual_sum_of_squares(solution.values), factors.triangles[:, :, -1], factors.samples, P
        )
        if method != "ordinary":
            weights = variance.mean() / variance
        if method == "robust":
            factors, effective_samples = require_enough_samples(
                samples.accumulate_factors(solution.values, np.sqrt(variance))
            )
        solution = solve_least_squares(*factors.weighted_system(weights))
    variance = residual_variances(
        factors.residual_sum_of_squares(solution.values), factors.triangles[:, :, -1], factors.samples, P
    )
    per_sample = np.mean(variance * weights) if method != "ordinary" else variance.mean()
    covariance = solution.covariance * per_sample / effective_samples
    standard_deviations = np.sqrt(np.diagonal(covariance))
    return Fit(
        samples.model, solution.values, standard_deviations, covariance, solution.condition, factors, 1 / variance,
        samples.quality(solution.values),
        None if validation is None else validation.quality(solution.values), method,
        tuple(_warnings(samples.model, solution)), tuple(samples.notes),
    )  # fmt: skip


def require_enough_samples(gathered):
    """(Factors, independent samples of each row) of a Gathered. Raises RecordingError where they are too few."""
    factors, worth = gathered.factors, gathered.effective_samples
    if factors is None:
        raise RecordingError(NO_SAMPLES)
    n, P = factors.triangles.shape[0], factors.triangles.shape[2] - 1
    if n * worth < 2 * P:
        raise RecordingError(
            f"{gathered.rows} samples of {n} joints, worth {n * worth:.0f} independent ones, for {P} parameters"
        )
    return factors, worth / gathered.rows


def residual_variances(squares, efforts, samples, P):
    """(n,) of residuals with squares (n,), the P parameters counted off; efforts: (n, rows) of their factors."""
    least = 1e-12 * np.square(efforts).sum(axis=1)  # of efforts that are fitted to rounding
    return np.maximum(squares, least) / max(1.0, samples - P / len(squares))


def select_essential_parameters(fit):
    """(P,) the parameters of a Fit that are left when, one by one, the least certain goes as long as residuals hardly
    grow: by 1 % of their squares in all, or until each is known to 10 %."""
    A, b = fit.factors.weighted_system(fit.weights)
    selected = fit.standard_deviations > 0
    current = solve_least_squares(A, b, selected)
    scale = fit.standard_deviations / np.maximum(np.sqrt(np.diagonal(current.covariance)), 1e-300)
    allowed = 1.01 * (fit.weights * fit.factors.residual_sum_of_squares(current.values)).sum()
    while selected.sum() > 1:
        errors = np.sqrt(np.diagonal(current.covariance)) * scale
        relative = np.where(selected, errors / np.maximum(np.abs(current.values), 1e-300), -1)
        worst = int(np.argmax(relative))
        if relative[worst] < 0.1:
            break
        fewer = selected.copy()
        fewer[worst] = False
        tried = solve_least_squares(A, b, fewer)
        if (fit.weights * fit.factors.residual_sum_of_squares(tried.values)).sum() > allowed:
            break
        selected, current = fewer, tried
    return selected


def _warnings(columns, solution):
    if not solution.excited.all():
        unseen = [name for name, excited in zip(columns.names, solution.excited, strict=True) if not excited]
        yield f"the motion does not show {', '.join(unseen)}"
    if solution.condition > MAX_GOOD_CONDITION_NUMBER:
        yield (f"condition number {solution.condition:.0f}: the motion hardly tells parameters apart; "
               f"below {MAX_GOOD_CONDITION_NUMBER:.0f}, better below 100, a trajectory excites them")  # fmt: skip
