"""Sampling times from stamps that jitter: a model of the clock of the sender.

A sender that samples at a constant period T stamps its sample number k, or its receiver does, at

    stamp_k = offset + k T + delay_k,    delay_k >= 0,

where delays are those of a busy machine: messages wait, and are then stamped in a burst. The line below all stamps that
is closest to them has the offset and the period of the sender. It is fitted to overlapping windows of samples, because
clocks drift. Moon, Skelly and Towsley, Estimation and removal of clock skew from network delay measurements (1999).

Samples that were lost shift all later stamps. Whether these times are right, and not the stamps, is a question of
evidence: between two samples a joint moves by its velocity times the time between them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray

MIN_MODEL_SAMPLES = 64  # samples that are needed for a model
MAX_EVEN_DEVIATION = 0.1  # of the median step: stamps whose steps deviate less are even, and are not changed
PERIOD_WINDOW = 128  # samples of a window for the first estimate of the period
LINE_WINDOW = 512  # samples of a window with one line
LOSS_REACH = 64  # samples on each side of a loss that have to agree on it
MIN_LOSS = 0.6  # [periods] shift of stamps that is a loss
NEIGHBOURS = 10  # steps on each side whose displacements are compared with that of a loss
MIN_SIGNAL = 4.0  # displacements over their changes, above which a loss is seen in them
MAX_LOSS = 20  # lost samples beyond which the samples after them get an offset of their own
MAX_PAUSE = 1.0  # [s] between stamps, beyond which the samples after it get an offset of their own
MAX_SEARCHES = 50


@dataclass(frozen=True, eq=False)
class SamplingTimes:
    """The model of the stamps of M samples.

    times: (M,) [s] at which they were sampled; period: [s] of the sender; lost: number of samples lost between them.
    """

    times: Array
    period: float
    lost: int


def are_even(stamps: Array) -> bool:
    """Whether the steps between stamps (M,) [s] deviate little from their median."""
    steps = np.diff(stamps)
    if len(steps) == 0:
        return True
    median = np.median(steps)
    return bool(np.abs(steps - median).max() <= MAX_EVEN_DEVIATION * median)


def fit_sampling_times(stamps: Array, position: Array) -> SamplingTimes | None:
    """Fit the model of a sender with a constant period.

    Parameters
    ----------
    stamps : (M,) [s], ascending; equal ones are allowed.
    position : (M, k) positions of the joints, which show whether a long step is a loss.

    Returns
    -------
    SamplingTimes or None
        None where the samples are too few, or have no period.
    """
    if len(stamps) < MIN_MODEL_SAMPLES:
        return None
    period = _estimate_period(stamps)
    if not period > 0:
        return None
    losses = _find_losses(stamps, position, period)
    is_cut = (losses > MAX_LOSS) | (np.diff(stamps, prepend=stamps[0]) > MAX_PAUSE)
    starts = [0, *np.flatnonzero(is_cut[1:]) + 1, len(stamps)]
    times = stamps.copy()
    slopes = []
    for start, stop in pairwise(starts):
        if stop - start >= MIN_MODEL_SAMPLES:
            steps = 1 + losses[start:stop]
            steps[0] = 0
            times[start:stop], slope = _fit_lines(np.cumsum(steps).astype(float), stamps[start:stop])
            slopes.append((stop - start, slope))
    if not slopes:
        return None
    lost = int(losses[losses <= MAX_LOSS].sum())
    return SamplingTimes(times, max(slopes)[1], lost)


def _estimate_period(stamps: Array) -> float:
    """Estimate the period [s] from stamps (M,): the median of the slopes of lines below windows of them."""
    size = min(PERIOD_WINDOW, len(stamps))
    numbers = np.arange(size, dtype=float)
    starts = range(0, len(stamps) - size + 1, max(1, size // 2))
    return float(np.median([support_line(numbers, stamps[start : start + size])[0] for start in starts]))


def support_line(x: Array, y: Array) -> tuple[float, float]:
    """Return slope and offset of the line below points (M,) whose mean distance from them is least.

    It is the edge of their lower convex hull at the mean abscissa. x ascends strictly.
    """
    middle = int(np.searchsorted(x, x.mean(), side="right"))
    left = slice(0, middle)
    right = slice(middle, len(x))
    slope = (y[-1] - y[0]) / (x[-1] - x[0])
    for _ in range(MAX_SEARCHES):
        heights = y - slope * x
        first = int(np.argmin(heights[left]))
        last = middle + int(np.argmin(heights[right]))
        previous = slope
        slope = (y[last] - y[first]) / (x[last] - x[first])
        if slope == previous:
            break
    return float(slope), float((y - slope * x).min())


def _find_losses(stamps: Array, position: Array, period: float) -> IntArray:
    """Return the number of samples (M,) that were lost before each sample.

    After a loss all stamps are later, relative to their number. After a stall the first ones are later, until the
    messages that waited are received. The least delays before and after a sample distinguish the two.
    """
    losses = np.zeros(len(stamps), dtype=int)
    delays = stamps - period * np.arange(len(stamps))
    shift = LOSS_REACH // 2
    after = minimum_filter1d(delays, LOSS_REACH, origin=-shift, mode="nearest")  # of i to i + 63
    before = minimum_filter1d(delays, LOSS_REACH, origin=shift - 1, mode="nearest")  # of i - 63 to i
    jumps = np.zeros(len(stamps))
    jumps[1:] = (after[1:] - before[:-1]) / period
    late = np.flatnonzero(jumps > MIN_LOSS)
    if len(late) == 0:
        return losses
    ratios = _displacement_ratios(position)
    steps = np.diff(stamps, prepend=stamps[0])
    for rows in np.split(late, np.flatnonzero(np.diff(late) > 1) + 1):
        lost = int(np.round(np.median(jumps[rows])))
        seen = np.maximum(np.round(ratios[rows]) - 1, 0)
        if not np.isfinite(seen).any():  # joints at rest show nothing
            if len(stamps) - rows[-1] > LOSS_REACH // 2:  # else the last messages may be late
                losses[rows[np.argmax(steps[rows])]] = lost
        elif lost <= np.nansum(seen) <= np.round(jumps[rows].sum()):
            losses[rows] = np.nan_to_num(seen)
        elif np.nanmax(ratios[rows]) > 1 + 0.5 * lost:
            losses[rows[np.nanargmax(ratios[rows])]] = lost
    return losses


def _displacement_ratios(position: Array) -> Array:
    """Return displacements from the previous sample (M,) over those of steps nearby; nan where joints hardly move."""
    displacements = np.linalg.norm(np.diff(position, axis=0, prepend=position[:1]), axis=1)
    changes = np.linalg.norm(np.diff(position, 2, axis=0, prepend=position[:1], append=position[-1:]), axis=1)
    size = 2 * NEIGHBOURS + 1
    typical = median_filter(displacements, size, mode="nearest")
    noise = median_filter(changes, size, mode="nearest")
    ratios = np.full(len(position), np.nan)
    is_moving = typical > MIN_SIGNAL * noise
    ratios[is_moving] = displacements[is_moving] / typical[is_moving]
    return ratios


def _fit_lines(numbers: Array, stamps: Array) -> tuple[Array, float]:
    """Return times (M,) [s] on lines below stamps (M,) over sample numbers (M,), and the median slope."""
    size = min(LINE_WINDOW, len(stamps))
    starts = np.unique(np.append(np.arange(0, len(stamps) - size, size // 2), len(stamps) - size))
    lines = np.array([support_line(numbers[s : s + size], stamps[s : s + size]) for s in starts])
    heights = lines[:, :1] * numbers + lines[:, 1:]
    if len(lines) == 1:
        return heights[0], float(lines[0, 0])
    centres = numbers[starts + size // 2]
    window = np.clip(np.searchsorted(centres, numbers) - 1, 0, len(centres) - 2)
    share = np.clip((numbers - centres[window]) / (centres[window + 1] - centres[window]), 0, 1)
    rows = np.arange(len(numbers))
    times = (1 - share) * heights[window, rows] + share * heights[window + 1, rows]
    return times, float(np.median(lines[:, 0]))


def motion_error(times: Array, position: Array, velocity: Array) -> float:
    """Sum of the squares by which positions (M, k) contradict times (M,) [s] of samples.

    Displacements are compared with velocities times steps, with one factor for each joint. Where no velocity (M, k) is
    measured (nan), each position is compared with the line through its neighbours. Both hardly amplify noise, whatever
    the times.
    """
    measured = np.isfinite(velocity).all(axis=0)
    error = 0.0
    if measured.any():
        travel = 0.5 * (velocity[1:, measured] + velocity[:-1, measured]) * np.diff(times)[:, None]
        displacement = np.diff(position[:, measured], axis=0)
        power = (travel**2).sum(0)
        product = (travel * displacement).sum(0)
        error += float(((displacement**2).sum(0) - product**2 / np.where(power > 0, power, 1)).sum())
    if not measured.all():
        q = position[:, ~measured]
        span = times[2:] - times[:-2]
        share = np.where(span > 0, (times[1:-1] - times[:-2]) / np.where(span > 0, span, 1), 0.5)[:, None]
        error += float(((q[1:-1] - (1 - share) * q[:-2] - share * q[2:]) ** 2).sum())
    return error
