"""Fit of a payload: mass, centre of mass and inertia of what a link carries, with standard deviations.

The ten parameters are those about a point, the estimated centre of mass, in units of what a body of this mass may
have. Directions that the recordings do not show better than that keep zero there: a point mass at the centre. As the
centre is an estimate itself, the fit is repeated until it does not move. Along axes on which the recordings do not
determine the centre, the point has the coordinate of the origin. The estimate is then replaced by the physically
consistent parameters that are nearest to it, in units of its uncertainty.

The uncertainty has three parts: the scatter between seconds of motion; the scatter between joints, whose gains and
friction are wrong for the whole recording; and the scale of all efforts, which no recording of one robot shows.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import block_diag

from robot_dynamics.identification.block_scatter import joint_covariance
from robot_dynamics.identification.description_prior import (
    CHARACTERISTIC_LENGTH,
    MIN_MASS,
    DescriptionPrior,
    build_description_prior,
)
from robot_dynamics.identification.determination import EFFORT_ACCURACY, MAX_WELL_DETERMINED, MOTIONS
from robot_dynamics.identification.fit_warnings import block_warnings
from robot_dynamics.identification.fitting import (
    MAX_DEVIATION_OF_SEEN,
    REWEIGHTING_ITERATIONS,
    require_enough_samples,
    solution_variances,
)
from robot_dynamics.identification.motion_samples import sample_random_motions
from robot_dynamics.identification.payload_model import (
    PAYLOAD_COUNT,
    parameter_transformation,
    to_inertia,
    to_parameters,
)
from robot_dynamics.identification.physical_consistency import nearest_consistent_parameters
from robot_dynamics.identification.seen_directions import (
    drop_uncertain_directions,
    error_covariance,
    solve_seen_directions,
)
from robot_dynamics.model.placement import placement
from robot_dynamics.newton_euler.friction import has_load_friction

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.payload_model import PayloadModel
    from robot_dynamics.identification.sample_sums import FactorSums, FitQuality
    from robot_dynamics.identification.samples import Samples
    from robot_dynamics.identification.seen_directions import SeenSolution
    from robot_dynamics.identification.triangular_factors import TriangularFactors
    from robot_dynamics.model.inertia import Inertia

MAX_ITERATIONS = 10  # of the point about which parameters are fitted
CENTRE_TOLERANCE = 1e-4  # [m]
SCALE_TOLERANCE = 0.05  # relative, of the mass in units of which parameters are fitted
FIRST_MASS = 1000.0  # [kg] scale of the mass in the first iteration
RADIUS_OF_GYRATION = 0.1  # [m] scale of inertias about the centre of mass
MIN_VARIANCE_RATIO = 1e-14  # of variances of scaled parameters: smaller ones are rounding errors
MIN_DEVIATION = 1e-3  # of the scales of the parameters: lengths, gravity and clocks are not known better
MAX_INCONSISTENCY = 3.0  # standard deviations between the estimate and the nearest body
LOAD_FRICTION_PASSES = 3  # of the fit, where friction grows with the load


@dataclass(frozen=True, eq=False)
class PayloadFit:
    """A payload that was identified.

    Attributes
    ----------
    inertia : Inertia
        Physically consistent inertia in the frame that carries the payload.
    centre : (3,) array
        Centre of mass in this frame [m].
    central_inertia : (3, 3) array
        Inertia about the centre of mass, along the axes of the frame [kg m²].
    deviations : (10,) array
        Standard deviations: of the six entries of the inertia about the centre [kg m²], of the centre [m], of the mass
        [kg].
    determined : (10,) array of bool
        Which of these values the recordings determine: none if the estimated mass is negative.
    prediction_error : float
        Standard deviation of the efforts that the payload needs in random motions within the joint limits, relative to
        these efforts, over all joints; infinite if the estimated mass is negative.
    unconstrained : (10,) array
        LINK_PARAMETERS of the least-squares estimate, which no body may have.
    values : (P,) array
        Values of all parameters of the model.
    blocks : int
        Number of seconds of motion that count as independent.
    quality : FitQuality
        Residuals of the fit.
    empty_quality : FitQuality
        Residuals of the robot without payload.
    warnings : tuple of str
        Sentences on recordings that are too short, and on an estimate that is far from any body.
    notes : dict
        Sentences on samples that were left out, by the name of the recording.
    """

    inertia: Inertia
    centre: Array
    central_inertia: Array
    deviations: Array
    determined: BoolArray
    prediction_error: float
    unconstrained: Array
    values: Array
    blocks: int
    quality: FitQuality
    empty_quality: FitQuality
    warnings: tuple[str, ...]
    notes: dict[str, tuple[str, ...]]

    @property
    def is_determined(self) -> bool:
        """Whether the mass is determined, and the efforts for the payload in other motions are.

        A robot that cannot turn its payload needs no centre of mass.
        """
        return bool(self.determined[-1]) and self.prediction_error <= MAX_WELL_DETERMINED


def fit_payload(
    samples_of: Callable[[PayloadModel], Samples[PayloadModel]],
    model: PayloadModel,
    *,
    effort_accuracy: float = EFFORT_ACCURACY,
) -> PayloadFit:
    """Fit a payload to samples.

    Parameters
    ----------
    samples_of : callable
        Returns the samples with the columns of a model.
    model : PayloadModel
        Model without an estimate of the payload.
    effort_accuracy : float
        Relative standard deviation of the scale of the measured efforts, which is that of the mass at least.

    Returns
    -------
    PayloadFit
        The payload, with its uncertainty.

    Raises
    ------
    RecordingError
        If there are too few samples, or the recordings cannot be used.
    MissingPackageError
        If the estimate is no body, and clarabel is not installed.
    """
    samples = samples_of(model)
    empty_quality = samples.quality(np.zeros(len(model.names)))
    fit = _fit_samples(samples, empty_quality, effort_accuracy)
    if has_load_friction(model.dynamics.robot):
        for _ in range(LOAD_FRICTION_PASSES - 1):
            samples = samples_of(model.with_estimate(to_parameters(fit.inertia)))
            fit = _fit_samples(samples, empty_quality, effort_accuracy)
    return fit


def _fit_samples(samples: Samples[PayloadModel], empty_quality: FitQuality, effort_accuracy: float) -> PayloadFit:
    """Fit a payload; empty_quality: residuals of the robot without payload."""
    model = samples.model
    sums = samples.accumulate_factors()
    factors, share = require_enough_samples(sums)
    assert sums.blocks is not None  # `require_enough_samples` refuses samples without blocks
    centre = np.zeros(3)
    scale = FIRST_MASS
    for _ in range(MAX_ITERATIONS):
        solution, covariance = _solve(model, sums, factors, share, centre, scale)
        previous = centre, scale
        centre, scale = _next_scales(to_inertia(solution.values[:PAYLOAD_COUNT]), covariance, centre)
        if np.abs(centre - previous[0]).max() < CENTRE_TOLERANCE and abs(scale / previous[1] - 1) < SCALE_TOLERANCE:
            break
    estimate = solution.values[:PAYLOAD_COUNT]
    seen_values, covariance = _keep_seen_directions(estimate, covariance, centre, scale)
    values = solution.values.copy()
    values[:PAYLOAD_COUNT] = _consistent(seen_values, covariance, scale)
    warnings = (*block_warnings(sums.blocks), *_consistency_warnings(seen_values, values, covariance))
    covariance = covariance + effort_accuracy**2 * np.outer(values[:PAYLOAD_COUNT], values[:PAYLOAD_COUNT])
    inertia = to_inertia(values[:PAYLOAD_COUNT])
    mass = max(inertia.mass, MIN_MASS)
    centre = inertia.first_moments / mass
    to_centre = np.linalg.inv(parameter_transformation(placement(translation=centre)))
    deviations = np.sqrt(np.diagonal(to_centre @ covariance @ to_centre.T))
    determined = (deviations < MAX_DEVIATION_OF_SEEN * _scales(mass)) & (estimate[-1] > 0)
    prediction_error = _prediction_error(model, values[:PAYLOAD_COUNT], covariance) if estimate[-1] > 0 else np.inf
    return PayloadFit(
        inertia=inertia,
        centre=centre,
        central_inertia=to_inertia(to_centre @ to_parameters(inertia)).second_moments,
        deviations=deviations / np.array([1.0] * 6 + [mass] * 3 + [1.0]),
        determined=determined,
        prediction_error=prediction_error,
        unconstrained=estimate,
        values=values,
        blocks=len(sums.blocks),
        quality=samples.quality(values),
        empty_quality=empty_quality,
        warnings=warnings,
        notes=samples.notes,
    )


def _prediction_error(model: PayloadModel, values: Array, covariance: Array) -> float:
    """Relative standard deviation of the efforts for a payload (10,) in random motions."""
    motions = sample_random_motions(model.dynamics, MOTIONS)
    X = model.payload_regressor_at(motions.q, motions.qd, motions.qdd, motions.base)
    variance = np.einsum("Njp,pq,Njq->", X, covariance, X)
    return float(np.sqrt(max(variance, 0.0) / max(np.square(X @ values).sum(), 1e-300)))


def _consistency_warnings(estimate: Array, values: Array, covariance: Array) -> Iterator[str]:
    """Warn of an estimate (10,) that is far from that of a body."""
    difference = (values[:PAYLOAD_COUNT] - estimate) / np.sqrt(np.diagonal(covariance))
    if np.abs(difference).max() > MAX_INCONSISTENCY:
        yield (
            f"the least-squares estimate is {np.abs(difference).max():.1f} standard deviations from that of any body: "
            "check that the description is that of the robot without load, with its --drives, and that --link carries "
            "the payload"
        )


def _scales(mass: float) -> Array:
    """Scales (10,) of LINK_PARAMETERS about the centre of a body of a mass [kg]."""
    return mass * np.array([RADIUS_OF_GYRATION**2] * 6 + [CHARACTERISTIC_LENGTH] * 3 + [1.0])


def _solve(
    model: PayloadModel, sums: FactorSums, factors: TriangularFactors, share: float, centre: Array, mass: float
) -> tuple[SeenSolution, Array]:
    """Fit the parameters, those of the payload about a point (3,), and estimate their covariance (10, 10)."""
    assert sums.blocks is not None  # `require_enough_samples` refuses samples without blocks
    efforts = factors.effort_rms
    root = parameter_transformation(placement(translation=centre)) * _scales(mass)
    prior = DescriptionPrior(np.zeros(len(model.names)), block_diag(root, _other_root(model, efforts)))
    weights = 1 / np.maximum(efforts, 1e-6 * efforts.max()) ** 2
    solution = solve_seen_directions(factors, prior, weights, 0.0)
    for _ in range(REWEIGHTING_ITERATIONS):
        weights = 1 / solution_variances(factors, solution)
        solution = solve_seen_directions(factors, prior, weights, share)
    solution, scatter = drop_uncertain_directions(sums.blocks, factors, prior, solution, share)
    covariance, _ = error_covariance(prior, solution, scatter, share)
    by_joint = joint_covariance(factors, solution.weights, solution.directions, solution.values)
    directions = solution.directions[:PAYLOAD_COUNT]
    payload_covariance = covariance[:PAYLOAD_COUNT, :PAYLOAD_COUNT]
    return solution, _larger_covariance(payload_covariance, directions @ by_joint @ directions.T)


def _larger_covariance(first: Array, second: Array) -> Array:
    """The covariance (k, k) with the larger variance of two in each direction in which they differ."""
    scale = np.sqrt(np.diagonal(first))
    variances, axes = np.linalg.eigh(first / scale / scale[:, None])
    deviations = np.sqrt(np.maximum(variances, MIN_VARIANCE_RATIO * variances.max()))  # some are zero but for rounding
    root = axes * deviations
    inverse = axes.T / deviations[:, None]
    ratios, vectors = np.linalg.eigh(inverse @ (second / scale / scale[:, None]) @ inverse.T)
    root = scale[:, None] * (root @ vectors) * np.sqrt(np.maximum(ratios, 1))
    larger: Array = root @ root.T
    return larger


def _other_root(model: PayloadModel, efforts: Array) -> Array:
    """Root of the covariance of the other parameters before the fit; efforts: (n,) RMS of what is to be explained."""
    levels = np.maximum(efforts, 1e-6 * efforts.max())
    if model.empty_recordings:
        return build_description_prior(model.model, levels).root
    return np.diag(np.tile(levels, 3))


def _next_scales(payload: Inertia, covariance: Array, centre: Array) -> tuple[Array, float]:
    """The centre of mass (3,) and the mass [kg] about which and in units of which the next iteration fits.

    payload, covariance (10, 10): estimates about a centre (3,). The centre moves along the axes along which it is
    determined. Along others a heavy body that is near needs the efforts of a light one that is far, and it is zero.
    Without a mass there is no centre: first moments alone are those of a body of any mass.
    """
    moments_about_centre = payload.first_moments - payload.mass * centre
    mass = float(np.hypot(payload.mass, np.linalg.norm(moments_about_centre) / CHARACTERISTIC_LENGTH))
    mass = max(mass, MIN_MASS)
    _, covariance = _keep_seen_directions(np.zeros(PAYLOAD_COUNT), covariance, centre, mass)
    if covariance[-1, -1] >= (MAX_DEVIATION_OF_SEEN * mass) ** 2:
        return np.zeros(3), mass
    to_centre = np.linalg.inv(parameter_transformation(placement(translation=centre)))
    of_moments = (to_centre @ covariance @ to_centre.T)[6:9, 6:9]
    variances, axes = np.linalg.eigh(of_moments / (mass * CHARACTERISTIC_LENGTH) ** 2)
    axes = axes[:, variances < MAX_DEVIATION_OF_SEEN**2]
    return axes @ (axes.T @ payload.first_moments) / np.copysign(mass, payload.mass), mass


def _keep_seen_directions(values: Array, covariance: Array, centre: Array, mass: float) -> tuple[Array, Array]:
    """Return values (10,) and covariance (10, 10) with those of a point mass in directions that are not determined.

    A direction is determined if its deviation is below half of what a body of this mass may have.
    """
    root = parameter_transformation(placement(translation=centre)) * _scales(mass)
    inverse = np.linalg.inv(root)
    variances, vectors = np.linalg.eigh(inverse @ covariance @ inverse.T)
    is_seen = variances < MAX_DEVIATION_OF_SEEN**2
    coordinates = (vectors.T @ inverse @ values) * is_seen
    directions = root @ vectors
    variances = np.where(is_seen, np.maximum(variances, MIN_DEVIATION**2), 1.0)
    return directions @ coordinates, (directions * variances) @ directions.T


def _consistent(values: Array, covariance: Array, mass: float) -> Array:
    """The physically consistent parameters (10,) that are nearest to values, which are returned if they are."""
    inertia = to_inertia(values)
    if inertia.mass > 0 and not inertia.find_inconsistencies():
        return values
    return nearest_consistent_parameters(values, covariance, _scales(mass))
