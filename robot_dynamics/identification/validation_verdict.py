"""Comparison of residuals on data that a fit has not seen with those on the data that were fitted."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.identification.sample_sums import FitQuality

MAX_VALIDATION_GROWTH = 1.5  # RMS of the validation over that of the fit, beyond which the fit does not hold
MIN_FAILING_PART = 0.02  # RMS of the validation over the spread of the efforts, below which it holds in any case


def validation_growth(fitted: FitQuality, validated: FitQuality) -> Array:
    """RMS (n,) on data that were not fitted over the RMS on fitted data; nan for joints that rest in one of both."""
    moves = (fitted.rms > 0) & (validated.rms > 0)
    growth: Array = np.where(moves, validated.rms / np.where(moves, fitted.rms, 1.0), np.nan)
    return growth


def failed_validations(fitted: FitQuality, validated: FitQuality) -> BoolArray:
    """Whether each joint (n,) is predicted much worse on data that were not fitted."""
    growth = np.nan_to_num(validation_growth(fitted, validated))
    failed: BoolArray = (growth > MAX_VALIDATION_GROWTH) & (validated.rms > MIN_FAILING_PART * validated.spread)
    return failed
