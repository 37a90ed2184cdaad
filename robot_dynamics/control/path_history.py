"""The last part of the path of a robot, on which it can go back."""

from __future__ import annotations

from collections import deque
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

SPACING = 0.02
"""Time between two points [s]."""
RETURN_SPEED = 0.5
"""Speed of the way back, relative to that of the way there."""


class PathHistory:
    """Positions and velocities of the links in the last seconds.

    Parameters
    ----------
    duration : float
        How long a point is kept [s].
    """

    def __init__(self, duration: float) -> None:
        self.duration = duration
        self._points: deque[tuple[float, Array]] = deque()

    def clear(self) -> None:
        """Forget all points."""
        self._points.clear()

    def is_due(self, now: float) -> bool:
        """Whether the last point is old enough for another one at a time [s]."""
        if self._points and now < self._points[-1][0]:  # the clock jumped back
            self._points.clear()
        return not self._points or now - self._points[-1][0] >= SPACING

    def record(self, now: float, motion: Array) -> None:
        """Keep positions and velocities (2, joints) at a time [s]."""
        self._points.append((now, motion.copy()))
        while now - self._points[0][0] > self.duration:
            self._points.popleft()

    def way_back(self, lead: float) -> tuple[Array, Array] | None:
        """Return the way back to the oldest point, where it ends at rest; None where there is no way.

        Parameters
        ----------
        lead : float
            Time until the newest point is reached [s], above zero.

        Returns
        -------
        times : ndarray, shape (N,)
            [s]
        points : ndarray, shape (3, N, joints)
            Positions and velocities; accelerations are nan.
        """
        if len(self._points) < 2:
            return None
        stamps = np.array([stamp for stamp, _ in self._points])[::-1]
        motions = np.array([motion for _, motion in self._points])[::-1]
        times = lead + (stamps[0] - stamps) / RETURN_SPEED
        velocities = -RETURN_SPEED * motions[:, 1]
        velocities[-1] = 0.0
        return times, np.stack([motions[:, 0], velocities, np.full_like(velocities, np.nan)])
