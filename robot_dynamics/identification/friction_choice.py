"""Choice of the friction model of each joint by the residuals of held-out data.

The candidates of a joint are the models of `friction_terms`; the Stribeck velocity is one of STRIBECK_FRACTIONS of the
speed of the joint. The recordings are read once, with the columns of all candidates. Each second of motion is predicted
by a fit to the others. The residuals of a joint depend on the terms of other joints hardly at all, so a candidate is
tried at all joints together. In each round every joint takes the best of its candidates, if there is one that

* makes the RMS of its held-out residuals smaller by MIN_IMPROVEMENT at least, and by MIN_SHARE of what it was with
  viscous and Coulomb friction only,
* does so in the mean over blocks, beyond the scatter between them (Student's t, one-sided, SIGNIFICANCE), and
* has values that a joint can have: friction that opposes motion in both directions, at every velocity.

A term that the truth does not have makes held-out residuals larger, and never smaller by MIN_IMPROVEMENT but by chance.
Data for validation are not used, so that they stay data that nothing was chosen by.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from scipy.stats import t as student

from robot_dynamics.identification.friction_terms import (
    MAX_LOAD_FRICTION,
    PARAMETER_OF_MODEL,
    STRIBECK_PARAMETER,
    FrictionTerm,
    possible_models,
)
from robot_dynamics.identification.held_out_fits import HeldOutData

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.held_out_fits import HeldOutFit
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.identification.sample_sums import FactorSums

STRIBECK_FRACTIONS = (0.01, 0.02, 0.04, 0.08, 0.16, 0.32, 0.64)  # of the largest speed of a joint, mean of a second
MIN_IMPROVEMENT = 0.05  # of the RMS of the held-out residuals of a joint
MIN_SHARE = 0.02  # of the RMS with viscous and Coulomb friction only: smaller errors are those of the other terms
SIGNIFICANCE = 0.975  # probability that the improvement is not by the scatter between blocks

Candidate: TypeAlias = tuple[str, float]
"""A model, and for Stribeck friction the velocity as a fraction of the speed of each joint."""


@dataclass(frozen=True, eq=False)
class FrictionChoice:
    """Friction models that were chosen for n joints.

    terms: of the chosen models, with one velocity each; plain_rms, chosen_rms: (n,) RMS of held-out residuals with
    viscous and Coulomb friction, and with the chosen models.
    """

    terms: tuple[FrictionTerm, ...]
    plain_rms: Array
    chosen_rms: Array

    def models(self, joint: int) -> tuple[str, ...]:
        """Names of the models that a joint has beside viscous and Coulomb friction."""
        parameters = {term.parameter for term in self.terms if term.joint == joint}
        return tuple(model for model, parameter in PARAMETER_OF_MODEL.items() if parameter in parameters)


def candidate_terms(fit: Fit, models: Collection[str]) -> tuple[FrictionTerm, ...]:
    """Terms of all candidates for the model of a fit with viscous and Coulomb friction."""
    model = fit.model
    speeds = fit.blocks.motions.travel.max(axis=0)  # of blocks of a second
    terms: list[FrictionTerm] = []
    for name, joint in possible_models(model.dynamics, model.drives.excludes_gravity):
        if name not in models or not speeds[joint] > 0:
            continue
        parameter = PARAMETER_OF_MODEL[name]
        fractions = STRIBECK_FRACTIONS if parameter == STRIBECK_PARAMETER else (0.0,)
        terms += [FrictionTerm(parameter, joint, fraction * float(speeds[joint])) for fraction in fractions]
    return tuple(terms)


def choose_friction(fit: Fit, model: IdentificationModel, sums: FactorSums, *, required: bool) -> FrictionChoice:
    """Choose friction models by held-out data.

    Parameters
    ----------
    fit : Fit
        Fit with viscous and Coulomb friction.
    model : IdentificationModel
        The same model with the terms of all candidates.
    sums : FactorSums
        Factors of the columns of this model, over the fitted recordings.
    required : bool
        Whether every joint gets every model that it has candidates for. The velocities are chosen only.
    """
    blocks = sums.blocks
    factors = sums.factors
    assert blocks is not None and factors is not None  # the same samples were fitted before
    search = _Search(fit, HeldOutData(model, blocks, factors, fit.weights, fit.white_share))
    kept = search.plain_columns
    current = plain = search.data.fit(kept)
    for _ in range(len(PARAMETER_OF_MODEL)):
        taken = dict(search.best_candidates(kept, current, required=required))
        if not taken:
            break
        kept = kept.copy()
        kept[list(taken.values())] = True
        current = search.data.fit(kept)
    if not required:
        kept = search.without_useless_terms(kept, plain, current)
        current = search.data.fit(kept)
    chosen = tuple(term for column, term in search.terms.items() if kept[column])
    return FrictionChoice(chosen, search.rms(plain), search.rms(current))


@dataclass(frozen=True, eq=False)
class _Search:
    """Fits of some of the candidates at a time."""

    plain: Fit
    data: HeldOutData

    @cached_property
    def terms(self) -> dict[int, FrictionTerm]:
        """Terms by the numbers of their columns."""
        model = self.data.model
        return dict(enumerate(model.terms, start=len(model.parameter_indices)))

    @property
    def plain_columns(self) -> BoolArray:
        """Columns (P,) without those of candidates."""
        columns = np.ones(len(self.data.model.names), dtype=bool)
        columns[list(self.terms)] = False
        return columns

    def rms(self, fit: HeldOutFit) -> Array:
        """RMS (n,) of held-out residuals."""
        rms: Array = np.sqrt(fit.squares.sum(axis=0) / np.maximum(self.plain.factors.samples, 1))
        return rms

    def best_candidates(self, kept: BoolArray, current: HeldOutFit, *, required: bool) -> Iterator[tuple[int, int]]:
        """For each joint that has a useful candidate, the number of the joint and the column of the best candidate.

        kept: (P,) columns of the current fit.
        """
        has = {(self.terms[column].joint, self.terms[column].parameter) for column in self.terms if kept[column]}
        best: dict[int, tuple[float, int]] = {}
        for columns in self._trials(has):
            trial = kept.copy()
            trial[columns] = True
            fit = self.data.fit(trial)
            is_better = self._is_better(current, fit)
            for column in columns:
                joint = self.terms[column].joint
                squares = float(fit.squares[:, joint].sum())
                useful = required or (is_better[joint] and self._is_physical(fit.values, trial, joint))
                if useful and squares < best.get(joint, (np.inf, 0))[0]:
                    best[joint] = squares, column
        for joint, (_, column) in best.items():
            yield joint, column

    def without_useless_terms(self, kept: BoolArray, plain: HeldOutFit, current: HeldOutFit) -> BoolArray:
        """Drop the terms of joints that are not better with all terms together."""
        is_better = self._is_better(plain, current)
        useful: BoolArray = np.array(kept)
        for column, term in self.terms.items():
            useful[column] = kept[column] and is_better[term.joint]
        return useful

    def _trials(self, has: Collection[tuple[int, str]]) -> Iterator[list[int]]:
        """Columns that are tried together: at most one of each joint, of one model, at one fraction of the speed."""
        by_rank: dict[tuple[str, int], list[int]] = {}
        ranks: dict[tuple[int, str], int] = {}
        for column, term in self.terms.items():
            key = term.joint, term.parameter
            rank = ranks[key] = ranks.get(key, -1) + 1
            if key not in has:
                by_rank.setdefault((term.parameter, rank), []).append(column)
        yield from by_rank.values()

    def _is_better(self, before: HeldOutFit, after: HeldOutFit) -> BoolArray:
        """Whether the residuals of each joint (n,) are smaller, beyond the scatter between blocks."""
        least_gain = np.maximum(MIN_IMPROVEMENT * self.rms(before), MIN_SHARE * self.plain.held_out_rms)
        is_large: BoolArray = self.rms(after) < self.rms(before) - least_gain
        return is_large & is_significantly_smaller(before.squares, after.squares)

    def _is_physical(self, values: Array, kept: BoolArray, joint: int) -> bool:
        """Whether a joint can have the friction among values (P,), as far as it could before."""
        name = self.data.model.dynamics.joint_names[joint]
        names = self.data.model.names
        friction = {
            key.partition(".")[0]: float(value)
            for key, value, is_kept in zip(names, values, kept, strict=True)
            if is_kept and key.partition(".")[2] == name
        }
        before = dict(zip(self.plain.model.names, self.plain.values.tolist(), strict=True))
        viscous = friction.get("Fv", 0.0) - min(before.get(f"Fv.{name}", 0.0), 0.0)
        coulomb = friction.get("Fs", 0.0) - min(before.get(f"Fs.{name}", 0.0), 0.0)
        opposes_motion = viscous >= abs(friction.get("Fva", 0.0)) and coulomb + min(friction.get("Fst", 0.0), 0.0) >= 0
        return bool(opposes_motion and 0 <= friction.get("mu", 0.0) <= MAX_LOAD_FRICTION)


def is_significantly_smaller(before: Array, after: Array) -> BoolArray:
    """Whether the sums of squares (B, n) of n joints are smaller in the mean over B blocks, by a paired t-test."""
    gains = before - after
    count = len(gains)
    if count < 2:
        return np.zeros(gains.shape[1], dtype=bool)
    scatter = gains.std(axis=0, ddof=1) / np.sqrt(count)
    smaller: BoolArray = gains.mean(axis=0) > float(student.ppf(SIGNIFICANCE, count - 1)) * scatter
    return smaller
