"""Least-squares fits of base parameters, friction and offsets to recordings, with the covariance of their errors.

In coordinates in which the errors of the description have variance 1 (`description_prior`), singular values of the
weighted columns tell how much the data show of each direction. A direction is seen if the data determine it better than
the description does. The other directions keep the values of the description. The standard deviations come from the
scatter between blocks of samples (`block_scatter`), and are at least those of white noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.identification.block_scatter import block_covariance, held_out_squares
from robot_dynamics.identification.description_prior import build_description_prior
from robot_dynamics.identification.identification_model import FRICTION_PREFIXES
from robot_dynamics.identification.sample_sums import NO_SAMPLES
from robot_dynamics.identification.triangular_factors import (
    solve_least_squares,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray
    from robot_dynamics.identification.description_prior import DescriptionPrior
    from robot_dynamics.identification.identification_model import IdentificationModel, JointEffortModel
    from robot_dynamics.identification.motion_blocks import MotionBlocks
    from robot_dynamics.identification.sample_sums import FactorSums, FitQuality
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.identification.triangular_factors import (
        LeastSquaresSolution,
        TriangularFactors,
    )

FitMethod: TypeAlias = Literal["weighted", "ordinary", "robust"]

REWEIGHTING_ITERATIONS = 6
MAX_DEVIATION_OF_SEEN = 0.5  # standard deviation of a parameter that counts as seen, relative to that of the description
FRICTION_REPRODUCIBILITY = 0.02  # relative standard deviation of friction between runs, by temperature and age
MIN_WHITE_PART = 0.5  # least variance, relative to that of white noise: scatter between few blocks may be small by chance
MIN_BLOCKS = 8  # fewer blocks tell little of the scatter between blocks
MAX_RESIDUAL_GROWTH = 1.01  # of the squared residuals, without the parameters that are not essential
MAX_RELATIVE_DEVIATION = 0.1  # standard deviation of an essential parameter, relative to its value
SIGN_REMEDIES = {
    "Ia": (
        "rotor inertia",
        "the motion hardly distinguishes rotors from bodies; compare --no-rotor-inertia, and record larger "
        "accelerations; a coarse encoder needs a lower --cutoff",
    ),
    "Fv": (
        "viscous friction",
        "check signs and units of velocities and efforts; friction that falls with velocity (Stribeck) has this "
        "effect at low speeds: record faster motions",
    ),
    "Fs": (
        "Coulomb friction",
        "check signs of velocities and efforts, and record motions that change direction often",
    ),
}
SIGNIFICANT_DEVIATIONS = 2.0  # by which a parameter that cannot be negative is below zero


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
    effective_share : float
        Number of independent samples per row, for residuals as correlated as those of the fit.
    weights : (n,) array
        Weights of the squared residuals of each joint.
    training_quality : FitQuality
        Residuals on the samples that were fitted.
    validation_quality : FitQuality or None
        Residuals on the samples for validation.
    method : {"weighted", "ordinary", "robust"}
        Method of least squares.
    warnings : tuple of str
        Sentences on parameters that the motion excites too little, and on implausible values.
    notes : tuple of str
        Sentences on samples that were left out.
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
    effective_share: float
    weights: Array
    training_quality: FitQuality
    validation_quality: FitQuality | None
    method: FitMethod
    warnings: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def deviations_between_runs(self) -> Array:
        """(P,) standard deviations of the values, with the change of friction between runs."""
        is_friction = np.array([name.startswith(FRICTION_PREFIXES) for name in self.model.names])
        change = FRICTION_REPRODUCIBILITY * self.values * is_friction
        deviations: Array = np.hypot(self.standard_deviations, change)
        return deviations

    @property
    def held_out_rms(self) -> Array:
        """(n,) RMS residual of each block in the band, for a fit without this block."""
        squares = held_out_squares(self.blocks, self.weights, self.directions, self.values)
        rms: Array = np.sqrt(squares / np.maximum(self.factors.samples, 1))
        return rms


@dataclass(frozen=True, eq=False)
class _Solution:
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
    sums = samples.accumulate_factors()
    factors, effective_share = require_enough_samples(sums)
    model = samples.model.identification_model
    efforts = np.linalg.norm(factors.triangles[:, :, -1], axis=1) / np.sqrt(np.maximum(factors.samples, 1))
    prior = build_description_prior(model, efforts)
    weights = 1 / np.maximum(efforts, 1e-6 * efforts.max()) ** 2
    solution = _solve(factors, prior, weights if method != "ordinary" else np.full_like(weights, weights.mean()), 0.0)
    for _ in range(REWEIGHTING_ITERATIONS):
        variance = _residual_variances(factors, solution)
        if method == "robust":
            sums = samples.accumulate_factors(solution.values, np.sqrt(variance))
            factors, effective_share = require_enough_samples(sums)
        weights = 1 / variance if method != "ordinary" else np.full_like(variance, 1 / variance.mean())
        solution = _solve(factors, prior, weights, effective_share)
    assert sums.blocks is not None  # `require_enough_samples` refuses samples without blocks
    solution, scatter = _keep_seen_directions(sums.blocks, factors, prior, solution, effective_share)
    covariance, inflation = _covariance(prior, solution, scatter, effective_share)
    standard_deviations = np.sqrt(np.diagonal(covariance))
    excitation = solve_least_squares(*factors.weighted_system(solution.weights))
    seen = excitation.excited & (standard_deviations < MAX_DEVIATION_OF_SEEN * prior.deviations)
    variance = _residual_variances(factors, solution)
    qualities = samples.qualities([solution.values])
    return Fit(
        model=model,
        values=solution.values,
        standard_deviations=standard_deviations,
        covariance=covariance,
        prior=prior,
        seen=seen,
        directions=solution.directions,
        condition=excitation.condition,
        blocks=sums.blocks,
        factors=factors,
        effective_share=effective_share / inflation,
        weights=1 / variance,
        training_quality=qualities[0],
        validation_quality=None if validation is None else validation.quality(solution.values),
        method=method,
        warnings=(
            *_excitation_warnings(model, excitation),
            *_block_warnings(sums.blocks),
            *_sign_warnings(model, solution.values, standard_deviations, seen),
        ),
        notes=tuple(samples.notes),
    )


def _solve(factors: TriangularFactors, prior: DescriptionPrior, weights: Array, effective_share: float) -> _Solution:
    """Fit the directions that white noise lets the data see; effective_share 0: all that are excited at all."""
    A, b = factors.weighted_system(weights)
    U, s, Vt = np.linalg.svd(A @ prior.root, full_matrices=False)
    is_seen = s > 1e-12 * s[0]
    if effective_share > 0:
        is_seen &= s**2 * effective_share > 1
    return _solution(prior, weights, Vt[is_seen].T, s[is_seen], U[:, is_seen].T @ (b - A @ prior.values))


def _solution(
    prior: DescriptionPrior, weights: Array, basis: Array, singular_values: Array, coefficients: Array
) -> _Solution:
    directions = prior.root @ (basis / singular_values)
    return _Solution(prior.values + directions @ coefficients, weights, basis, singular_values, directions)


def _keep_seen_directions(
    blocks: MotionBlocks, factors: TriangularFactors, prior: DescriptionPrior, solution: _Solution, share: float
) -> tuple[_Solution, Array]:
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
        solution = _solution(
            prior, solution.weights, solution.basis[:, is_seen], solution.singular_values[is_seen], coefficients
        )


def _covariance(prior: DescriptionPrior, solution: _Solution, scatter: Array, share: float) -> tuple[Array, float]:
    """Covariance (P, P) of the values, and how much larger the variances are than for white noise.

    Deviations are those of the scatter between blocks, correlations those of white noise, which are known better.
    Directions that are not seen have the covariance of the description.
    """
    directions = solution.directions
    white = directions @ directions.T / share
    variances = np.maximum(np.diagonal(directions @ scatter @ directions.T), MIN_WHITE_PART * np.diagonal(white))
    ratios = np.sqrt(variances / np.maximum(np.diagonal(white), 1e-300))
    inflation = float(np.exp(np.mean(np.log(np.maximum(np.diagonal(scatter) * share, 1))))) if len(scatter) else 1.0
    unseen = prior.root - prior.root @ solution.basis @ solution.basis.T
    return white * ratios * ratios[:, None] + unseen @ unseen.T, inflation


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


def _residual_variances(factors: TriangularFactors, solution: _Solution) -> Array:
    squares = factors.residual_sum_of_squares(solution.values)
    P = solution.directions.shape[1]
    return residual_variances(squares, factors.triangles[:, :, -1], factors.samples, P)


def _weighted_residual(fit: Fit, values: Array) -> float:
    """Sum of the weighted squares of the residuals of all joints."""
    return float((fit.weights * fit.factors.residual_sum_of_squares(values)).sum())


def _excitation_warnings(model: IdentificationModel, solution: LeastSquaresSolution) -> Iterator[str]:
    if not solution.excited.all():
        names = [name for name, excited in zip(model.names, solution.excited, strict=True) if not excited]
        yield f"the motion does not excite {', '.join(names)}"


def _block_warnings(blocks: MotionBlocks) -> Iterator[str]:
    if len(blocks) < MIN_BLOCKS:
        yield (
            f"{len(blocks)} seconds of different motion: the standard deviations are themselves uncertain with fewer "
            f"than {MIN_BLOCKS}; record more"
        )


def _sign_warnings(model: IdentificationModel, values: Array, deviations: Array, seen: BoolArray) -> Iterator[str]:
    for kind, (meaning, remedy) in SIGN_REMEDIES.items():
        negative = [
            f"{name} {value / deviation:.1f}"
            for name, value, deviation, is_seen in zip(model.names, values, deviations, seen, strict=True)
            if name.startswith(f"{kind}.") and is_seen and value < -SIGNIFICANT_DEVIATIONS * deviation
        ]
        if negative:
            yield f"negative {meaning} (in standard deviations: {', '.join(negative)}): {remedy}"
