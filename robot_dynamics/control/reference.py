"""References of the joints: a trajectory with a spline between its points, or a stream of points.

Both are sampled into an array (3, n): positions, velocities, accelerations.
"""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Callable
from typing import TYPE_CHECKING, Literal, Protocol

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, IntArray

ORDERS: tuple[Literal[1, 2, 3], ...] = (1, 2, 3)
"""Number of derivatives (position, velocity, acceleration) at both ends of a segment: linear, cubic, quintic."""
BLOCK = 500
"""Number of segments whose coefficients are computed at once: less than a millisecond."""
REST_VELOCITY = 1e-6
"""Velocity [rad/s or m/s] that counts as rest at the end of a trajectory."""


class Reference(Protocol):
    """A desired motion of n joints."""

    def sample(self, time: float, out: Array) -> None:
        """Write positions, velocities and accelerations at a time [s] into out (3, n)."""


class Trajectory:
    """A spline through points, each segment linear, cubic or quintic.

    The polynomial of a segment matches the derivatives that both its end points specify. Before the first and after the
    last point the joints stand still.

    Parameters
    ----------
    times : array_like, shape (N,)
        Times of the points [s], strictly increasing.
    positions : array_like, shape (N, n)
        [rad or m]
    velocities, accelerations : array_like, shape (N, n), optional
        [rad/s or m/s; rad/s² or m/s²]; rows of nan where a point does not specify them.
    yield_thread : callable
        Is called between parts of the work, which each take a millisecond or less: a thread that must not keep others
        waiting pauses in it.

    Attributes
    ----------
    first_point : ndarray, shape (3, n)
        Positions, velocities and accelerations of the first point; nan where it does not specify them.

    Raises
    ------
    InvalidInputError
        Times do not increase, numbers are not finite, or the motion does not end at rest.
    """

    def __init__(
        self,
        times: ArrayLike,
        positions: ArrayLike,
        velocities: ArrayLike | None = None,
        accelerations: ArrayLike | None = None,
        yield_thread: Callable[[], None] = lambda: None,
    ) -> None:
        times = np.array(times, dtype=np.float64)
        positions = np.array(positions, dtype=np.float64)
        unspecified = np.full_like(positions, np.nan)
        velocities = unspecified if velocities is None else np.array(velocities, dtype=np.float64)
        accelerations = unspecified if accelerations is None else np.array(accelerations, dtype=np.float64)
        check_points(times, positions, velocities)
        self._build(times, np.stack([positions, velocities, accelerations]), yield_thread)

    @classmethod
    def between(cls, times: Array, points: Array) -> Trajectory:
        """Return the segment between two points, which may move at its end.

        Parameters
        ----------
        times : ndarray, shape (2,)
            [s]
        points : ndarray, shape (3, 2, n)
            Positions, velocities and accelerations.
        """
        segment = cls.__new__(cls)
        segment._build(times, points, lambda: None)
        return segment

    def _build(self, times: Array, points: Array, yield_thread: Callable[[], None]) -> None:
        positions, velocities, accelerations = points
        self.first_point = points[:, 0].copy()
        orders = 1 + np.isfinite(velocities).all(axis=1)
        orders = np.where((orders == 2) & np.isfinite(accelerations).all(axis=1), 3, orders)
        segment_orders = np.minimum(orders[:-1], orders[1:])
        durations = np.diff(times)
        self._coefficients = np.empty((len(durations), 6, positions.shape[1]))
        for start in range(0, len(durations), BLOCK):
            if start:
                yield_thread()
            block = slice(start, start + BLOCK)
            ends = np.nan_to_num(points[:, start : start + BLOCK + 1]).transpose(1, 0, 2)
            self._coefficients[block] = _segment_coefficients(durations[block], ends, segment_orders[block])
        self._times: list[float] = times.tolist()
        self._first = positions[0].copy()  # a view would keep all points
        self._last = positions[-1].copy()
        self._segment = 0
        self._powers = array("d", [1.0, *[0.0] * 17])
        self._powers[7] = 1.0
        self._powers[14] = 2.0
        self._power_matrix = np.frombuffer(self._powers).reshape(3, 6)

    @property
    def start(self) -> float:
        """Time of the first point [s]."""
        return self._times[0]

    @property
    def end(self) -> float:
        """Time of the last point [s]."""
        return self._times[-1]

    def sample(self, time: float, out: Array) -> None:
        """Write the reference at a time into an array.

        Parameters
        ----------
        time : float
            [s]
        out : ndarray, shape (3, n)
            Positions, velocities, accelerations.
        """
        times = self._times
        if not times[0] <= time < times[-1]:
            out[0] = self._first if time < times[0] else self._last
            out[1:] = 0.0
            return
        segment = self._segment  # most often the same segment as in the last call, or the next one
        if not times[segment] <= time < times[segment + 1]:
            segment = self._segment = bisect_right(times, time) - 1
        s = time - times[segment]
        powers, s2 = self._powers, s * s
        s3, s4 = s2 * s, s2 * s2
        powers[1], powers[2], powers[3], powers[4], powers[5] = s, s2, s3, s4, s4 * s
        powers[8], powers[9], powers[10], powers[11] = 2 * s, 3 * s2, 4 * s3, 5 * s4
        powers[15], powers[16], powers[17] = 6 * s, 12 * s2, 20 * s3
        np.dot(self._power_matrix, self._coefficients[segment], out=out)


class ScheduledTrajectory:
    """A trajectory from a time on, which is reached by a segment from another point if that time is later.

    Parameters
    ----------
    trajectory : Trajectory
        Its times count from the start.
    start : float
        Time of the start [s].
    lead : Trajectory, optional
        The segment to its first point.

    Attributes
    ----------
    start, end : float
        Times of the start and of the last point [s].
    """

    def __init__(self, trajectory: Trajectory, start: float, lead: Trajectory | None = None) -> None:
        self._trajectory = trajectory
        self.start = start
        self.end = start + trajectory.end
        self._lead = lead

    def sample(self, time: float, out: Array) -> None:
        """Write the reference at a time [s] into an array (3, n)."""
        if self._lead is not None and time < self._lead.end:
            self._lead.sample(time, out)
            return
        time -= self.start
        if self._lead is not None:
            time = max(time, self._trajectory.start)  # may be rounded to before its first point
        self._trajectory.sample(time, out)


class ReferencePoint:
    """One point of a stream. Until the next one the joints continue with its velocity and acceleration.

    Parameters
    ----------
    time : float
        Time of the point [s].
    values : array_like, shape (3, n)
        Positions, velocities, accelerations; zero where the point does not specify them.
    end : float
        Time until which the point is valid [s].

    Attributes
    ----------
    start, end : float
        Times [s] between which the point is valid.
    """

    def __init__(self, time: float, values: ArrayLike, end: float) -> None:
        self.start = time
        self.end = end
        self._values: Array = np.array(values, dtype=np.float64)

    def sample(self, time: float, out: Array) -> None:
        """Write the reference at a time into an array.

        Parameters
        ----------
        time : float
            [s]
        out : ndarray, shape (3, n)
            Positions, velocities, accelerations.
        """
        s = max(time - self.start, 0.0)
        positions, velocities, accelerations = self._values
        out[0] = positions + s * velocities + (0.5 * s * s) * accelerations
        out[1] = velocities + s * accelerations
        out[2] = accelerations


def check_points(times: Array, positions: Array, velocities: Array) -> None:
    """Check the points of a trajectory: times (N,), positions and velocities (N, n).

    Raises InvalidInputError, which names the point.
    """
    if len(times) == 0:
        raise InvalidInputError("the trajectory has no points: at least one is needed")
    if not np.isfinite(times).all() or not np.isfinite(positions).all():
        point = int(np.argmin(np.isfinite(times) & np.isfinite(positions).all(axis=1)))
        raise InvalidInputError(f"points[{point}]: finite times and positions are needed")
    not_increasing = np.flatnonzero(np.diff(times) <= 0)
    if len(not_increasing):
        raise InvalidInputError(
            f"points[{not_increasing[0] + 1}].time_from_start is not after that of the point before it: times must "
            "increase"
        )
    moving = np.flatnonzero(np.abs(np.nan_to_num(velocities[-1])) > REST_VELOCITY)
    if len(moving):
        raise InvalidInputError(
            f"points[{len(times) - 1}].velocities[{moving[0]}] is {velocities[-1, moving[0]]:g}: a trajectory ends at "
            "rest. Send a motion without end as single points to reference_point"
        )


def _segment_coefficients(durations: Array, points: Array, orders: IntArray) -> Array:
    """Coefficients (N - 1, 6, n) of s⁰ to s⁵, where s is the time since the beginning of a segment.

    durations: (N - 1,); points: (N, 3, n) positions, velocities, accelerations; orders: (N - 1,) number of these that
    both ends of a segment specify.
    """
    coefficients = np.zeros((len(durations), 6, points.shape[-1]))
    for order in ORDERS:
        segments = np.flatnonzero(orders == order)
        h = durations[segments, None, None]
        scale = h ** np.arange(order)[:, None]  # from derivatives by time to those by s / h
        ends = [points[segments + end, :order] * scale for end in (0, 1)]
        conditions = np.concatenate(ends, axis=1)
        coefficients[segments, : 2 * order] = _HERMITE[order] @ conditions / h ** np.arange(2 * order)[:, None]
    return coefficients


def _hermite_matrix(order: int) -> Array:
    """The matrix from derivatives 0 to order - 1 at s = 0, then at s = 1, to the coefficients of a polynomial."""
    size = 2 * order
    conditions = np.zeros((size, size))
    for derivative in range(order):
        for power in range(derivative, size):
            factor = np.prod(np.arange(power - derivative + 1, power + 1), initial=1.0)
            conditions[derivative, power] = factor if power == derivative else 0.0
            conditions[order + derivative, power] = factor
    return np.asarray(np.linalg.inv(conditions), dtype=np.float64)


_HERMITE = {order: _hermite_matrix(order) for order in ORDERS}
