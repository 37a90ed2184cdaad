"""The motion of the demo: a quintic polynomial from rest to rest, as arrays and as messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.nodes.codecs.fields import to_duration_message

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion from rest at `start` (n,) to rest at `goal` (n,) in `duration` [s]."""

    start: Array
    goal: Array
    duration: float

    def reversed(self) -> Motion:
        """Return the motion back to the start."""
        return Motion(self.goal, self.start, self.duration)

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Return positions, velocities and accelerations (N, n) at times (N,) [s]; at rest before and after."""
        s = np.clip(times / self.duration, 0, 1)[:, None]
        distance = self.goal - self.start
        return (
            self.start + distance * (10 * s**3 - 15 * s**4 + 6 * s**5),
            distance * (30 * s**2 - 60 * s**3 + 30 * s**4) / self.duration,
            distance * (60 * s - 180 * s**2 + 120 * s**3) / self.duration**2,
        )


def trajectory_points(times: Sequence[float] | Array, **fields: Array) -> list[JointTrajectoryPoint]:
    """Return the points at `times` [s] of fields (N, n): positions, velocities, accelerations or effort."""
    points = []
    for k, time in enumerate(times):
        point = JointTrajectoryPoint(time_from_start=to_duration_message(round(time * 1e9)))
        for field, values in fields.items():
            setattr(point, field, values[k].tolist())
        points.append(point)
    return points
