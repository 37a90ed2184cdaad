"""Which limits are drawn as lines: those near the values of a plot, since a far one would flatten the curves."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

NEAR = 0.6
"""A limit is drawn as a line up to this distance from the values, relative to their range or size."""


def is_near(limit: float, values: Array) -> bool:
    """Return whether a limit is near values (N,), or among them."""
    low, high = float(values.min()), float(values.max())
    reach = NEAR * max(high - low, abs(low), abs(high))
    return low - reach <= limit <= high + reach
