"""From segments of recorded signals to motions of the joints: filtered, with accelerations, in pieces."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.recordings.odometry import concatenate_bases, filter_base_motion, slice_base
from robot_dynamics.recordings.position_jumps import split_at_jumps
from robot_dynamics.recordings.rest import moving_samples
from robot_dynamics.recordings.signals import choose_cutoff, differentiate, filter_margin, lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.inputs import Base
    from robot_dynamics.recordings.alignment import SignalSegment
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.position_jumps import PositionJump
    from robot_dynamics.recordings.sample_statistics import SampleStatistics

EDGE_PERIODS = 1.0  # periods of the cut-off at each end of a segment, where the filter has data on one side only
MIN_FILTER_SAMPLES = 20  # samples that the filter needs at any cut-off
PIECE_MARGINS = 4  # least length of a piece in margins, so that less than half of the samples are filtered twice


@dataclass(frozen=True, eq=False)
class Motion:
    """A piece of joint motion on a uniform grid, without a gap.

    Attributes
    ----------
    time : of the first sample [s] after the beginning of the recording.
    rate : samples per second.
    cutoff : cut-off frequency of the filter [Hz].
    q, qd, qdd : (N, n) positions, velocities, accelerations [rad or m, with s], filtered.
    efforts : (N, n) measured efforts [N m or N], filtered; zero where not measured.
    unfiltered_efforts : (N, n) measured efforts before the filter; zero where not measured.
    has_efforts : (n,) whether the efforts of a joint were measured.
    moving : (N, n) whether a joint moves; where it does not, friction holds any effort within an interval.
    base : motion of the base with accelerations, N samples; None where it was not recorded.
    recorded : (N,) number of samples that were recorded in each step; None where it is not known.
    jump : jump of the positions of the joints before the first sample; None where there is none.
    """

    time: float
    rate: float
    cutoff: float
    q: Array
    qd: Array
    qdd: Array
    efforts: Array
    unfiltered_efforts: Array
    has_efforts: BoolArray
    moving: BoolArray
    base: Base | None = None
    recorded: Array | None = None
    jump: PositionJump | None = None

    def __len__(self) -> int:
        return len(self.q)

    @property
    def times(self) -> Array:
        """(N,) times [s] of the samples."""
        times: Array = self.time + np.arange(len(self)) / self.rate
        return times

    @property
    def end(self) -> float:
        """Time [s] at which the next sample would be."""
        return self.time + len(self) / self.rate

    def concatenate(self, other: Motion) -> Motion:
        """The samples of both; `other` begins where this one ends."""
        return replace(
            self,
            q=np.concatenate([self.q, other.q]),
            qd=np.concatenate([self.qd, other.qd]),
            qdd=np.concatenate([self.qdd, other.qdd]),
            efforts=np.concatenate([self.efforts, other.efforts]),
            unfiltered_efforts=np.concatenate([self.unfiltered_efforts, other.unfiltered_efforts]),
            has_efforts=self.has_efforts & other.has_efforts,
            moving=np.concatenate([self.moving, other.moving]),
            base=concatenate_bases(self.base, other.base),
            recorded=_concatenate(self.recorded, other.recorded),
        )

    def slice_samples(self, begin: int, end: int, stride: int = 1) -> Motion:
        """Each `stride`-th sample from `begin` to `end`, without the last."""
        rows = slice(begin, end, stride)
        return replace(
            self,
            time=self.time + begin / self.rate,
            rate=self.rate / stride,
            q=self.q[rows],
            qd=self.qd[rows],
            qdd=self.qdd[rows],
            efforts=self.efforts[rows],
            unfiltered_efforts=self.unfiltered_efforts[rows],
            moving=self.moving[rows],
            base=slice_base(self.base, rows),
            recorded=None if self.recorded is None or stride > 1 else self.recorded[rows],
            jump=self.jump if begin == 0 else None,
        )


def _concatenate(first: Array | None, second: Array | None) -> Array | None:
    """Both arrays; None where one of them is not known."""
    return None if first is None or second is None else np.concatenate([first, second])


def filter_motions(
    signal_segments: Iterable[SignalSegment],
    drives: Drives,
    statistics: SampleStatistics,
    cutoff: float | None = None,
) -> Iterator[Motion]:
    """Yield the motions of the joints in segments of signals, low-pass filtered without delay.

    Accelerations are derivatives of filtered velocities; velocities that were not measured are derivatives of
    positions.

    Parameters
    ----------
    signal_segments : signals of the motors, in the order of `drives.names`; `BASE_SIGNALS` may follow them.
    drives : conversion from motors to joints.
    statistics : counts of skipped samples, updated while reading.
    cutoff : cut-off frequency [Hz]; None: 8, or a fifth of the rate where that is lower.

    Raises
    ------
    RecordingError
        Where the cut-off does not fit the rate.
    """
    motion_filter = MotionFilter(drives, statistics, cutoff)
    for segment in signal_segments:
        yield from motion_filter.feed(segment)
    yield from motion_filter.flush()


class MotionFilter:
    """`filter_motions` for segments that come one by one.

    The filter of a sample uses samples up to one margin, 6 periods of the cut-off, after it. A motion is therefore
    returned one margin after its samples, plus the new part of a piece.

    Parameters
    ----------
    piece_margins : length of a piece in margins of the filter, more than 2. Short pieces come sooner and filter more
        samples twice.
    """

    def __init__(
        self,
        drives: Drives,
        statistics: SampleStatistics,
        cutoff: float | None = None,
        piece_margins: float = PIECE_MARGINS,
    ) -> None:
        self._drives = drives
        self._statistics = statistics
        self._cutoff = cutoff
        self._piece_margins = piece_margins
        self._pending: _PendingSignals | None = None

    def feed(self, segment: SignalSegment) -> Iterator[Motion]:
        """Yield the motions that are complete with this segment."""
        for part in split_at_jumps(segment, len(self._drives.names)):
            yield from self._feed_part(part)

    def _feed_part(self, segment: SignalSegment) -> Iterator[Motion]:
        """Yield the motions that are complete with a segment without jumps."""
        if segment.jump is not None:
            self._statistics.counts["position_jumps"] += 1
        if not segment.is_continuation:
            yield from self.flush()
        if self._pending is None:
            cutoff = choose_cutoff(segment.rate, self._cutoff)
            self._pending = _PendingSignals(segment, self._drives, cutoff, self._piece_margins)
        yield from self._pending.feed(segment, self._statistics)

    def flush(self) -> Iterator[Motion]:
        """Yield the rest of the last segment; no samples continue it."""
        pending = self._pending
        self._pending = None
        if pending is not None:
            yield from pending.flush(self._statistics)


class _PendingSignals:
    """Signals of one segment whose filter needs later samples."""

    def __init__(self, segment: SignalSegment, drives: Drives, cutoff: float, piece_margins: float) -> None:
        self._drives = drives
        self._rate = segment.rate
        self._cutoff = cutoff
        self._margin = filter_margin(segment.rate, cutoff)
        self._edge = int(np.ceil(EDGE_PERIODS * segment.rate / cutoff))
        self._piece_size = piece_margins * self._margin + MIN_FILTER_SAMPLES
        self._time = segment.time  # of the first sample of `_signals`
        self._skipped = self._edge  # samples of `_signals` that are returned already, or never
        # (3, N, k) positions, velocities, efforts: motors, then the base where it was recorded
        self._signals = np.zeros((3, 0, segment.position.shape[1]))
        self._recorded: Array | None = np.zeros(0)
        self._jump = None if segment.jump is None else _jump_of_joints(segment.jump, drives)  # not returned yet

    def feed(self, segment: SignalSegment, statistics: SampleStatistics) -> Iterator[Motion]:
        """Append a segment; yield the motion of a piece that is complete."""
        self._note_missing_signals(segment, statistics)
        new = np.stack([segment.position, segment.velocity, segment.effort])
        self._signals = np.concatenate([self._signals, new], axis=1)
        self._recorded = _concatenate(self._recorded, segment.recorded)
        size = self._signals.shape[1]
        if size >= self._piece_size:
            yield self._filter_samples(size - self._margin)
            first_kept = size - 2 * self._margin
            self._time += first_kept / self._rate
            self._signals = self._signals[:, first_kept:]
            self._recorded = None if self._recorded is None else self._recorded[first_kept:]
            self._skipped = self._margin

    def _note_missing_signals(self, segment: SignalSegment, statistics: SampleStatistics) -> None:
        for column, name in enumerate(self._drives.names):
            if not np.isfinite(segment.velocity[:, column]).all():
                statistics.note_joint("velocities that were not measured and are derivatives of positions", name)
        for column, name in enumerate(self._drives.names):
            if not np.isfinite(segment.effort[:, column]).all():
                statistics.note_joint("efforts that were not measured", name)

    def flush(self, statistics: SampleStatistics) -> Iterator[Motion]:
        """Yield the motion of the last samples; too short segments and edges are counted."""
        size = self._signals.shape[1]
        if size < max(self._margin, MIN_FILTER_SAMPLES) and self._skipped == self._edge:
            statistics.counts["too_short"] += size
        elif size - self._edge > self._skipped:
            statistics.counts["edges"] += 2 * self._edge
            yield self._filter_samples(size - self._edge)

    def _filter_samples(self, end: int) -> Motion:
        """The motion of the samples from the first that is not returned yet to `end`."""
        k = len(self._drives.names)
        position, velocity, effort = self._signals[..., :k]
        no_velocity = ~np.isfinite(velocity).all(axis=0)
        velocity = np.where(no_velocity, differentiate(position, self._rate) if no_velocity.any() else 0, velocity)
        no_effort = ~np.isfinite(effort).all(axis=0)
        effort = np.where(no_effort, 0.0, effort)
        q, qd, efforts = self._drives.to_joint_space(position, velocity, effort)
        has_efforts = ~(np.abs(self._drives.ratios[no_effort]) > 0).any(axis=0)
        filtered_q, filtered_qd, filtered_efforts = (
            lowpass(values, self._rate, self._cutoff) for values in (q, qd, efforts)
        )
        qdd = differentiate(filtered_qd, self._rate)
        rows = slice(self._skipped, end)
        base = None
        if self._signals.shape[2] > k:
            base = slice_base(filter_base_motion(self._signals[0, :, k:], self._rate, self._cutoff), rows)
        jump = self._jump
        self._jump = None
        return Motion(
            time=self._time + self._skipped / self._rate,
            rate=self._rate,
            cutoff=self._cutoff,
            q=filtered_q[rows],
            qd=filtered_qd[rows],
            qdd=qdd[rows],
            efforts=filtered_efforts[rows] * has_efforts,
            unfiltered_efforts=efforts[rows] * has_efforts,
            has_efforts=has_efforts,
            moving=moving_samples(filtered_q, self._rate, self._cutoff)[rows],
            base=base,
            recorded=None if self._recorded is None else self._recorded[rows],
            jump=jump,
        )


def _jump_of_joints(jump: PositionJump, drives: Drives) -> PositionJump:
    """The jump of the joints for a jump of the motors."""
    inverse = np.linalg.inv(drives.ratios)
    return replace(jump, sizes=inverse @ jump.sizes, velocities=inverse @ jump.velocities)
