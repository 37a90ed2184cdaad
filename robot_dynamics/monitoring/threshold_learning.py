"""Thresholds of external efforts from sound motion, for a stated interval between false alarms.

The largest residual of a joint in each block of motion is a random number whose distribution has a Gumbel tail

    P(max > x) = 1 - exp(-exp(-(x - μ) / β))

β and μ follow from standard deviation and mean of the maxima. The threshold is the x that a block exceeds with the
probability of one false alarm of n joints in the interval. Blocks count as independent, and the motion as like that of
the recording: friction of another temperature, or a faster motion, is not in it. Source: E. J. Gumbel, Statistics of
extremes, 1958.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.monitoring.collision_thresholds import STICTION_RATIO, CollisionThresholds, dry_friction

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.monitoring.contact_observer import ContactObserver, Observation

BLOCK_TIME_CONSTANTS = 5.0
"""Duration of a block in time constants of the observer, after which its residual is another one."""

MIN_BLOCK_DURATION = 0.2
"""Least duration of a block [s]: that of a short acceleration."""

MIN_BLOCKS = 20
"""Least number of blocks in which a joint moves."""

MARGIN = 1.1
"""Least ratio of a threshold to the largest residual of the recording."""

EULER_GAMMA = 0.5772156649
SLOW_EDGES = np.array([0.1, 0.2, 0.35, 0.5, 0.7, 0.9])
"""Lower edges of the classes of slowness; below the first one a joint moves."""


@dataclass(frozen=True, eq=False)
class LearntThresholds:
    """Thresholds and what they rest on.

    Attributes
    ----------
    thresholds : CollisionThresholds
    rms : ndarray, shape (n,)
        Of the residual of each joint [N m or N].
    largest : ndarray, shape (n,)
        Largest residual of each joint while it moves [N m or N].
    duration : float
        Time of the recordings that was observed [s].
    blocks : ndarray, shape (n,)
        Number of blocks in which each joint moves.
    interval : float
        Mean time between two false alarms [s].
    """

    thresholds: CollisionThresholds
    rms: Array
    largest: Array
    duration: float
    blocks: Array
    interval: float


class ThresholdLearner:
    """Collects the residuals of a sound robot.

    Parameters
    ----------
    dynamics : Dynamics
    thresholds : CollisionThresholds
        Of the observer; only their bandwidth and the velocity of slow joints are read.

    Attributes
    ----------
    block_duration : float
        [s]
    """

    def __init__(self, dynamics: Dynamics, thresholds: CollisionThresholds) -> None:
        self.block_duration = max(MIN_BLOCK_DURATION, BLOCK_TIME_CONSTANTS / thresholds.bandwidth)
        self._used = thresholds
        n = len(dynamics.joint_names)
        self._dynamics = dynamics
        self._maxima: list[Array] = []  # of completed blocks; nan where a joint was slow
        self._slow_maxima = np.zeros((len(SLOW_EDGES), n))
        self._block_maximum = np.zeros(n)
        self._squares = np.zeros(n)
        self._moving_time = np.zeros(n)
        self._block_time = 0.0
        self._duration = 0.0
        self._last_stamp: int | None = None

    def add(self, observer: ContactObserver, observation: Observation) -> None:
        """Take the residuals of an observer that has just made an observation."""
        stamp = self._last_stamp
        self._last_stamp = observation.stamp
        if not observation.is_settled:
            self._last_stamp = None
            self._start_block()
            return
        if stamp is None:
            return
        step = (observation.stamp - stamp) * 1e-9
        residuals = np.abs(observation.efforts)
        slowness = observer.detector.slowness
        moves = slowness < SLOW_EDGES[0]
        self._block_maximum = np.where(moves, np.maximum(self._block_maximum, residuals), self._block_maximum)
        self._moving_time += moves * step
        self._block_time += step
        self._duration += step
        self._squares += step * residuals**2
        classes = np.searchsorted(SLOW_EDGES, slowness, side="right") - 1
        for column in np.flatnonzero(~moves):
            row = classes[column]
            self._slow_maxima[row, column] = max(self._slow_maxima[row, column], residuals[column])
        if self._block_time >= self.block_duration:
            is_moving = self._moving_time > 0.5 * self._block_time
            self._maxima.append(np.where(is_moving, self._block_maximum, np.nan))
            self._start_block()

    def learn(self, interval: float) -> LearntThresholds:
        """Thresholds for a mean time between two false alarms [s].

        Raises
        ------
        RecordingError
            A joint moves for too short a time.
        """
        names = self._dynamics.joint_names
        maxima = np.array(self._maxima).reshape(-1, len(names))
        blocks = np.count_nonzero(np.isfinite(maxima), axis=0)
        if min(blocks, default=0) < MIN_BLOCKS:
            column = int(np.argmin(blocks))
            raise RecordingError(
                f"{names[column]!r} moves for {blocks[column] * self.block_duration:g} s in the recordings: "
                f"{MIN_BLOCKS * self.block_duration:g} s or more of motion like that of the application are needed"
            )
        scale = np.nanstd(maxima, axis=0, ddof=1) * np.sqrt(6) / np.pi
        location = np.nanmean(maxima, axis=0) - EULER_GAMMA * scale
        probability = self.block_duration / (interval * len(names))
        largest = np.nanmax(maxima, axis=0)
        level = location - scale * np.log(-np.log1p(-min(probability, 0.5)))
        moving = np.maximum(level, MARGIN * largest)
        excess = (MARGIN * self._slow_maxima - moving) / SLOW_EDGES[:, None]
        slow = np.maximum(excess.max(axis=0), STICTION_RATIO * dry_friction(self._dynamics))
        used = self._used
        thresholds = CollisionThresholds(names, moving, slow, used.bandwidth, used.slow_velocity)
        rms = np.sqrt(self._squares / max(self._duration, 1e-300))
        return LearntThresholds(thresholds, rms, largest, self._duration, blocks, interval)

    def _start_block(self) -> None:
        self._block_maximum = np.zeros_like(self._block_maximum)
        self._moving_time = np.zeros_like(self._moving_time)
        self._block_time = 0.0


class LargestRatios:
    """Largest external efforts of observations, relative to their thresholds.

    Attributes
    ----------
    largest : ndarray, shape (n,)
    duration : float
        Time that was observed [s].
    """

    def __init__(self, joint_count: int) -> None:
        self.largest = np.zeros(joint_count)
        self.duration = 0.0
        self._last_stamp: int | None = None

    def add(self, observer: ContactObserver, observation: Observation) -> None:
        """Take an observation that an observer has just made."""
        stamp = self._last_stamp
        self._last_stamp = observation.stamp if observation.is_settled else None
        if stamp is not None and stamp < observation.stamp:
            self.duration += (observation.stamp - stamp) * 1e-9
        self.largest = np.maximum(self.largest, np.abs(observation.efforts) / observer.detector.bounds)
