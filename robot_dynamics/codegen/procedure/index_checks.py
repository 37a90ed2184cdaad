"""Checks of the indices of a procedure while it is staged: each must lie within its array.

An index may depend on names that change in loops or branches. The range of such a name is the hull of the ranges of all
its values, which may depend on the name itself: these ranges are computed at the end, as the least ones that agree with
each other.
"""

from __future__ import annotations

from math import inf
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.codegen.procedure.counter_ranges import Interval
from robot_dynamics.codegen.procedure.procedure_errors import ProcedureError

if TYPE_CHECKING:
    from robot_dynamics.codegen.procedure.counter_ranges import CounterRange

MAX_ROUNDS = 20
"""Rounds after which a range that still grows has no end."""


class NameRange:
    """The hull of the ranges of all values that a name gets in loops and branches."""

    def __init__(self) -> None:
        self._sources: list[CounterRange] = []
        self._interval: Interval | None = None

    def __call__(self) -> Interval | None:
        return self._interval

    def add(self, source: CounterRange) -> None:
        """Include the range of a value."""
        self._sources.append(source)

    def update(self, is_last: bool) -> bool:
        """Compute the range anew; whether it has changed. is_last: what still grows has no end."""
        before = self._interval
        intervals = [interval for source in self._sources if (interval := source()) is not None]
        if not intervals:
            return False
        interval = Interval(min(part.lowest for part in intervals), max(part.highest for part in intervals))
        if is_last and before is not None:
            lowest = interval.lowest if interval.lowest >= before.lowest else -inf
            highest = interval.highest if interval.highest <= before.highest else inf
            interval = Interval(lowest, highest)
        self._interval = interval
        return interval != before


class IndexCheck(NamedTuple):
    """An index of an array that is checked at the end."""

    range: CounterRange
    size: int
    location: str


class IndexChecks:
    """The indices of a function, and the names that they depend on."""

    def __init__(self) -> None:
        self._names: list[NameRange] = []
        self._checks: list[IndexCheck] = []

    def new_name(self) -> NameRange:
        """The range of another name."""
        name = NameRange()
        self._names.append(name)
        return name

    def require(self, index: CounterRange, size: int, location: str) -> None:
        """Check an index of an axis with `size` entries, now if it depends on no name."""
        check = IndexCheck(index, size, location)
        if isinstance(index, Interval):
            _require_within(check)
        else:
            self._checks.append(check)

    def finish(self) -> None:
        """Check all indices. Raises ProcedureError where one may lie outside of its array."""
        rounds = 0
        while any([name.update(rounds >= MAX_ROUNDS) for name in self._names]):
            rounds += 1
        for check in self._checks:
            _require_within(check)


def _require_within(check: IndexCheck) -> None:
    interval = check.range()
    if interval is None or (interval.lowest >= 0 and interval.highest < check.size):
        return
    raise ProcedureError(
        f"an index may be {interval.lowest:.0f} to {interval.highest:.0f}, and the array has entries 0 to "
        f"{check.size - 1}: use loops over range(...) with such limits",
        check.location,
    )
