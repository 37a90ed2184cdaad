"""Simpler models that are fitted beside the chosen one, and compared by residuals of data that they have not seen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.identification.block_scatter import held_out_squares
from robot_dynamics.identification.description_prior import build_description_prior
from robot_dynamics.identification.seen_directions import drop_uncertain_directions, solve_seen_directions
from robot_dynamics.identification.triangular_factors import TriangularFactors

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.fitting import Fit

MIN_IMPROVEMENT = 0.01  # of the held-out residuals, below which an alternative is not suggested
ROTOR_PREFIX = "Ia."


@dataclass(frozen=True, eq=False)
class Alternative:
    """A model with another option.

    Attributes
    ----------
    option : str
        Option of the command line that selects the model.
    held_out_rms : (n,) array
        RMS residual of each joint in blocks that were left out of the fit.
    change : float
        Change of the weighted RMS of all joints, relative to that of the chosen model; negative: better.
    """

    option: str
    held_out_rms: Array
    change: float

    @property
    def is_better(self) -> bool:
        """Whether the alternative is worth a suggestion."""
        return self.change < -MIN_IMPROVEMENT


def try_alternatives(fit: Fit) -> tuple[Alternative, ...]:
    """Fit the alternatives to the blocks of a fit, with the same weights."""
    b = len(fit.model.parameter_indices)
    is_rotor = np.array([name.startswith(ROTOR_PREFIX) for name in fit.model.names])
    is_rotor[b:] = False
    if not is_rotor.any():
        return ()
    rms = _held_out_rms(fit, ~is_rotor)
    samples = fit.factors.samples
    squares, chosen = ((fit.weights * samples * values**2).sum() for values in (rms, fit.held_out_rms))
    return (Alternative("--no-rotor-inertia", rms, float(np.sqrt(squares / chosen) - 1)),)


def _held_out_rms(fit: Fit, kept: BoolArray) -> Array:
    """RMS residuals (n,) of left-out blocks for a fit of some of the parameters (P,); the others are zero."""
    columns = np.append(np.flatnonzero(kept), len(kept))
    factors = [TriangularFactors(part.triangles[..., columns], part.samples) for part in fit.blocks.factors]
    blocks = replace(fit.blocks, factors=tuple(factors))
    total = TriangularFactors(fit.factors.triangles[..., columns], fit.factors.samples)
    indices = tuple(index for index, is_kept in zip(fit.model.parameter_indices, kept, strict=False) if is_kept)
    names = tuple(name for name, is_kept in zip(fit.model.names, kept, strict=True) if is_kept)
    model = replace(fit.model, parameter_indices=indices, names=names)
    prior = build_description_prior(model, total.effort_rms)
    solution = solve_seen_directions(total, prior, fit.weights, fit.white_share)
    solution, _ = drop_uncertain_directions(blocks, total, prior, solution, fit.white_share)
    squares = held_out_squares(blocks, solution.weights, solution.directions, solution.values)
    rms: Array = np.sqrt(squares / np.maximum(total.samples, 1))
    return rms
