"""Base parameters, frictions and offsets that fit recordings, with what is known of their errors."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.effort_columns import EffortColumns
from robot_dynamics.identification.factors import Factors, solved
from robot_dynamics.identification.samples import NOTHING_LEFT, Quality

METHODS = ("weighted", "ordinary", "robust")
ROUNDS = 6  # of weights
POOR_CONDITION = 200.0


@dataclass(frozen=True, eq=False)
class Fit:
    """values (P,) of columns.names, and deviations (P,), the standard deviations of their errors; covariance (P, P);
    condition: number of the columns, each of length 1; factors: of all samples, weights (n,) of the joints in them;
    trained: the Quality on what was fitted; warnings: sentences; notes: what was left out."""

    columns: EffortColumns
    values: np.ndarray
    deviations: np.ndarray
    covariance: np.ndarray
    condition: float
    factors: Factors
    weights: np.ndarray
    trained: Quality
    validated: Quality | None
    method: str
    warnings: tuple
    notes: tuple


def fitted(samples, *, method="weighted", validation=None):
    """The Fit of columns to Samples; validation: Samples that it is tried on.

    method: ordinary: all joints count the same; weighted: each by the variance that it turns out to have; robust:
    residuals beyond 1.345 standard deviations count less too (Huber). Raises RecordingError.
    """
    factors, independent = enough(samples.gathered())
    n, P = factors.triangles.shape[0], factors.triangles.shape[2] - 1
    weights = np.ones(n)
    solution = solved(*factors.system(weights))
    for _ in range(ROUNDS):
        variance = variances(factors.squares(solution.values), factors.triangles[:, :, -1], factors.samples, P)
        if method != "ordinary":
            weights = variance.mean() / variance
        if method == "robust":
            factors, independent = enough(samples.gathered(solution.values, np.sqrt(variance)))
        solution = solved(*factors.system(weights))
    variance = variances(factors.squares(solution.values), factors.triangles[:, :, -1], factors.samples, P)
    per_sample = np.mean(variance * weights) if method != "ordinary" else variance.mean()
    covariance = solution.covariance * per_sample / independent
    deviations = np.sqrt(np.diagonal(covariance))
    return Fit(
        samples.columns, solution.values, deviations, covariance, solution.condition, factors, 1 / variance,
        samples.quality(solution.values),
        None if validation is None else validation.quality(solution.values), method,
        tuple(_warnings(samples.columns, solution)), tuple(samples.notes),
    )  # fmt: skip


def enough(gathered):
    """(Factors, independent samples of each row) of a Gathered. Raises RecordingError where they are too few."""
    factors, worth = gathered.factors, gathered.independent
    if factors is None:
        raise RecordingError(NOTHING_LEFT)
    n, P = factors.triangles.shape[0], factors.triangles.shape[2] - 1
    if n * worth < 2 * P:
        raise RecordingError(
            f"{gathered.rows} samples of {n} joints, worth {n * worth:.0f} independent ones, for {P} parameters"
        )
    return factors, worth / gathered.rows


def variances(squares, efforts, samples, P):
    """(n,) of residuals with squares (n,), the P parameters counted off; efforts: (n, rows) of their factors."""
    least = 1e-12 * np.square(efforts).sum(axis=1)  # of efforts that are fitted to rounding
    return np.maximum(squares, least) / max(1.0, samples - P / len(squares))


def essential(fit):
    """(P,) the parameters of a Fit that are left when, one by one, the least certain goes as long as residuals hardly
    grow: by 1 % of their squares in all, or until each is known to 10 %."""
    A, b = fit.factors.system(fit.weights)
    wanted = fit.deviations > 0
    current = solved(A, b, wanted)
    scale = fit.deviations / np.maximum(np.sqrt(np.diagonal(current.covariance)), 1e-300)
    allowed = 1.01 * (fit.weights * fit.factors.squares(current.values)).sum()
    while wanted.sum() > 1:
        errors = np.sqrt(np.diagonal(current.covariance)) * scale
        relative = np.where(wanted, errors / np.maximum(np.abs(current.values), 1e-300), -1)
        worst = int(np.argmax(relative))
        if relative[worst] < 0.1:
            break
        fewer = wanted.copy()
        fewer[worst] = False
        tried = solved(A, b, fewer)
        if (fit.weights * fit.factors.squares(tried.values)).sum() > allowed:
            break
        wanted, current = fewer, tried
    return wanted


def _warnings(columns, solution):
    if not solution.seen.all():
        unseen = [name for name, seen in zip(columns.names, solution.seen, strict=True) if not seen]
        yield f"the motion does not show {', '.join(unseen)}"
    if solution.condition > POOR_CONDITION:
        yield (f"condition number {solution.condition:.0f}: the motion hardly tells parameters apart; "
               f"below {POOR_CONDITION:.0f}, better below 100, a trajectory excites them")  # fmt: skip
