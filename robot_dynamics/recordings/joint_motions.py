"""From stretches of recorded signals to motions of the joints: filtered, with accelerations, in pieces."""

from dataclasses import dataclass, replace

import numpy as np

from robot_dynamics.inputs import Base
from robot_dynamics.recordings.odometry import concatenate_bases, filter_base_motion, slice_base
from robot_dynamics.recordings.signals import choose_cutoff, differentiate, filter_margin, lowpass

EDGE_PERIODS = 1.0  # periods of the cut-off at each end of a stretch in which the filter has to guess what was beyond
MIN_FILTER_SAMPLES = 20  # samples that the filter needs, however high its cut-off
SAMPLED_FIELDS = ("q", "qd", "qdd", "efforts", "unfiltered_efforts")  # of a Motion, a row for each sample
PIECE_MARGINS = 4  # margins that a piece has at least, so that less than half of the work is done twice


@dataclass(frozen=True, eq=False)
class Motion:
    """A piece of motion on a uniform grid, without a gap.

    time: of the first sample [s]; rate [1/s]; cutoff [Hz]; q, qd, qdd, efforts: (N, n), filtered; unfiltered: the
    efforts (N, n) before; measured: (n,) whether efforts of a joint were measured at all, they are zero where not;
    base: Base of N samples with accelerations, None where none was recorded.
    """

    time: float
    rate: float
    cutoff: float
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    efforts: np.ndarray
    unfiltered_efforts: np.ndarray
    has_efforts: np.ndarray
    base: Base | None = None

    def __len__(self):
        return len(self.q)

    @property
    def times(self):
        """(N,) [s]."""
        return self.time + np.arange(len(self)) / self.rate

    @property
    def end(self):
        """The time [s] at which the next sample would be."""
        return self.time + len(self) / self.rate

    def concatenate(self, other):
        """The Motion of the samples of both."""
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in SAMPLED_FIELDS}
        base = concatenate_bases(self.base, other.base)
        return replace(self, has_efforts=self.has_efforts & other.has_efforts, base=base, **arrays)

    def slice_samples(self, begin, end):
        """The Motion of samples `begin` to `end`."""
        arrays = {name: getattr(self, name)[begin:end] for name in SAMPLED_FIELDS}
        base = slice_base(self.base, slice(begin, end))
        return replace(self, time=self.time + begin / self.rate, base=base, **arrays)


def filter_motions(signal_segments, drives, statistics, cutoff=None):
    """Yield the Motions of Stretches: joints of drives, what is above the cut-off [Hz] taken away, without delay.
    Stretches may have SIGNALS of a base after those of the motors.

    cutoff: None: `DEFAULT_CUTOFF`, or what the rate allows. Accelerations are derivatives of filtered velocities,
    velocities that were not measured those of positions. Raises RecordingError.
    """
    smoothing = MotionFilter(drives, statistics, cutoff)
    for stretch in signal_segments:
        yield from smoothing.feed(stretch)
    yield from smoothing.flush()


class MotionFilter:
    """What `motions` does, for Stretches that come one by one.

    piece: margins of the filter that are there before it runs, more than 2: the fewer, the sooner Motions come, and the
    more often what lies in the margins is filtered. A sample is told one margin, 6 periods of the cut-off, after it
    came, and what is new of a piece besides: what comes after it, the filter must see.
    """

    def __init__(self, drives, statistics, cutoff=None, piece=PIECE_MARGINS):
        self._drives, self._tally, self._cutoff, self._piece = drives, statistics, cutoff, piece
        self._pending = None

    def feed(self, stretch):
        """Yield the Motions that are ready."""
        if not stretch.is_continuation:
            yield from self.flush()
        if self._pending is None:
            cutoff = choose_cutoff(stretch.rate, self._cutoff)
            self._pending = _Pending(stretch, self._drives, cutoff, self._piece)
        yield from self._pending.feed(stretch, self._tally)

    def flush(self):
        """Yield what waited for more, which does not come."""
        pending, self._pending = self._pending, None
        if pending is not None:
            yield from pending.flush(self._tally)


class _Pending:
    """Samples of one stretch that wait for those after them, which the filter must see."""

    def __init__(self, stretch, drives, cutoff, piece):
        self.drives, self.rate, self.cutoff, self.piece = drives, stretch.rate, cutoff, piece
        self.filter_margin = filter_margin(stretch.rate, cutoff)
        self.edge = int(np.ceil(EDGE_PERIODS * stretch.rate / self.cutoff))
        self.time, self.skipped = stretch.time, self.edge
        self.signals = np.zeros((3, 0, stretch.position.shape[1]))  # motors, then the base where it was recorded

    def feed(self, stretch, statistics):
        k = len(self.drives.names)
        for name in np.array(self.drives.names)[~np.isfinite(stretch.velocity[:, :k]).all(axis=0)]:
            statistics["velocities that were not measured, and are derivatives of positions"] = str(name)
        for name in np.array(self.drives.names)[~np.isfinite(stretch.effort[:, :k]).all(axis=0)]:
            statistics["efforts that were not measured"] = str(name)
        new = np.stack([stretch.position, stretch.velocity, stretch.effort])
        self.signals = np.concatenate([self.signals, new], axis=1)
        if self.signals.shape[1] >= self.piece * self.filter_margin + MIN_FILTER_SAMPLES:
            yield self._filtered(self.signals.shape[1] - self.filter_margin)
            keep = self.signals.shape[1] - 2 * self.filter_margin
            self.time += keep / self.rate
            self.signals, self.skipped = self.signals[:, keep:], self.filter_margin

    def flush(self, statistics):
        size = self.signals.shape[1]
        if size < max(self.filter_margin, MIN_FILTER_SAMPLES) and self.skipped == self.edge:
            statistics.counts["too_short"] += size
        elif size - self.edge > self.skipped:
            statistics.counts["edges"] += 2 * self.edge
            yield self._filtered(size - self.edge)

    def _filtered(self, end):
        """The Motion of the samples from those that were told already to `end`."""
        k = len(self.drives.names)
        position, velocity, effort = self.signals[..., :k]
        lost = ~np.isfinite(velocity).all(axis=0)
        velocity = np.where(lost, differentiate(position, self.rate) if lost.any() else 0, velocity)
        unmeasured = ~np.isfinite(effort).all(axis=0)
        q, qd, efforts = self.drives.to_joint_space(position, velocity, np.where(unmeasured, 0.0, effort))
        measured = ~(np.abs(self.drives.ratios[unmeasured]) > 0).any(axis=0)
        smooth_q, smooth_qd, smooth = (lowpass(values, self.rate, self.cutoff) for values in (q, qd, efforts))
        qdd = differentiate(smooth_qd, self.rate)
        core, base = slice(self.skipped, end), None
        if self.signals.shape[2] > k:
            base = slice_base(filter_base_motion(self.signals[0, :, k:], self.rate, self.cutoff), core)
        return Motion(
            self.time + self.skipped / self.rate, self.rate, self.cutoff, smooth_q[core], smooth_qd[core], qdd[core],
            smooth[core] * measured, efforts[core] * measured, measured, base,
        )  # fmt: skip
