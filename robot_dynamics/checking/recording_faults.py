"""Faults of a recording itself: encoders that jump, and rows that are missing. They show in positions and stamps."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.checking.fault_search import Fault

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.fault_signals import FaultSignals
    from robot_dynamics.recordings.position_jumps import PositionJump

MAX_OTHER_JUMP = 0.2  # of the other joints, relative to that of the joint whose encoder jumps
MAX_SWAP_MISFIT = 0.1  # sum of the jumps of two joints whose columns are swapped, relative to the distance
COUNT_DURATION = 1.0  # [s] in which recorded samples are counted
MIN_BLOCKS = 3  # before and after the beginning of a loss
MIN_LOSS = 0.05  # part of the rows that are missing
LOSS_DEVIATIONS = 6.0  # standard deviations of the counts before and after, by which these differ at least
MIN_LOSS_CONSISTENCY = 0.9  # part of the blocks that are on the right side of the mean of both counts
MIN_GAP = 0.1  # [s] without a row


def fault_of_jump(jump: PositionJump, joint_names: Sequence[str], step: float) -> Fault | None:
    """The fault that a jump of positions shows; None where it is none of those that are known.

    Parameters
    ----------
    jump : of n joints.
    joint_names : of the n joints.
    step : time between samples [s].
    """
    sizes = np.abs(jump.sizes)
    largest = int(np.argmax(sizes))
    others = np.delete(sizes, largest)
    between = jump.time - 2 * step, jump.time + 2 * step
    if (others <= MAX_OTHER_JUMP * sizes[largest]).all():
        name = joint_names[largest]
        sentence = f"the position of {name} jumps by {jump.sizes[largest]:+.3g} at {jump.time:.4g} s"
        return Fault("offset", (name,), jump.time, between, None, None, sentence)
    pair = _swapped_pair(jump)
    if pair is not None:
        names = joint_names[pair[0]], joint_names[pair[1]]
        sentence = f"the columns of {names[0]} and {names[1]} are swapped, since {jump.time:.4g} s"
        return Fault("swapped", names, jump.time, between, None, None, sentence)
    duration = jump.missing_duration
    if duration is not None:
        sentence = f"rows of {duration:.2g} s are missing at {jump.time:.4g} s, where stamps show no gap"
        return Fault("missing", (), jump.time, between, None, None, sentence)
    return None


def _swapped_pair(jump: PositionJump) -> tuple[int, int] | None:
    """The two joints that jump by the same distance in opposite directions, while no other joint jumps."""
    if len(jump.sizes) < 2:
        return None
    order = np.argsort(-np.abs(jump.sizes))
    first, second = sorted(order[:2].tolist())
    distance = abs(float(jump.sizes[first] - jump.sizes[second])) / 2
    is_swap = abs(jump.sizes[first] + jump.sizes[second]) <= MAX_SWAP_MISFIT * distance
    return (first, second) if is_swap and (np.abs(jump.sizes[order[2:]]) <= MAX_OTHER_JUMP * distance).all() else None


class Gap(NamedTuple):
    """A time without rows; start, duration: [s]."""

    start: float
    duration: float


def find_missing_rows(signals: FaultSignals, longest_gap: Gap | None) -> Fault | None:
    """Find rows that are missing: a rate of samples that falls, or a gap; None where there are none.

    Parameters
    ----------
    signals : of the recording.
    longest_gap : of the recording; None where there is none.
    """
    lower_rate = _find_lower_rate(signals.times, signals.recorded)
    if lower_rate is not None or longest_gap is None or longest_gap.duration < MIN_GAP:
        return lower_rate
    start, duration = longest_gap
    sentence = f"no row can be used from {start:.4g} to {start + duration:.4g} s: rows are missing or incomplete"
    return Fault("missing", (), start, (start - signals.step, start + signals.step), None, None, sentence)


def _find_lower_rate(times: Array, recorded: Array) -> Fault | None:
    """Find the time from which fewer rows are recorded; recorded: (N,) rows in each step."""
    numbers = np.floor((times - times[0]) / COUNT_DURATION).astype(int)
    starts = np.flatnonzero(np.diff(numbers, prepend=-1))
    counts = np.diff([*starts, len(times)])
    complete = counts > 0.5 * np.median(counts)
    starts = starts[complete]
    means = (np.add.reduceat(recorded, np.flatnonzero(np.diff(numbers, prepend=-1))) / counts)[complete]
    if len(means) < 2 * MIN_BLOCKS:
        return None
    cuts = range(MIN_BLOCKS, len(means) - MIN_BLOCKS + 1)
    squares = [np.var(means[:cut]) * cut + np.var(means[cut:]) * (len(means) - cut) for cut in cuts]
    cut = cuts[int(np.argmin(squares))]
    before, after = means[:cut], means[cut:]
    loss = 1 - after.mean() / before.mean()
    deviation = np.sqrt(before.var() / len(before) + after.var() / len(after))
    middle = 0.5 * (before.mean() + after.mean())
    consistency = min((before > middle).mean(), (after < middle).mean())
    is_loss = before.mean() - after.mean() > LOSS_DEVIATIONS * deviation and consistency >= MIN_LOSS_CONSISTENCY
    if not is_loss or loss < MIN_LOSS:
        return None
    # within a block before and after the cut: the step of the sum of deviations from both means
    near = slice(starts[cut - 2], starts[min(cut + 1, len(starts) - 1)])
    sums = np.cumsum(recorded[near] - middle)
    row = near.start + int(np.argmax(sums))
    onset = float(times[row])
    between = float(times[near.start]), float(times[near.stop - 1])
    sentence = f"{100 * loss:.2g} % of the rows are missing, since {onset:.4g} s"
    return Fault("missing", (), onset, between, None, None, sentence)
