"""Bumpless transfer: efforts without jumps when the control mode or the model changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray


RAMP_COUNT = 8
"""Jumps that decay at the same time; those in an eighth of the duration are one."""
ROUNDING = 1e-12
"""Part of a limit by which an effort that continues at the limit may exceed it."""


class BumplessTransfer:
    """Passes efforts on, within limits; after `start_transition` their jump decays along a straight line.

    Each jump decays along a line of its own, so that a transition that starts during another one does not prolong it.
    Efforts thus depend on the desired ones even where transitions start all the time.

    Parameters
    ----------
    size : int
        Number of efforts.
    duration : float
        Duration of a transition [s].
    limits : array_like, shape (size,)
        Maximum magnitude of each effort [N m or N].

    Attributes
    ----------
    duration : float
    limits : ndarray, shape (size,)
    last_efforts : ndarray, shape (size,)
        Efforts of the last update, a buffer.
    saturated : ndarray of bool, shape (size,)
        Which of them are at their limits, a buffer.
    """

    def __init__(self, size: int, duration: float, limits: ArrayLike) -> None:
        self.duration = duration
        self.limits: Array = np.array(limits, dtype=np.float64)
        self.last_efforts = np.zeros(size)
        self.saturated: BoolArray = np.zeros(size, dtype=np.bool_)
        self._starts = np.full(RAMP_COUNT, -np.inf)
        self._jumps = np.zeros((RAMP_COUNT, size))
        self._newest = 0
        self._remainder = np.zeros(size)  # what is left of all jumps at the last update
        self._is_in_transition = False
        self._requested_start: float | None = None
        self._is_requested = False

    def start_transition(self, since: float | None = None) -> None:
        """Start a transition at the next update.

        Parameters
        ----------
        since : float, optional
            Time at which it started [s]; the efforts may jump then, and are those desired at the end of the duration,
            whatever transitions there were before. By default the next update.
        """
        self._is_requested = True
        self._requested_start = since

    def stop(self) -> None:
        """Set all efforts to zero. The next update has no transition unless `start_transition` is called."""
        self.depart_from(0.0)

    def depart_from(self, efforts: ArrayLike) -> None:
        """Set the last efforts (size,), and end transitions."""
        self.last_efforts[:] = efforts
        self.saturated[:] = False
        self._end_transitions()
        self._is_requested = False

    @property
    def is_in_transition(self) -> bool:
        """Whether the last efforts are not those desired, apart from their limits."""
        return self._is_in_transition

    def update(self, now: float, desired: Array) -> Array:
        """Efforts (size,) at a time [s] for the desired ones (size,), which are not changed."""
        if self._is_requested:
            self._is_requested = False
            self._start(now, desired)
        np.copyto(self.last_efforts, desired)
        if self._is_in_transition:
            parts = self._remaining_parts(now)
            np.sum(parts[:, None] * self._jumps, axis=0, out=self._remainder)
            self.last_efforts += self._remainder
            if not parts.any():
                self._end_transitions()
        np.greater(np.abs(self.last_efforts), self.limits * (1.0 + ROUNDING), out=self.saturated)
        np.minimum(self.last_efforts, self.limits, out=self.last_efforts)
        np.maximum(self.last_efforts, -self.limits, out=self.last_efforts)
        return self.last_efforts

    def _start(self, now: float, desired: Array) -> None:
        if self._requested_start is not None:
            self._end_transitions()
        jump = self.last_efforts - desired - self._remainder
        part = self._remaining_parts(now)[self._newest]
        if part > 1.0 - 1.0 / RAMP_COUNT:
            self._jumps[self._newest] += jump / part
        else:
            self._newest = (self._newest + 1) % RAMP_COUNT
            self._starts[self._newest] = now if self._requested_start is None else self._requested_start
            self._jumps[self._newest] = jump
        self._is_in_transition = True

    def _remaining_parts(self, now: float) -> Array:
        """The part of each jump (ramps,) that is left at a time [s]."""
        if self.duration <= 0.0:
            return np.zeros(RAMP_COUNT)
        parts = 1.0 - (now - self._starts) / self.duration
        # clocks step back a little between two callers; a start far in the future belongs to another clock
        return np.where((parts > 0.0) & (parts <= 2.0), np.minimum(parts, 1.0), 0.0)

    def _end_transitions(self) -> None:
        self._starts[:] = -np.inf
        self._jumps[:] = 0.0
        self._remainder[:] = 0.0
        self._is_in_transition = False
