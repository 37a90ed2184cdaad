"""Bumpless transfer: efforts without jumps when the control mode or the model changes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray


class BumplessTransfer:
    """Passes efforts on, within limits; after `start_transition` their jump decays along a straight line.

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
        self._jump = np.zeros(size)
        self._transition_start: float | None = None
        self._requested_start: float | None = None
        self._is_requested = False

    def start_transition(self, since: float | None = None) -> None:
        """Start a transition at a time [s]; by default at the next update, whose efforts may jump."""
        self._is_requested = True
        self._requested_start = since

    def stop(self) -> None:
        """Set all efforts to zero. The next update has no transition unless `start_transition` is called."""
        self.last_efforts[:] = 0.0
        self.saturated[:] = False
        self._transition_start = None
        self._is_requested = False

    @property
    def is_in_transition(self) -> bool:
        """Whether the last efforts are not those desired, apart from their limits."""
        return self._transition_start is not None

    def update(self, now: float, desired: Array) -> Array:
        """Efforts (size,) at a time [s] for the desired ones (size,), which are not changed."""
        if self._is_requested:
            self._is_requested = False
            self._transition_start = now if self._requested_start is None else self._requested_start
            np.subtract(self.last_efforts, desired, out=self._jump)
        np.copyto(self.last_efforts, desired)
        if self._transition_start is not None:
            elapsed = now - self._transition_start
            remaining = 1.0 - elapsed / self.duration if self.duration > 0 else 0.0
            if 0.0 < remaining <= 1.0:
                self.last_efforts += remaining * self._jump
            else:
                self._transition_start = None
        np.greater(np.abs(self.last_efforts), self.limits, out=self.saturated)
        np.minimum(self.last_efforts, self.limits, out=self.last_efforts)
        np.maximum(self.last_efforts, -self.limits, out=self.last_efforts)
        return self.last_efforts
