"""The path of a motion: its geometry without its time, in sections from rest to rest."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.interpolate import CubicSpline

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.motions.sampled_motion import SampledMotion

REST_SPEED = 1e-3
"""Speed, relative to the largest of the motion, below which all joints are at rest."""
SMALLEST_PAUSE = 0.1
"""Rest [s] from which on it is a pause, which stays; shorter ones are turning points."""
PATH_TOLERANCE = 1e-4
"""Deviation from the samples, relative to the range of a joint, that a path may have."""
KNOT_COUNTS = (32, 64, 128, 256, 512, 1024)
"""Numbers of knots of a path: the first one that keeps PATH_TOLERANCE is taken."""
SAMPLES_PER_STEP = 8
"""Points per sample of the motion at which its length is measured."""


@dataclass(frozen=True, eq=False)
class PathSection:
    """A part of a motion from rest to rest, as a curve q(σ) whose parameter is about its length.

    Attributes
    ----------
    curve : q (n,) as a function of σ, twice continuously differentiable.
    length : largest σ; the first one is 0. Each joint counts relative to its largest speed in the motion.
    knot_count : number of knots of the curve.
    deviation : (n,) largest deviation from the samples of the motion [rad or m].
    pause : rest after the section [s].
    """

    curve: CubicSpline
    length: float
    knot_count: int
    deviation: Array
    pause: float


def divide_into_sections(motion: SampledMotion) -> list[PathSection]:
    """Return the path of a motion. Raises InvalidInputError where it has gaps, or nothing moves."""
    if motion.has_gaps:
        raise InvalidInputError("the motion has gaps: a part without a gap is needed to re-time it (--from, --to)")
    peaks = np.abs(motion.qd).max(axis=0)
    if not peaks.max() > 0:
        raise InvalidInputError("nothing moves: there is no motion to re-time")
    units = np.where(peaks > REST_SPEED * peaks.max(), peaks, peaks.max())
    speed = np.linalg.norm(motion.qd / units, axis=1)
    ends = (motion.qd[0], motion.qd[-1])
    over_time = CubicSpline(motion.times, motion.q, bc_type=((1, ends[0]), (1, ends[1])))
    sections = []
    begin = 0
    for first, last in _rests(speed):
        middle = (first + last) // 2
        if middle > begin:
            duration = motion.times[last] - motion.times[first]
            pause = float(duration) if duration >= SMALLEST_PAUSE and last < len(speed) - 1 else 0.0
            sections.append(_fit_section(over_time, motion.times[begin : middle + 1], units, pause))
        begin = middle
    if begin < len(speed) - 1:
        sections.append(_fit_section(over_time, motion.times[begin:], units, 0.0))
    return sections


def _rests(speed: Array) -> list[tuple[int, int]]:
    """Return the first and last samples of each rest but one at the beginning; speed: (N,)."""
    is_resting = speed < REST_SPEED * speed.max()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], is_resting, [False]]).astype(int)))
    runs = [(int(first), int(last) - 1) for first, last in edges.reshape(-1, 2)]
    # a rest at an end of the motion belongs to it as a whole
    last_sample = len(speed) - 1
    return [(last_sample, last_sample) if last == last_sample else (first, last) for first, last in runs if first > 0]


def _fit_section(over_time: CubicSpline, times: Array, units: Array, pause: float) -> PathSection:
    """Return the section of a motion q(t) between the first and the last of its sample times."""
    numbers = np.arange(SAMPLES_PER_STEP * (len(times) - 1) + 1) / SAMPLES_PER_STEP
    fine_times = np.interp(numbers, np.arange(len(times)), times)
    steps = np.linalg.norm(np.diff(over_time(fine_times) / units, axis=0), axis=1)
    lengths = np.append(0.0, np.cumsum(steps))
    samples = over_time(times)
    at_samples = lengths[::SAMPLES_PER_STEP]
    ranges = np.ptp(samples, axis=0)
    for count in KNOT_COUNTS:
        # knots are samples of the curve, so that no interpolation of their times adds an error
        knots = np.unique(np.searchsorted(lengths, np.linspace(0.0, lengths[-1], count)).clip(max=len(lengths) - 1))
        knots = knots[np.append(np.diff(lengths[knots]) > lengths[-1] / count / 4, True)]
        curve = CubicSpline(lengths[knots], over_time(fine_times[knots]))
        deviation = np.abs(curve(at_samples) - samples).max(axis=0)
        if (deviation <= PATH_TOLERANCE * ranges.max()).all():
            break
    return PathSection(curve, float(lengths[-1]), count, deviation, pause)
