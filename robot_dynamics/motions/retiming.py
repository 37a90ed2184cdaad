"""The fastest motion along the path of a motion, within limits of efforts and speeds, with friction."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicHermiteSpline, make_interp_spline
from scipy.ndimage import maximum_filter1d

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.motions.motion_path import divide_into_sections
from robot_dynamics.motions.sampled_motion import SampledMotion, trapezoid_weights
from robot_dynamics.motions.speed_profile import fastest_profile, find_interval_limits
from robot_dynamics.motions.time_scaling import find_time_scale, largest_usage

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.motions.actuator_limits import ActuatorLimits
    from robot_dynamics.motions.effort_model import EffortModel
    from robot_dynamics.motions.motion_path import PathSection
    from robot_dynamics.motions.speed_profile import IntervalLimits

INTERVALS_PER_KNOT = 4
"""Intervals of a section for each knot of its curve, if that is more than SMALLEST_COUNT."""
SMALLEST_COUNT = 400
"""Least number of intervals of a section."""
ROUNDS = 8
"""Optimisations, at most, until limits hold between the middles of intervals too."""
USAGE_TOLERANCE = 1e-3
"""Part of a limit by which it may be passed there before time is scaled."""
NEAREST_COUNT = 500
"""Samples nearest to a limit, by which the factor of time is sought first."""
HEADROOM = 1e-5
"""Part of the duration that is added, for states between the points of verification."""
FINENESS = 10
"""Points per interval at which the limits are verified."""


@dataclass(frozen=True, eq=False)
class RetimedMotion:
    """A re-timed motion.

    Attributes
    ----------
    motion : SampledMotion
        Its samples at FINENESS points of each interval of the path; times are not equally spaced.
    deviation : (n,) largest distance between the path and the samples of the original motion [rad or m].
    """

    motion: SampledMotion
    deviation: Array

    def resample(self, rate: float) -> SampledMotion:
        """Return samples at equal times, the last one at the end or up to one step after it, at rest."""
        fine = self.motion
        times = np.arange(int(np.ceil(fine.times[-1] * rate - 1e-9)) + 1) / rate
        inside = np.minimum(times, fine.times[-1])
        # each is interpolated with its rates, so that velocity and position are consistent and meet all samples
        q = CubicHermiteSpline(fine.times, fine.q, fine.qd)(inside)
        qd = CubicHermiteSpline(fine.times, fine.qd, fine.qdd)(inside)
        qdd = make_interp_spline(fine.times, fine.qdd, k=1)(inside)
        is_over = times > fine.times[-1]
        qd[is_over] = qdd[is_over] = 0.0
        return SampledMotion(times, q, qd, qdd, trapezoid_weights(times))


def retime(model: EffortModel, limits: ActuatorLimits, motion: SampledMotion) -> RetimedMotion:
    """Return the fastest motion along the path of another one.

    It begins and ends at rest, stops where the other one rests or turns, and keeps its pauses. At the points of
    verification it touches a limit and passes none, by the inverse model of the robot: after the optimisation on
    the grid, time is scaled by the smallest factor at which this holds, which is near 1.

    Raises
    ------
    InvalidInputError
        The motion has gaps, the robot cannot pass the path however slowly, or nothing limits its speed.
    SingularModelError
        The loops of the robot do not close at a position.
    """
    sections = divide_into_sections(motion)
    parts: list[SampledMotion] = []
    begin = 0.0
    for section in sections:
        samples = _retime_section(model, limits, section)
        is_new = np.ones(len(samples.times), dtype=bool)
        is_new[0] = not parts or begin > parts[-1].times[-1]  # without a pause, it is the end of the section before
        keys = ("q", "qd", "qdd", "weights")
        parts.append(SampledMotion(begin + samples.times[is_new], *(getattr(samples, key)[is_new] for key in keys)))
        begin = float(parts[-1].times[-1]) + section.pause
    times, q, qd, qdd = (np.concatenate([getattr(part, key) for part in parts]) for key in ("times", "q", "qd", "qdd"))
    deviation = np.max([section.deviation for section in sections], axis=0)
    retimed = SampledMotion(times, q, qd, qdd, trapezoid_weights(times))
    return RetimedMotion(retimed, deviation)


def _retime_section(model: EffortModel, limits: ActuatorLimits, section: PathSection) -> SampledMotion:
    """Return the fastest motion along a section, from time 0, at FINENESS points of each interval.

    The optimisation keeps limits in the middles of intervals. Between them they may be passed where the inertia of a
    joint along the path vanishes, and controls jump: limits there are lowered, and the speed is optimised again.
    """
    count = max(SMALLEST_COUNT, INTERVALS_PER_KNOT * section.knot_count)
    # dense near the ends, where the speed changes with the root of the length
    points = section.length * (1 - np.cos(np.pi * np.arange(count + 1) / count)) / 2
    intervals = _limits_along(model, limits, section, points)
    samples = _sample(section, points, fastest_profile(np.diff(points), intervals))
    closed_q = model.close_loops(samples.q)  # the positions stay, whatever the speed
    for _ in range(ROUNDS):
        of_efforts, of_speeds = _usages(model, limits, closed_q, samples)
        if max(of_efforts.max(), of_speeds.max()) < 1 + USAGE_TOLERANCE:
            break
        intervals = replace(
            intervals,
            margins=intervals.margins / _largest_around(of_efforts, count),
            ceilings=intervals.ceilings / np.append(1.0, _largest_around(of_speeds, count)) ** 2,
        )
        try:
            samples = _sample(section, points, fastest_profile(np.diff(points), intervals))
        except InvalidInputError:  # weight alone needs the limits that were lowered
            break
    s = _scale_to_limits(model, limits, closed_q, samples)
    return SampledMotion(samples.times * s, samples.q, samples.qd / s, samples.qdd / s**2, samples.weights * s)


def _limits_along(model: EffortModel, limits: ActuatorLimits, section: PathSection, points: Array) -> IntervalLimits:
    """Return the limits in the intervals between points σ (N + 1,) of a section."""
    middles = (points[1:] + points[:-1]) / 2
    q, first, second = (section.curve(middles, order) for order in (0, 1, 2))
    at_points = section.curve(points, 1)
    is_turning = np.sign(at_points[1:]) != np.sign(at_points[:-1])
    efforts = model.along_path(model.close_loops(q), first, second, is_turning)
    with np.errstate(divide="ignore"):
        ceilings = ((limits.max_speeds / limits.speeds(at_points)) ** 2).min(axis=1)
    return find_interval_limits(efforts, limits, limits.speeds(first), ceilings)


def _usages(model: EffortModel, limits: ActuatorLimits, closed_q: Array, samples: SampledMotion) -> tuple[Array, Array]:
    """Return the largest parts (N,) of the limits of efforts and of speeds that samples of a motion use.

    closed_q: (N, all joints) positions of the samples, with loops closed.
    """
    efforts = model.efforts(closed_q, samples.qd, samples.qdd)
    of_efforts, of_speeds = limits.usage(efforts, samples.qd)
    return of_efforts.max(axis=1), of_speeds.max(axis=1)


def _largest_around(usages: Array, count: int) -> Array:
    """Largest usage (count,), at least 1, in each interval and its neighbours; usages: (FINENESS * count + 1,)."""
    in_intervals = np.maximum(usages[:-1].reshape(count, FINENESS).max(axis=1), 1.0)
    largest: Array = maximum_filter1d(in_intervals, 3)
    return largest


def _scale_to_limits(model: EffortModel, limits: ActuatorLimits, q: Array, samples: SampledMotion) -> float:
    """Return the factor of time, near 1, with which a motion touches a limit and passes none; q as above."""
    qd, qdd = samples.qd, samples.qdd
    nearest = np.argsort(-np.maximum(*_usages(model, limits, q, samples)))[:NEAREST_COUNT]
    scale = find_time_scale(model, limits, q[nearest], qd[nearest], qdd[nearest])
    if scale is None or largest_usage(model, limits, q, qd, qdd, scale.scale) > 1:
        scale = find_time_scale(model, limits, q, qd, qdd)
    if scale is None:
        raise InvalidInputError("no limit is reached however fast the motion is: give limits of efforts and velocities")
    return scale.scale * (1 + HEADROOM)


def _sample(section: PathSection, points: Array, x: Array) -> SampledMotion:
    """Return a motion along a section, x = σ̇² (N + 1,) at points (N + 1,), at FINENESS points of each interval."""
    count = len(x) - 1
    fine = np.interp(np.arange(FINENESS * count + 1) / FINENESS, np.arange(count + 1), points)
    # u is linear between the middles of intervals: between neighbouring values, so that efforts stay within limits too
    controls = np.interp(fine, (points[1:] + points[:-1]) / 2, np.diff(x) / (2 * np.diff(points)))
    squares = np.append(0.0, np.cumsum(np.diff(fine) * (controls[1:] + controls[:-1])))
    excess = squares[-1] / section.length  # of the second order of the intervals
    squares -= excess * fine
    controls -= excess / 2
    rates = np.sqrt(np.maximum(squares, 0.0))
    rates[-1] = 0.0
    # near rest x is linear in σ, for which this rule is exact
    steps = 2 * np.diff(fine) / (rates[1:] + rates[:-1])
    times = np.append(0.0, np.cumsum(steps))
    first, second = section.curve(fine, 1), section.curve(fine, 2)
    qd = first * rates[:, None]
    qdd = first * controls[:, None] + second * (rates**2)[:, None]
    qdd[[0, -1]] = 0.0  # at rest
    return SampledMotion(times, section.curve(fine), qd, qdd, trapezoid_weights(times))
