"""Rest: times at which a joint does not move, so that its friction is not a function of its velocity.

A joint at rest holds any effort within its static friction. Where it begins or ceases to move, friction is that of the
deformation of the contact (pre-sliding). At these times a model of friction predicts an interval, not a value.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from scipy.ndimage import maximum_filter1d, minimum_filter1d

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

REST_WINDOW = 0.2  # [s] duration within which a joint at rest travels less than
MAX_REST_TRAVEL = 1e-3  # [rad or m]
MARGIN_PERIODS = 1.0  # periods of the cut-off before and after a rest, into which the filter spreads it


def moving_samples(q: Array, rate: float, cutoff: float) -> BoolArray:
    """Samples at which joints move.

    Parameters
    ----------
    q : (N, n) positions [rad or m], filtered.
    rate : samples per second.
    cutoff : cut-off frequency of the filter [Hz].

    Returns
    -------
    (N, n)
        False where a joint is at rest, or begins or ceases to move.
    """
    window = 2 * max(1, round(0.5 * REST_WINDOW * rate)) + 1
    travel = maximum_filter1d(q, window, axis=0) - minimum_filter1d(q, window, axis=0)
    margin = window // 2 + int(rate * MARGIN_PERIODS / cutoff)
    moving: BoolArray = minimum_filter1d((travel > MAX_REST_TRAVEL).astype(int), 2 * margin + 1, axis=0) > 0
    return moving
