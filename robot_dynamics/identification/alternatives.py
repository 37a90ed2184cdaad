"""Simpler models that are fitted beside the chosen one, and compared by residuals of data that they have not seen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.identification.held_out_fits import HeldOutData

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
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
    is_rotor = np.array([name.startswith(ROTOR_PREFIX) for name in fit.model.names])
    is_rotor[fit.model.robot_count :] = False
    if not is_rotor.any():
        return ()
    samples = fit.factors.samples
    data = HeldOutData(fit.model, fit.blocks, fit.factors, fit.weights, fit.white_share)
    held_out = data.fit(~is_rotor)
    rms = np.sqrt(held_out.squares.sum(axis=0) / np.maximum(samples, 1))
    squares, chosen = ((fit.weights * samples * values**2).sum() for values in (rms, fit.held_out_rms))
    return (Alternative("--no-rotor-inertia", rms, float(np.sqrt(squares / chosen) - 1)),)
