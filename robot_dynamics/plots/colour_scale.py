"""Colour scales of maps: chosen by the quantity and in round numbers, so that maps can be compared."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

ROUND_STEPS = (1.0, 2.0, 3.0, 5.0)
"""Numbers of a decade at which a logarithmic scale begins, ends and has contours."""
LEVELS = 15
"""Most round numbers of a scale that is not logarithmic."""


class ColourScale(NamedTuple):
    """The range of a quantity that a map draws, in its unit. It is logarithmic if it spans more than a decade."""

    lower: float
    upper: float

    @property
    def is_logarithmic(self) -> bool:
        """Whether equal ratios have equal distances in colour."""
        return self.upper > 10 * self.lower > 0

    @property
    def levels(self) -> Array:
        """(k,) round numbers within the range, for contours and for the marks of the scale."""
        if self.is_logarithmic:
            decades = np.arange(np.floor(np.log10(self.lower)), np.ceil(np.log10(self.upper)) + 1)
            numbers = np.outer(10.0**decades, ROUND_STEPS).ravel()
        else:
            step = _round_number((self.upper - self.lower) / LEVELS, up=True)
            numbers = step * np.arange(np.ceil(self.lower / step - 1e-9), np.floor(self.upper / step + 1e-9) + 1)
        rounding = 1e-9 * (self.lower if self.is_logarithmic else self.upper - self.lower)
        return np.asarray(numbers[(numbers >= self.lower - rounding) & (numbers <= self.upper * (1 + 1e-9))])


CONDITION_SCALE = ColourScale(1.0, 100.0)
"""Of condition numbers, for all robots: 1 is the best; from 100 on a viewer draws a robot as singular."""


def fit_scale(values: Array) -> ColourScale:
    """Return the smallest scale in round numbers that contains finite values, not negative, of any shape."""
    finite = values[np.isfinite(values)]
    if not len(finite) or finite.max() <= 0:
        return ColourScale(0.0, 1.0)
    low, high = float(finite.min()), float(finite.max())
    if high > 10 * low > 0:
        return ColourScale(_round_number(low, up=False), _round_number(high, up=True))
    step = _round_number(max(high - low, 1e-3 * high) / LEVELS, up=True)
    lower, upper = step * np.floor(low / step + 1e-9), step * np.ceil(high / step - 1e-9)
    return ColourScale(float(lower), float(upper if upper > lower else lower + step))


def _round_number(value: float, *, up: bool) -> float:
    """Return the next of ROUND_STEPS times a power of ten above or below a positive number."""
    decade = np.floor(np.log10(value))
    numbers = np.array([step * 10.0 ** (decade + shift) for shift in (0, 1) for step in ROUND_STEPS])
    close = 1e-9 * value
    return float(numbers[numbers >= value - close].min() if up else numbers[numbers <= value + close].max())
