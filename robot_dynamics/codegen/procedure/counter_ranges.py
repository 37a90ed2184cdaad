"""Ranges of counters: which integers an index of a procedure may be.

The number of a loop has the range of its `range(...)`, sums and products of counters have theirs by interval
arithmetic. A name that changes in loops or branches has the hull of the ranges of all its values: see `index_checks`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import product
from math import inf
from operator import add, sub
from typing import TypeAlias


@dataclass(frozen=True)
class Interval:
    """The integers from `lowest` to `highest`."""

    lowest: float
    highest: float

    def __call__(self) -> Interval | None:
        return self if self.lowest <= self.highest else None


ANY_INTEGER = Interval(-inf, inf)

CounterRange: TypeAlias = "Callable[[], Interval | None]"
"""Computes a range from the present ones of names; None while no integer is known."""


def combined(operation: Callable[[float, float], float], a: CounterRange, b: CounterRange) -> CounterRange:
    """The range of a sum, a difference or a product."""

    def compute() -> Interval | None:
        first, second = a(), b()
        if first is None or second is None:
            return None
        if operation is add:
            return Interval(first.lowest + second.lowest, first.highest + second.highest)
        if operation is sub:
            return Interval(first.lowest - second.highest, first.highest - second.lowest)
        products = [
            x * y if x and y else 0 for x, y in product((first.lowest, first.highest), (second.lowest, second.highest))
        ]
        return Interval(min(products), max(products))

    return _computed_now(compute, a, b)


def numbers_of_loop(first: CounterRange, end: CounterRange, stride: int) -> CounterRange:
    """The range of the number of a loop over range(first, end, stride)."""

    def compute() -> Interval | None:
        begin, limit = first(), end()
        if begin is None or limit is None:
            return None
        highest = limit.highest - 1
        if begin.lowest == begin.highest and highest < inf:
            highest = begin.lowest + (highest - begin.lowest) // stride * stride
        return Interval(begin.lowest, highest)()

    return _computed_now(compute, first, end)


def _computed_now(compute: CounterRange, *sources: CounterRange) -> CounterRange:
    """A range, computed already if it depends on no name."""
    if all(isinstance(source, Interval) for source in sources):
        return compute() or Interval(0, -1)
    return compute
