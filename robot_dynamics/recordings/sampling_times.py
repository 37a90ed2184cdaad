"""Sampling times from stamps that jitter: a model of the clock of the sender.

A sender that samples at a constant period T stamps its sample number k, or its receiver does, at

    stamp_k = offset + k T + delay_k,    delay_k >= 0,

where delays are those of a busy machine: messages wait, and are then stamped in a burst. The line below all stamps that
is closest to them has the offset and the period of the sender. It is fitted to overlapping windows of samples, because
clocks drift. Moon, Skelly and Towsley, Estimation and removal of clock skew from network delay measurements (1999).

Samples that were lost shift all later stamps. Whether these times are right, and not the stamps, is a question of
evidence: between two samples a joint moves by its velocity times the time between them. An encoder that is set anew is
no evidence of time: its jump is left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.ndimage import median_filter, minimum_filter1d

from robot_dynamics.recordings.position_jumps import find_encoder_jumps

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray

MIN_MODEL_SAMPLES = 130  # samples that are needed for a model
MAX_EVEN_DEVIATION = 0.1  # of the median step: stamps whose steps deviate less are even, and are not changed
MIN_WINDOW = 64  # samples; windows are this long or, at high rates, LOSS_DURATION, whichever is longer
LOSS_DURATION = 0.25  # [s] on each side of a loss, in which all stamps have to agree on it
PERIOD_WINDOW = 2  # windows, for the first estimate of the period
LINE_WINDOW = 8  # windows, in which one line is fitted
MIN_LOSS = 0.6  # [periods] shift of stamps that is a loss
NEIGHBOURS = 10  # steps on each side whose displacements are compared with that of a loss
MAX_RATIO_ERROR = 0.25  # deviation of displacements from a multiple of the usual ones that shows a loss
MIN_SIGNAL = 4.0  # displacements over their changes, above which a loss is seen in them
MAX_LOSS = 20  # lost samples beyond which the samples after them get an offset of their own
MAX_PAUSE = 1.0  # [s] between stamps, beyond which the samples after it get an offset of their own
MAX_SEARCHES = 50
LAGS = (1, 4, 16, 64)  # samples over which positions are compared with times


@dataclass(frozen=True, eq=False)
class SamplingTimes:
    """The model of the stamps of M samples.

    times: (M,) [s] at which they were sampled; period: [s] of the sender; losses: (M,) number of samples that were lost
    before each, at most `MAX_LOSS`; parts: (M,) numbers of the parts between pauses, longer losses and encoder jumps.
    """

    times: Array
    period: float
    losses: IntArray
    parts: IntArray


def are_even(stamps: Array) -> bool:
    """Whether the steps between stamps (M,) [s] deviate little from their median."""
    steps = np.diff(stamps)
    if len(steps) == 0:
        return True
    median = np.median(steps)
    return bool(np.abs(steps - median).max() <= MAX_EVEN_DEVIATION * median)


def fit_sampling_times(stamps: Array, position: Array, velocity: Array) -> SamplingTimes | None:
    """Fit the model of a sender with a constant period.

    Losses are those that stamps show or, if it agrees better with the motion, those that displacements show.

    Parameters
    ----------
    stamps : (M,) [s], ascending; equal ones are allowed.
    position, velocity : (M, k) of the joints; velocities that were not measured are nan.

    Returns
    -------
    SamplingTimes or None
        None where the samples are too few, or have no period.
    """
    if len(stamps) < MIN_MODEL_SAMPLES or not stamps[-1] > stamps[0]:
        return None
    mean_step = (stamps[-1] - stamps[0]) / (len(stamps) - 1)
    window = max(MIN_WINDOW, min(len(stamps), round(LOSS_DURATION / mean_step)))
    jumps = find_encoder_jumps(position, 1 / mean_step)
    ratios = _step_ratios(position, velocity)
    ratios[jumps] = np.nan
    seen_losses = _seen_losses(ratios)
    models = [_fit_model(stamps, np.zeros(len(stamps), dtype=int), ratios, jumps, window)]
    if seen_losses.any():
        models.append(_fit_model(stamps, seen_losses, ratios, jumps, window))
    return min(
        (model for model in models if model is not None),
        key=lambda model: motion_errors(model.times, position, velocity, model.parts)[0],
        default=None,
    )


def _fit_model(
    stamps: Array, seen_losses: IntArray, ratios: Array, jumps: BoolArray, window: int
) -> SamplingTimes | None:
    """Fit the model to stamps (M,) with losses (M,) that displacements show; others are those that stamps show."""
    numbers = np.cumsum(1 + seen_losses).astype(float)
    period = _estimate_period(numbers, stamps, PERIOD_WINDOW * window)
    if not period > 0:
        return None
    delays = stamps - period * numbers
    losses = seen_losses + _find_losses(delays / period, stamps, ratios / (1 + seen_losses), window)
    is_cut = (losses > MAX_LOSS) | (np.diff(stamps, prepend=stamps[0]) > MAX_PAUSE)
    starts = [0, *np.flatnonzero(is_cut[1:]) + 1, len(stamps)]
    times = stamps.copy()
    slopes = []
    for start, stop in pairwise(starts):
        if stop - start >= MIN_MODEL_SAMPLES:
            numbers = np.cumsum(1 + losses[start:stop]).astype(float)
            times[start:stop], slope = _fit_lines(numbers, stamps[start:stop], LINE_WINDOW * window)
            slopes.append((stop - start, slope))
    if not slopes:
        return None
    return SamplingTimes(times, max(slopes)[1], np.where(is_cut, 0, losses), np.cumsum(is_cut | jumps))


def _estimate_period(numbers: Array, stamps: Array, window: int) -> float:
    """Estimate the period [s] from sample numbers and stamps (M,): the median slope of lines below windows of them."""
    size = min(window, len(stamps))
    parts = [slice(start, start + size) for start in range(0, len(stamps) - size + 1, max(1, size // 2))]
    return float(np.median([support_line(numbers[part], stamps[part])[0] for part in parts]))


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


def _find_losses(delays: Array, stamps: Array, ratios: Array, window: int) -> IntArray:
    """Return the number of samples (M,) that were lost before each sample, by delays (M,) in periods.

    After a loss all stamps are later, relative to their number. After a stall the first ones are later, until the
    messages that waited are received. The least delays in a window before and after a sample distinguish the two.
    ratios: (M,) of `_step_ratios`.
    """
    losses = np.zeros(len(stamps), dtype=int)
    shift = window // 2
    after = minimum_filter1d(delays, 2 * shift, origin=-shift, mode="nearest")  # of i to i + window - 1
    before = minimum_filter1d(delays, 2 * shift, origin=shift - 1, mode="nearest")  # of i - window + 1 to i
    rises = np.zeros(len(stamps))
    rises[1:] = after[1:] - before[:-1]
    late = np.flatnonzero(rises > MIN_LOSS)
    if len(late) == 0:
        return losses
    steps = np.diff(stamps, prepend=stamps[0])
    for rows in np.split(late, np.flatnonzero(np.diff(late) > 1) + 1):
        loss_by_stamps = int(np.round(np.median(rises[rows])))
        losses_by_travel = np.maximum(np.round(ratios[rows]) - 1, 0)
        if not np.isfinite(losses_by_travel).any():  # joints at rest show nothing
            if len(stamps) - rows[-1] > window // 2:  # else the last messages may be late
                losses[rows[np.argmax(steps[rows])]] = loss_by_stamps
        elif loss_by_stamps <= np.nansum(losses_by_travel) <= np.round(rises[rows].sum()):
            losses[rows] = np.nan_to_num(losses_by_travel)
        elif np.nanmax(ratios[rows]) > 1 + 0.5 * loss_by_stamps:
            losses[rows[np.nanargmax(ratios[rows])]] = loss_by_stamps
    return losses


def _step_ratios(position: Array, velocity: Array) -> Array:
    """Return how many usual steps joints travelled from the sample before (M,); nan where they hardly move.

    Travel is compared with that of steps nearby and, where all velocities are measured, with their mean; the lesser
    ratio counts.
    """
    displacement = np.diff(position, axis=0, prepend=position[:1])
    changes = np.linalg.norm(np.diff(position, 2, axis=0, prepend=position[:1], append=position[-1:]), axis=1)
    size = 2 * NEIGHBOURS + 1
    noise = median_filter(changes, size, mode="nearest")
    travel = median_filter(np.linalg.norm(displacement, axis=1), size, mode="nearest")
    is_moving = travel > MIN_SIGNAL * noise
    is_moving[0] = False
    ratios = np.full(len(position), np.nan)
    ratios[is_moving] = np.linalg.norm(displacement[is_moving], axis=1) / travel[is_moving]
    if is_moving.any() and np.isfinite(velocity).all():
        mean = 0.5 * (velocity[1:] + velocity[:-1])[is_moving[1:]]
        power = (mean**2).sum(1)
        durations = (mean * displacement[is_moving]).sum(1) / np.where(power > 0, power, np.inf)
        usual = np.median(durations)
        if usual > 0:
            ratios[is_moving] = np.minimum(ratios[is_moving] + MAX_RATIO_ERROR, durations / usual)
    return ratios


def _seen_losses(ratios: Array) -> IntArray:
    """Return the number of samples (M,) that were lost before each sample, by ratios (M,) that are nearly integers."""
    losses = np.zeros(len(ratios), dtype=int)
    with np.errstate(invalid="ignore"):
        is_integer = (np.abs(ratios - np.round(ratios)) < MAX_RATIO_ERROR) & (ratios > 1.5)
    losses[is_integer] = np.round(ratios[is_integer]).astype(int) - 1
    return losses


def _fit_lines(numbers: Array, stamps: Array, window: int) -> tuple[Array, float]:
    """Return times (M,) [s] on lines below windows of stamps (M,) over sample numbers (M,), and the median slope."""
    size = min(window, len(stamps))
    starts = np.unique(np.append(np.arange(0, len(stamps) - size, size // 2), len(stamps) - size))
    lines = np.array([support_line(numbers[s : s + size], stamps[s : s + size]) for s in starts])
    heights = lines[:, :1] * numbers + lines[:, 1:]
    if len(lines) == 1:
        return heights[0], float(lines[0, 0])
    centres = numbers[starts + size // 2]
    nearest = np.clip(np.searchsorted(centres, numbers) - 1, 0, len(centres) - 2)
    share = np.clip((numbers - centres[nearest]) / (centres[nearest + 1] - centres[nearest]), 0, 1)
    rows = np.arange(len(numbers))
    times = (1 - share) * heights[nearest, rows] + share * heights[nearest + 1, rows]
    return times, float(np.median(lines[:, 0]))


def motion_errors(times: Array, position: Array, velocity: Array, parts: IntArray) -> Array:
    """Sums of the squares by which positions (M, k) contradict times (M,) [s] of samples, for each of `LAGS` (L,).

    Displacements over some samples are compared with integrals of velocities, with one factor for each joint. Where no
    velocity (M, k) is measured (nan), each position is compared with the line through a sample before and one after it.
    Both hardly amplify noise, whatever the times. Short lags show jitter, long ones losses that were not noticed.
    Samples are compared within parts (M,).
    """
    measured = np.isfinite(velocity).all(axis=0)
    errors = np.zeros(len(LAGS))
    steps = 0.5 * (velocity[1:, measured] + velocity[:-1, measured]) * np.diff(times)[:, None]
    travel = np.zeros((len(times), int(measured.sum())))
    np.cumsum(steps, axis=0, out=travel[1:])
    q_measured = position[:, measured]
    q = position[:, ~measured]
    for number, lag in enumerate(LAGS):
        inside = (parts[lag:] == parts[:-lag])[:, None]
        expected = (travel[lag:] - travel[:-lag]) * inside
        displacement = (q_measured[lag:] - q_measured[:-lag]) * inside
        power = (expected**2).sum(0)
        product = (expected * displacement).sum(0)
        errors[number] += ((displacement**2).sum(0) - product**2 / np.where(power > 0, power, 1)).sum()
        inside = (parts[2 * lag :] == parts[: -2 * lag])[:, None]
        span = times[2 * lag :] - times[: -2 * lag]
        share = np.where(span > 0, (times[lag:-lag] - times[: -2 * lag]) / np.where(span > 0, span, 1), 0.5)[:, None]
        deviation = q[lag:-lag] - (1 - share) * q[: -2 * lag] - share * q[2 * lag :]
        errors[number] += ((deviation * inside) ** 2).sum()
    return errors
