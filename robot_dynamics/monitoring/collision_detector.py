"""Decision of collisions by external efforts beyond thresholds, with hysteresis."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.monitoring.collision_thresholds import CollisionThresholds


@dataclass(frozen=True)
class CollisionEvent:
    """The beginning of a collision.

    Attributes
    ----------
    stamp : int
        Time of the sample [ns].
    joint : str
        The joint that exceeds its threshold most.
    effort, threshold : float
        Its external effort and its threshold then [N m or N].
    """

    stamp: int
    joint: str
    effort: float
    threshold: float

    def __str__(self) -> str:
        return (
            f"collision at {self.stamp * 1e-9:.3f} s: external effort {self.effort:.3g} of {self.joint!r} is beyond "
            f"{self.threshold:.3g}"
        )


class CollisionDetector:
    """A collision begins where the external effort of a joint exceeds its threshold, and ends a while after it is low.

    Near standstill friction is not known, so that thresholds are larger there. The error that friction makes passes the
    filter of the observer before it reaches the residual; its bound passes the same filter here.

    Parameters
    ----------
    thresholds : CollisionThresholds
    release_ratio : float
        Part of the thresholds below which all efforts must be, for the collision to end.
    release_time : float
        How long [s].

    Attributes
    ----------
    bounds : ndarray, shape (n,)
        Thresholds at the last sample.
    slowness : ndarray, shape (n,)
        Part of the efforts of friction near standstill that the residual can contain, 0 to 1.
    is_collision : bool
    event : CollisionEvent or None
        The last beginning of a collision.
    """

    def __init__(self, thresholds: CollisionThresholds, release_ratio: float = 0.7, release_time: float = 0.2) -> None:
        self.thresholds = thresholds
        self.release_ratio = release_ratio
        self.release_time = release_time
        self.is_collision = False
        self.event: CollisionEvent | None = None
        self.bounds = thresholds.moving + thresholds.slow
        self.slowness = np.ones(len(thresholds.moving))
        self._low_time = 0.0

    def restart(self) -> None:
        """Begin anew with the observer; a collision lasts until efforts are low again."""
        self.slowness[:] = 1.0
        self._low_time = 0.0

    def continue_from(self, before: CollisionDetector) -> None:
        """Take over the collision of the detector that was in use before."""
        self.is_collision = before.is_collision
        self.event = before.event

    def clear(self) -> None:
        """End the collision."""
        self.is_collision = False
        self._low_time = 0.0

    def update(self, stamp: int, step: float, efforts: Array, velocities: Array, decay: Array) -> bool:
        """Whether a collision begins with this sample.

        Parameters
        ----------
        stamp : int
            Time of the sample [ns].
        step : float
            Time since the last sample [s].
        efforts, velocities : ndarray, shape (n,)
            External efforts and velocities of the joints.
        decay : ndarray, shape (n,)
            exp(-K h) of the observer.
        """
        is_slow = self.thresholds.is_slow(velocities)
        self.slowness = is_slow + decay * (self.slowness - is_slow)
        self.bounds = self.thresholds.bounds(self.slowness)
        excess = np.abs(efforts) / self.bounds
        column = int(np.argmax(excess))
        if excess[column] > 1:
            self._low_time = 0.0
            if self.is_collision:
                return False
            self.is_collision = True
            name = self.thresholds.joint_names[column]
            self.event = CollisionEvent(stamp, name, float(efforts[column]), float(self.bounds[column]))
            return True
        self._low_time = self._low_time + step if excess[column] < self.release_ratio else 0.0
        if self.is_collision and self._low_time >= self.release_time:
            self.clear()
        return False
