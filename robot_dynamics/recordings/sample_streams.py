"""Streams: samples of messages that name the same joints, in the order of arrival, with the times of their sampling."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.recordings.sampling_times import are_even, fit_sampling_times, motion_errors

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.sample_bands import SampleRow
    from robot_dynamics.recordings.sample_statistics import SampleStatistics
    from robot_dynamics.recordings.sampling_times import SamplingTimes

CONTEXT_ROWS = 1000  # latest rows that are kept to model the stamps of the next ones
MODEL_INTERVAL = 0.1  # [s] of stamps after which the model is fitted anew
HOLD_DURATION = 0.5  # [s] of the latest rows of a stream with a model, which later stamps may correct
MAX_ERROR_RATIO = 0.4  # of motion errors: times of the model over stamps, below which the model is used
MAX_ERROR_RATIO_IN_USE = 1.2  # the same, for a model that is in use, and over more than one step
LATE = 1e-9  # [s] by which late messages precede the message before
MAX_REPEATS = 4  # rows that repeat the values of the row before and are skipped


class SampleStream:
    """Keeps the rows of one kind of message until their times are known.

    Even stamps are the times, and rows do not wait. Other stamps are replaced by those of a sender with a constant
    period, if these agree much better with the motion. Rows then wait for `HOLD_DURATION`, until the stamps after them
    are known.

    Parameters
    ----------
    source : topic or file, for notes.
    statistics : counts of skipped samples, updated while reading.
    """

    def __init__(self, source: str, statistics: SampleStatistics) -> None:
        self._source = source
        self._statistics = statistics
        self._context: list[SampleRow] = []  # rows that were returned, with their stamps
        self._pending: list[SampleRow] = []
        self._last: SampleRow | None = None  # the last row that was added
        self._repeats: list[SampleRow] = []  # the last rows, if they have the values of the row before
        self._is_constant = False  # whether values are equal for more than MAX_REPEATS rows
        self._has_model = False
        self._model_stamp = -np.inf  # newest stamp [s] when the model was fitted

    def __len__(self) -> int:
        """Number of rows that wait."""
        return len(self._pending) + len(self._repeats)

    def add(self, row: SampleRow) -> None:
        """Add a row, whose time is its stamp [s].

        A publisher that is faster than its source repeats values until new ones come: the first row has their time,
        and the others are skipped. Values that stay equal for longer are those of a robot at rest without noise.
        """
        last = self._last
        self._last = row
        if last is not None and row.time > last.time and _have_equal_values(row, last):
            self._repeats.append(row)
            if len(self._repeats) <= MAX_REPEATS and not self._is_constant:
                return
            self._is_constant = True
            self._pending += self._repeats
        else:
            self._is_constant = False
            self._statistics.counts["held"] += len(self._repeats)
            self._pending.append(row)
        self._repeats = []

    def release(self, final: bool = False) -> list[SampleRow]:
        """Return the rows whose times are known; final: all rows."""
        if final:
            self._pending += self._repeats
            self._repeats = []
        if not self._pending:
            return []
        newest = self._pending[-1].time
        is_due = final or not 0 <= newest - self._model_stamp < MODEL_INTERVAL
        if not is_due and self._has_model:
            return []
        rows = self._context + self._pending
        first = len(self._context)
        count = len(rows)
        released = self._pending
        if is_due:
            stamps = np.array([row.time for row in rows])
            model = self._fit_model(rows, stamps)
            self._model_stamp = newest
            self._has_model = model is not None
            if model is not None:
                if not final:
                    count = max(first, int(np.argmax(stamps > stamps.max() - HOLD_DURATION)))
                times = model.times[first:count]
                released = [row._replace(time=float(time)) for row, time in zip(rows[first:], times, strict=False)]
                self._statistics.counts["lost"] += int(model.losses[first:count].sum())
        self._pending = rows[count:]
        self._context = [] if final else rows[max(0, count - CONTEXT_ROWS) : count]
        return released

    def _fit_model(self, rows: list[SampleRow], stamps: Array) -> SamplingTimes | None:
        """The model of the stamps (M,) of rows; None where the stamps are the times."""
        if are_even(stamps):
            return None
        _, position, velocity, _ = (np.array(values) for values in zip(*rows, strict=True))
        is_late = np.zeros(len(rows), dtype=bool)
        is_late[1:] = stamps[1:] < np.maximum.accumulate(stamps)[:-1]
        is_equal = (np.diff(position, axis=0) == 0) | np.isnan(position[1:])
        is_valid = ~is_late
        is_valid[1:] &= (np.diff(stamps) != 0) | ~is_equal.all(axis=1)  # else the message is a duplicate
        valid = np.flatnonzero(is_valid)
        q = _fill_missing(position[valid])
        model = fit_sampling_times(stamps[valid], q, velocity[valid])
        if model is None:
            return None
        q_dot = velocity[valid]
        errors = motion_errors(model.times, q, q_dot, model.parts)
        limits = np.full(len(errors), MAX_ERROR_RATIO_IN_USE)
        limits[0] = MAX_ERROR_RATIO_IN_USE if self._has_model else MAX_ERROR_RATIO
        if not (errors < limits * motion_errors(stamps[valid], q, q_dot, model.parts)).all():
            return None
        self._statistics.note_sampling_times(self._source, float((stamps[valid] - model.times).max()), model.period)
        # late messages and duplicates get times that are not later than those before, so that they are dropped
        times = model.times[np.maximum(0, np.searchsorted(valid, np.arange(len(rows)), side="right") - 1)]
        times[is_late] -= LATE
        losses = np.zeros(len(rows), dtype=int)
        losses[valid] = model.losses
        return replace(model, times=times, losses=losses)


def _have_equal_values(row: SampleRow, other: SampleRow) -> bool:
    """Whether rows with measured efforts have equal positions, velocities and efforts."""
    # bytes are compared in a fraction of the time of arrays
    if row.position.tobytes() != other.position.tobytes() or row.effort.tobytes() != other.effort.tobytes():
        return False
    return row.velocity.tobytes() == other.velocity.tobytes() and bool(np.isfinite(row.effort).any())


def _fill_missing(position: Array) -> Array:
    """Positions (M, k) with interpolated values where they are nan or infinite."""
    finite = np.isfinite(position)
    if finite.all():
        return position
    filled: Array = position.copy()
    numbers = np.arange(len(position))
    for column, is_finite in zip(filled.T, finite.T, strict=True):
        if is_finite.any():
            column[~is_finite] = np.interp(numbers[~is_finite], numbers[is_finite], column[is_finite])
        else:
            column[:] = 0
    return filled
