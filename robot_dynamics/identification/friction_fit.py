"""Model with fitted friction of the joints: the choice of its terms, and what is not linear in them.

Loads are those of the parameters that were fitted before, and Stribeck velocities are moved by the shift that a fit
shows. Both are repeated.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.identification.fitting import solve_parameters
from robot_dynamics.identification.friction_choice import candidate_terms, choose_friction
from robot_dynamics.identification.friction_terms import SHIFT_PARAMETER, STRIBECK_PARAMETER, with_shifts

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.friction_choice import FrictionChoice
    from robot_dynamics.identification.friction_terms import FrictionTerm
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.identification.samples import Samples

REFINEMENTS = 2
MAX_SHIFT = np.log(2.0)  # of the logarithm of a Stribeck velocity: from one candidate to the next
MIN_CHANGE = 0.05  # of Stribeck velocities and of loads, relative, below which refinements end

SamplesFunction: TypeAlias = "Callable[[IdentificationModel], Samples[IdentificationModel]]"
"""The samples that are fitted, with the columns of a model."""


def choose_friction_model(
    fit: Fit, samples_of: SamplesFunction, models: Collection[str], *, required: bool
) -> tuple[IdentificationModel, FrictionChoice]:
    """Add terms of friction to the model of a fit with viscous and Coulomb friction.

    Parameters
    ----------
    fit : Fit
        Fit with viscous and Coulomb friction, to the samples.
    samples_of : callable
        Samples that were fitted, with the columns of another model.
    models : collection of str
        Names of friction models, among those of `friction_terms.PARAMETER_OF_MODEL`.
    required : bool
        Whether all joints that can have these models get them; else they are chosen by held-out data.

    Returns
    -------
    model : IdentificationModel
        Model to fit the samples with.
    choice : FrictionChoice
        What was chosen.
    """
    values = fit.values[: len(fit.model.parameter_indices)]
    wide = fit.model.with_terms(candidate_terms(fit, models), values)
    samples = samples_of(wide)
    if fit.method == "robust":
        columns = np.ones(len(wide.names), dtype=bool)
        columns[len(values) : wide.robot_count] = False
        padded = np.zeros(len(columns))
        padded[columns] = fit.values
        sums = samples.accumulate_factors(padded, 1 / np.sqrt(fit.weights))
    else:
        sums = samples.accumulate_factors()
    choice = choose_friction(fit, wide, sums, required=required)
    model = fit.model.with_terms(tuple(with_shifts(choice.terms)), values)
    return _refine(model, fit, samples_of), choice


def _refine(model: IdentificationModel, fit: Fit, samples_of: SamplesFunction) -> IdentificationModel:
    """Return the model with loads of its own fit, and the best Stribeck velocities."""
    initial = {term.joint: term.velocity for term in model.terms if term.parameter == STRIBECK_PARAMETER}
    has_load = model.has_load_terms
    b = len(model.parameter_indices)
    for _ in range(REFINEMENTS if initial or has_load else 0):
        values = solve_parameters(samples_of(model), method=fit.method).solution.values
        terms = tuple(_shifted(term, values[b:], model.terms, initial) for term in model.terms)
        ratios = [new.velocity / old.velocity for new, old in zip(terms, model.terms, strict=True) if old.velocity]
        changes = [abs(ratio - 1) for ratio in ratios]
        if has_load and model.load_values is not None:
            changes.append(float(np.linalg.norm(values[:b] - model.load_values) / np.linalg.norm(values[:b])))
        model = model.with_terms(terms, values[:b])
        if max(changes) < MIN_CHANGE:
            break
    return model


def _shifted(
    term: FrictionTerm, values: Array, terms: tuple[FrictionTerm, ...], initial: dict[int, float]
) -> FrictionTerm:
    """Return a term with the Stribeck velocity that the values (T,) of all terms show.

    initial: velocity of each joint at the beginning, from which the result differs by MAX_SHIFT at most.
    """
    if term.parameter not in (STRIBECK_PARAMETER, SHIFT_PARAMETER):
        return term
    values_of_joint = {
        parameter: float(value)
        for (parameter, joint, _), value in zip(terms, values, strict=False)
        if joint == term.joint
    }
    stribeck = values_of_joint[STRIBECK_PARAMETER]
    step = values_of_joint[SHIFT_PARAMETER] / stribeck if stribeck else 0.0
    logarithm = np.log(term.velocity) + np.clip(step, -MAX_SHIFT, MAX_SHIFT)
    start = np.log(initial[term.joint])
    return term._replace(velocity=float(np.exp(np.clip(logarithm, start - MAX_SHIFT, start + MAX_SHIFT))))
