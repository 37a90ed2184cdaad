"""Fields that all messages share: times in integers, fields that must be empty, values that must be finite."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Duration, Time

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

NS_PER_SECOND = 1_000_000_000


def to_nanoseconds(time: Time | Duration) -> int:
    """Return a Time or Duration message in ns."""
    return int(time.sec * NS_PER_SECOND + time.nanosec)


def to_time_message(ns: int) -> Time:
    """Return a time in ns as a Time message."""
    return Time(sec=ns // NS_PER_SECOND, nanosec=ns % NS_PER_SECOND)


def to_duration_message(ns: int) -> Duration:
    """Return a duration in ns as a Duration message."""
    return Duration(sec=ns // NS_PER_SECOND, nanosec=ns % NS_PER_SECOND)


def require_empty(message: object, field: str, location: str, reason: str) -> None:
    """Refuse a message in which a field has values that the request does not use.

    location: name of the message in errors. Raises InvalidInputError.
    """
    if len(getattr(message, field)):
        raise InvalidInputError(f"{location}.{field} has values: {reason}, leave it empty")


def require_finite(values: Array, location: str, first: int = 0) -> None:
    """Refuse values with nan or inf. Raises InvalidInputError.

    location: format of the number of a row, for errors; first: number of the first row.
    """
    is_finite = np.isfinite(values)
    if not is_finite.all():
        raise InvalidInputError(f"{location.format(first + np.argwhere(~is_finite)[0][0])} is not finite")


def to_float_array(values: Array) -> array[float]:
    """Return values, row by row, in the type that messages hold without a copy."""
    numbers = array("d")
    numbers.frombytes(np.ascontiguousarray(values, dtype=float).ravel().view(np.uint8).data)
    return numbers
