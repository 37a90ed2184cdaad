"""Jumps of positions: changes that no motion explains, as of an encoder that is set anew or of rows that are missing.

The velocities before and after a jump agree, but the position changes by more than they explain, within a time in which
no joint moves so far from one velocity to the same. A filter would smear a jump over a period of its cut-off and make
large accelerations of it: signals are cut there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.recordings.alignment import SignalSegment

MIN_JUMP = 0.01  # [rad or m]
MIN_ACCELERATION = 150.0  # [rad/s² or m/s²] that a motion would need to explain a jump
NOISE_RATIO = 12.0  # of a jump over the usual third difference of positions
MIN_CHANGES = 100  # third differences that are not 0, of which a median is taken: more than those of a few jumps
ROUNDING = 1e-9  # third differences that are 0, relative to the largest
MAX_ROWS = 6  # steps over which interpolation may spread a jump
MAX_RINGING = 0.25  # of the step after a jump, relative to the jump: interpolation rings
NEIGHBOUR_DURATION = 0.08  # [s] before and after a jump that tells the velocity
MIN_NEIGHBOURS, MAX_NEIGHBOURS = 3, 8  # steps in it
MAX_VELOCITY_CHANGE = 0.3  # of the velocity at a jump, relative to the velocity that it appears to have
MAX_SIZE_AT_REST = 0.05  # of the jump of a joint that does not jump, relative to the largest jump
MAX_MISFIT = 0.3  # of a jump that is not velocity times a duration, relative to the jump


@dataclass(frozen=True, eq=False)
class PositionJump:
    """A jump of positions.

    Attributes
    ----------
    time : of the first sample after it [s].
    sizes : (k,) change of positions beside the motion [rad or m]; zero where a position does not jump.
    velocities : (k,) before and after it [rad/s or m/s].
    """

    time: float
    sizes: Array
    velocities: Array

    @property
    def missing_duration(self) -> float | None:
        """Time [s] of the motion that is missing, where all joints jump along their velocities; else None.

        Rows that are missing make such a jump. An encoder that is set anew makes another one, or one joint jumps alone.
        """
        power = float(self.velocities @ self.velocities)
        sizes = np.sort(np.abs(self.sizes))
        if not power > 0 or (len(sizes) > 1 and sizes[-2] <= MAX_SIZE_AT_REST * sizes[-1]):
            return None
        duration = float(self.sizes @ self.velocities) / power
        misfit = np.linalg.norm(self.sizes - duration * self.velocities)
        return duration if duration > 0 and misfit <= MAX_MISFIT * np.linalg.norm(self.sizes) else None


def find_encoder_jumps(position: Array, rate: float) -> BoolArray:
    """Find rows whose change from the row before is one of encoders, not of the motion nor of rows that are missing.

    Parameters
    ----------
    position : (M, k) of samples that are nearly evenly spaced.
    rate : samples per second.

    Returns
    -------
    (M,) whether a row is such a row; a jump that is spread over some rows has all of them.
    """
    rows = np.zeros(len(position), dtype=bool)
    for first, last, sizes, velocities in _find_jumps(position, rate):
        if PositionJump(last / rate, sizes, velocities).missing_duration is None:
            rows[first : last + 1] = True
    return rows


def split_at_jumps(segment: SignalSegment, columns: int) -> Iterator[SignalSegment]:
    """Yield the parts of a segment between jumps of its first columns.

    Parts after a jump have it as `jump`, and continue nothing.
    """
    begin = 0
    jump: PositionJump | None = None
    for first, last, sizes, velocities in _find_jumps(segment.position[:, :columns], segment.rate):
        yield _part(segment, begin, first, jump)
        begin = last
        jump = PositionJump(segment.time + begin / segment.rate, sizes, velocities)
    if begin == 0:
        yield segment
    else:
        yield _part(segment, begin, len(segment), jump)


def _part(segment: SignalSegment, begin: int, end: int, jump: PositionJump | None) -> SignalSegment:
    """The samples of a segment from `begin` to `end`, without the last."""
    rows = slice(begin, end)
    return replace(
        segment,
        time=segment.time + begin / segment.rate,
        position=segment.position[rows],
        velocity=segment.velocity[rows],
        effort=segment.effort[rows],
        recorded=None if segment.recorded is None else segment.recorded[rows],
        is_continuation=segment.is_continuation and begin == 0,
        jump=jump,
    )


def _find_jumps(position: Array, rate: float) -> Iterator[tuple[int, int, Array, Array]]:
    """Yield for each jump the row after the last one before it, the first row after it, sizes and velocities (k,)."""
    neighbours = int(np.clip(round(NEIGHBOUR_DURATION * rate), MIN_NEIGHBOURS, MAX_NEIGHBOURS))
    steps = np.diff(position, axis=0)
    changes = np.abs(np.diff(steps, axis=0))
    if len(changes) < 2 * neighbours:
        return
    noise = np.array([_usual_change(column) for column in np.abs(np.diff(position, 3, axis=0)).T])
    threshold = np.maximum(0.25 * MIN_JUMP, NOISE_RATIO * noise)
    end = neighbours
    for first in (1 + np.flatnonzero((changes > threshold).any(axis=1))).tolist():
        if first < end:
            continue
        jump = _jump_at(steps, first, neighbours, threshold, rate)
        if jump is not None:
            width, sizes, velocities = jump
            end = first + width + neighbours
            yield first + 1, first + width, sizes, velocities


def _usual_change(third_differences: Array) -> float:
    """Median of the sizes (M,) of third differences: the change of a smooth motion from step to step changes little.

    Quantised positions of a joint at rest do not change at all. They count only where nearly all are of that kind:
    their steps in motion are no jumps.
    """
    largest = float(third_differences.max())
    changing = third_differences[third_differences > ROUNDING * largest]
    return float(np.median(changing if len(changing) >= MIN_CHANGES else third_differences))


def _jump_at(
    steps: Array, first: int, neighbours: int, threshold: Array, rate: float
) -> tuple[int, Array, Array] | None:
    """Width in steps, sizes (k,) and velocities (k,) of the jump that begins with a step; None where there is none."""
    before = np.median(steps[first - neighbours : first], axis=0)
    begins = np.abs(steps[first] - before) > threshold
    for width in range(1, MAX_ROWS + 1):
        later = steps[first + width : first + width + neighbours]
        if len(later) < neighbours:
            return None
        after = np.median(later, axis=0)
        usual = 0.5 * (before + after)
        sizes = steps[first : first + width].sum(axis=0) - width * usual
        is_jump = begins & (np.abs(sizes) > MIN_JUMP)
        is_jump &= 4 * np.abs(sizes) * (rate / width) ** 2 > MIN_ACCELERATION
        is_jump &= np.abs(after - before) < MAX_VELOCITY_CHANGE * np.abs(sizes) / width
        largest = np.abs(sizes).max()
        has_settled = np.abs(steps[first + width] - after) < MAX_RINGING * largest
        if is_jump.any() and has_settled.all():
            return width, np.where(np.abs(sizes) > 0.02 * largest, sizes, 0.0), usual * rate
    return None
