"""Checks of the arrays that users pass in and get back, below all algorithms so that each of them can use them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

MAX_PRINTED_LENGTH = 80


def require_finite(
    what: str, values: object, size: int, entry_names: str, ignored_columns: Mapping[int, str] | None = None
) -> Array:
    """Convert an input to an array of finite numbers.

    Parameters
    ----------
    what : str
        Name of the input in error messages.
    values : array_like, shape (..., size)
    size : int
    entry_names : str
        Plural of the entries in error messages, for example ``joints (a, b)``.
    ignored_columns : mapping of int to str, optional
        Columns that carry no input, and the reason. Their entries must be 0 or nan; they become 0.

    Returns
    -------
    ndarray, shape (..., size)

    Raises
    ------
    InvalidInputError
        The values are not numbers, have another shape, or are not finite.
    """
    try:
        array = np.asarray(values.filled(np.nan) if isinstance(values, np.ma.MaskedArray) else values)
    except (TypeError, ValueError):
        array = np.asarray("ragged")
    if array.dtype.kind not in "biuf":
        text = " ".join(repr(values).split())
        if len(text) >= MAX_PRINTED_LENGTH:
            text = text[: MAX_PRINTED_LENGTH - 3] + "..."
        raise InvalidInputError(f"{what}: an array of numbers (..., {size}) is needed, not {text}")
    array = array.astype(float, copy=False)
    if array.ndim == 0 or array.shape[-1] != size:
        raise InvalidInputError(
            f"{what} has shape {array.shape}: (..., {size}) is needed, one for each of {size} {entry_names}"
        )
    if ignored_columns:
        array = _clear_columns(what, array, ignored_columns)
    if not np.isfinite(array).all():
        index = tuple(int(number) for number in np.argwhere(~np.isfinite(array))[0])
        sample = f" at sample {', '.join(map(str, index[:-1]))}" if len(index) > 1 else ""
        raise InvalidInputError(f"{what}[{index[-1]}]{sample} is {array[index]}: a finite number is needed")
    return array


def _clear_columns(what: str, array: Array, ignored_columns: Mapping[int, str]) -> Array:
    """A copy of an array (..., size) with zeros in the columns that carry no input."""
    array = array.copy()
    for column, reason in ignored_columns.items():
        entries = array[..., column]
        is_empty = np.isnan(entries) | (entries == 0)
        if not is_empty.all():
            value = entries[~is_empty].flat[0]
            raise InvalidInputError(f"{what}[{column}] is {value:g}: {reason}. Give 0 or nan there")
        array[..., column] = 0
    return array


def broadcast_result(array: Array, batch: Sequence[int], axes: int = 1) -> Array:
    """Copy a result to the full batch shape.

    Parameters
    ----------
    array : ndarray
        Its last `axes` axes are those of one sample.
    batch : sequence of int
        Shape of the batch axes.
    axes : int

    Returns
    -------
    ndarray, shape (*batch, ...)

    Raises
    ------
    InvalidInputError
        An entry is not finite.
    """
    complete = np.array(np.broadcast_to(array, (*batch, *array.shape[array.ndim - axes :])))
    if not np.isfinite(complete).all():
        sample = tuple(int(index) for index in np.argwhere(~np.isfinite(complete))[0][: len(batch)])
        refuse_overflow(f" at sample {', '.join(map(str, sample))}" if sample else "")
    return complete


def refuse_overflow(location: str = "") -> NoReturn:
    """Raise InvalidInputError for a result that is not finite. `location` says where, with a space in front."""
    raise InvalidInputError(
        f"the result{location} is not a finite number: an argument, or a number of the robot description, is too large"
    )
