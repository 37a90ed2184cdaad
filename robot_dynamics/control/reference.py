"""What the joints should do at a time: a trajectory with a spline between its points, or a stream of points.

Both are sampled into an array (3, n): positions, velocities, accelerations.
"""

from array import array
from bisect import bisect_right

import numpy as np

from robot_dynamics.errors import InvalidInputError

ORDERS = (1, 2, 3)  # how many of position, velocity, acceleration both ends of a segment tell: linear, cubic, quintic
REST_VELOCITY = 1e-6  # velocity [rad/s or m/s] at the end of a trajectory that counts as rest


class Trajectory:
    """A spline through points: between two of them linear, cubic or quintic, by which derivatives both of them tell.

    times: (N,) [s], strictly increasing. positions: (N, n) [rad or m]; velocities, accelerations: (N, n), rows of nan
    where a point does not tell them. After its last point the robot is held there. Raises QuestionError for times that
    do not increase, numbers that are not finite, and a motion that does not end at rest.
    """

    def __init__(self, times, positions, velocities=None, accelerations=None):
        times, positions = np.array(times, dtype=float), np.array(positions, dtype=float)
        untold = np.full_like(positions, np.nan)
        velocities = untold if velocities is None else np.array(velocities, dtype=float)
        accelerations = untold if accelerations is None else np.array(accelerations, dtype=float)
        check_points(times, positions, velocities)
        told = 1 + np.isfinite(velocities).all(axis=1)
        told = np.where((told == 2) & np.isfinite(accelerations).all(axis=1), 3, told)
        points = np.stack([positions, np.nan_to_num(velocities), np.nan_to_num(accelerations)], axis=1)
        self._coefficients = _coefficients(np.diff(times), points, np.minimum(told[:-1], told[1:]))
        self._times, self._first, self._last = times.tolist(), positions[0], positions[-1]
        self._segment = 0
        self._powers = array("d", [1.0, *[0.0] * 17])
        self._powers[7], self._powers[14] = 1.0, 2.0
        self._matrix = np.frombuffer(self._powers).reshape(3, 6)

    @property
    def start(self):
        """Time of the first point [s]."""
        return self._times[0]

    @property
    def end(self):
        """Time of the last point [s]."""
        return self._times[-1]

    def sample(self, time, out):
        """Write positions, velocities, accelerations at a time into out (3, n). At either end the robot stands."""
        times = self._times
        if not times[0] <= time < times[-1]:
            out[0] = self._first if time < times[0] else self._last
            out[1:] = 0.0
            return
        segment = self._segment  # time goes on: most often the same as before, or the next one
        if not times[segment] <= time < times[segment + 1]:
            segment = self._segment = bisect_right(times, time) - 1
        s = time - times[segment]
        powers, s2 = self._powers, s * s
        s3, s4 = s2 * s, s2 * s2
        powers[1], powers[2], powers[3], powers[4], powers[5] = s, s2, s3, s4, s4 * s
        powers[8], powers[9], powers[10], powers[11] = 2 * s, 3 * s2, 4 * s3, 5 * s4
        powers[15], powers[16], powers[17] = 6 * s, 12 * s2, 20 * s3
        np.dot(self._matrix, self._coefficients[segment], out=out)


class ReferencePoint:
    """One point of a stream: until the next one the joints go on from it with its velocity and acceleration.

    time: of the point [s]; told: (3, n) positions, velocities, accelerations, zero where it does not tell them;
    lasts: for how long it may be followed [s].
    """

    def __init__(self, time, told, lifetime):
        self.start, self._told, self.end = time, np.array(told, dtype=float), time + lifetime

    def sample(self, time, out):
        """Write positions, velocities, accelerations at a time into out (3, n)."""
        s = max(time - self.start, 0.0)
        positions, velocities, accelerations = self._told
        out[0] = positions + s * velocities + (0.5 * s * s) * accelerations
        out[1] = velocities + s * accelerations
        out[2] = accelerations


def check_points(times, positions, velocities):
    """Refuse what is no trajectory, naming the point: arguments of Trajectory. Raises QuestionError."""
    if len(times) == 0:
        raise InvalidInputError("the trajectory has no points: one at least is needed")
    if not np.isfinite(times).all() or not np.isfinite(positions).all():
        point = int(np.argmin(np.isfinite(times) & np.isfinite(positions).all(axis=1)))
        raise InvalidInputError(f"points[{point}]: finite times and positions are needed")
    late = np.flatnonzero(np.diff(times) <= 0)
    if len(late):
        raise InvalidInputError(
            f"points[{late[0] + 1}].time_from_start is not after that of the point before it: times must increase"
        )
    moving = np.flatnonzero(np.abs(np.nan_to_num(velocities[-1])) > REST_VELOCITY)
    if len(moving):
        raise InvalidInputError(
            f"points[{len(times) - 1}].velocities[{moving[0]}] is {velocities[-1, moving[0]]:g}: a trajectory ends at "
            "rest. What has no end goes as single points to reference_point"
        )


def _coefficients(durations, points, orders):
    """(N - 1, 6, n) coefficients of s⁰ to s⁵, s the time since the beginning of a segment.

    durations: (N - 1,); points: (N, 3, n) positions, velocities, accelerations; orders: (N - 1,) how many of these are
    told at both ends.
    """
    found = np.zeros((len(durations), 6, points.shape[-1]))
    for order in ORDERS:
        chosen = np.flatnonzero(orders == order)
        h = durations[chosen, None, None]
        scale = h ** np.arange(order)[:, None]  # derivatives by time as those by s / h
        ends = [points[chosen + end, :order] * scale for end in (0, 1)]
        told = np.concatenate(ends, axis=1)
        found[chosen, : 2 * order] = _HERMITE[order] @ told / h ** np.arange(2 * order)[:, None]
    return found


def _hermite(order):
    """The matrix from derivatives 0 to order - 1 at s = 0, then at s = 1, to the coefficients of a polynomial."""
    size = 2 * order
    conditions = np.zeros((size, size))
    for derivative in range(order):
        for power in range(derivative, size):
            factor = np.prod(np.arange(power - derivative + 1, power + 1), initial=1.0)
            conditions[derivative, power] = factor if power == derivative else 0.0
            conditions[order + derivative, power] = factor
    return np.linalg.inv(conditions)


_HERMITE = {order: _hermite(order) for order in ORDERS}
