"""The range of a value that a slider sets."""

from typing import NamedTuple


class Range(NamedTuple):
    """Range of a coordinate that a user moves [rad or m]."""

    lower: float
    upper: float

    def clip(self, value: float) -> float:
        """Return the value, or the end of the range that is nearest to it."""
        return float(min(max(value, self.lower), self.upper))
