"""From stretches of recorded signals to motions of the joints: filtered, with accelerations, in pieces."""

from dataclasses import dataclass, replace

import numpy as np

from robot_dynamics.question import Base
from robot_dynamics.replay.base_motion import base_motion, joined, part_of
from robot_dynamics.replay.signals import cutoff_of, differentiated, lowpass, margin

EDGE = 1.0  # periods of the cut-off at each end of a stretch in which the filter has to guess what was beyond
LEAST = 20  # samples that the filter needs, however high its cut-off
SAMPLED = ("q", "qd", "qdd", "efforts", "unfiltered")  # of a Motion, a row for each sample
PIECE = 4  # margins that a piece has at least, so that less than half of the work is done twice


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
    unfiltered: np.ndarray
    measured: np.ndarray
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

    def followed_by(self, other):
        """The Motion of the samples of both."""
        arrays = {name: np.concatenate([getattr(self, name), getattr(other, name)]) for name in SAMPLED}
        base = joined(self.base, other.base)
        return replace(self, measured=self.measured & other.measured, base=base, **arrays)

    def part(self, begin, end):
        """The Motion of samples `begin` to `end`."""
        arrays = {name: getattr(self, name)[begin:end] for name in SAMPLED}
        base = part_of(self.base, slice(begin, end))
        return replace(self, time=self.time + begin / self.rate, base=base, **arrays)


def motions(stretches, drives, tally, cutoff=None):
    """Yield the Motions of Stretches: joints of drives, what is above the cut-off [Hz] taken away, without delay.
    Stretches may have SIGNALS of a base after those of the motors.

    cutoff: None: `DEFAULT_CUTOFF`, or what the rate allows. Accelerations are derivatives of filtered velocities,
    velocities that were not measured those of positions. Raises RecordingError.
    """
    smoothing = Smoothing(drives, tally, cutoff)
    for stretch in stretches:
        yield from smoothing.take(stretch)
    yield from smoothing.rest()


class Smoothing:
    """What `motions` does, for Stretches that come one by one.

    piece: margins of the filter that are there before it runs, more than 2: the fewer, the sooner Motions come, and the
    more often what lies in the margins is filtered. A sample is told one margin, 6 periods of the cut-off, after it
    came, and what is new of a piece besides: what comes after it, the filter must see.
    """

    def __init__(self, drives, tally, cutoff=None, piece=PIECE):
        self._drives, self._tally, self._cutoff, self._piece = drives, tally, cutoff, piece
        self._pending = None

    def take(self, stretch):
        """Yield the Motions that are ready."""
        if not stretch.continues:
            yield from self.rest()
        if self._pending is None:
            cutoff = cutoff_of(stretch.rate, self._cutoff)
            self._pending = _Pending(stretch, self._drives, cutoff, self._piece)
        yield from self._pending.take(stretch, self._tally)

    def rest(self):
        """Yield what waited for more, which does not come."""
        pending, self._pending = self._pending, None
        if pending is not None:
            yield from pending.rest(self._tally)


class _Pending:
    """Samples of one stretch that wait for those after them, which the filter must see."""

    def __init__(self, stretch, drives, cutoff, piece):
        self.drives, self.rate, self.cutoff, self.piece = drives, stretch.rate, cutoff, piece
        self.margin = margin(stretch.rate, cutoff)
        self.edge = int(np.ceil(EDGE * stretch.rate / self.cutoff))
        self.time, self.skipped = stretch.time, self.edge
        self.signals = np.zeros((3, 0, stretch.position.shape[1]))  # motors, then the base where it was recorded

    def take(self, stretch, tally):
        k = len(self.drives.names)
        for name in np.array(self.drives.names)[~np.isfinite(stretch.velocity[:, :k]).all(axis=0)]:
            tally["velocities that were not measured, and are derivatives of positions"] = str(name)
        for name in np.array(self.drives.names)[~np.isfinite(stretch.effort[:, :k]).all(axis=0)]:
            tally["efforts that were not measured"] = str(name)
        new = np.stack([stretch.position, stretch.velocity, stretch.effort])
        self.signals = np.concatenate([self.signals, new], axis=1)
        if self.signals.shape[1] >= self.piece * self.margin + LEAST:
            yield self._filtered(self.signals.shape[1] - self.margin)
            keep = self.signals.shape[1] - 2 * self.margin
            self.time += keep / self.rate
            self.signals, self.skipped = self.signals[:, keep:], self.margin

    def rest(self, tally):
        size = self.signals.shape[1]
        if size < max(self.margin, LEAST) and self.skipped == self.edge:
            tally.counts["short"] += size
        elif size - self.edge > self.skipped:
            tally.counts["edges"] += 2 * self.edge
            yield self._filtered(size - self.edge)

    def _filtered(self, end):
        """The Motion of the samples from those that were told already to `end`."""
        k = len(self.drives.names)
        position, velocity, effort = self.signals[..., :k]
        lost = ~np.isfinite(velocity).all(axis=0)
        velocity = np.where(lost, differentiated(position, self.rate) if lost.any() else 0, velocity)
        unmeasured = ~np.isfinite(effort).all(axis=0)
        q, qd, efforts = self.drives.at_joints(position, velocity, np.where(unmeasured, 0.0, effort))
        measured = ~(np.abs(self.drives.ratios[unmeasured]) > 0).any(axis=0)
        smooth_q, smooth_qd, smooth = (lowpass(values, self.rate, self.cutoff) for values in (q, qd, efforts))
        qdd = differentiated(smooth_qd, self.rate)
        core, base = slice(self.skipped, end), None
        if self.signals.shape[2] > k:
            base = part_of(base_motion(self.signals[0, :, k:], self.rate, self.cutoff), core)
        return Motion(
            self.time + self.skipped / self.rate, self.rate, self.cutoff, smooth_q[core], smooth_qd[core], qdd[core],
            smooth[core] * measured, efforts[core] * measured, measured, base,
        )  # fmt: skip
