"""Fits of some of the columns of a model, compared by the residuals of blocks that were left out of the fit.

All fits come from the triangular factors of the blocks; the recordings are not read again.
"""

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
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.identification.motion_blocks import MotionBlocks


@dataclass(frozen=True, eq=False)
class HeldOutFit:
    """A fit of some of the P parameters of a model.

    values: (P,), zero for the others; squares: (B, n) sums of squared residuals of B blocks, each for a fit without
    this block.
    """

    values: Array
    squares: Array


@dataclass(frozen=True, eq=False)
class HeldOutData:
    """Factors of all P columns of a model.

    factors: of the rows of all blocks; weights: (n,) of the squared residuals of each joint; white_share: number of
    independent samples per row.
    """

    model: IdentificationModel
    blocks: MotionBlocks
    factors: TriangularFactors
    weights: Array
    white_share: float

    def fit(self, selected: BoolArray) -> HeldOutFit:
        """Fit the selected ones (P,) of the parameters."""
        columns = np.append(np.flatnonzero(selected), len(selected))
        parts = [TriangularFactors(part.triangles[..., columns], part.samples) for part in self.blocks.factors]
        blocks = replace(self.blocks, factors=tuple(parts))
        factors = TriangularFactors(self.factors.triangles[..., columns], self.factors.samples)
        prior = build_description_prior(self.model.select_parameters(selected), factors.effort_rms)
        solution = solve_seen_directions(factors, prior, self.weights, self.white_share)
        solution, _ = drop_uncertain_directions(blocks, factors, prior, solution, self.white_share)
        values = np.zeros(len(selected))
        values[selected] = solution.values
        return HeldOutFit(values, held_out_squares(blocks, solution.weights, solution.directions, solution.values))
