"""A check that goes on: joint samples in as they come, predicted efforts and verdicts out a little later.

Filtering without delay needs what comes after a sample, so that all is told later than it was measured: by the margin
of the filter, 6 periods of the cut-off (0.75 s at 8 Hz), and what is new of a piece; a verdict when its second is over.
"""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robot_dynamics.errors import RecordingError
from robot_dynamics.replay.alignment import Assembly
from robot_dynamics.replay.base_motion import SIGNALS
from robot_dynamics.replay.checking import Check, Predictor, effort_limits, judged
from robot_dynamics.replay.comparison import WINDOW, Comparison
from robot_dynamics.replay.motions import Motion, Smoothing
from robot_dynamics.replay.tally import Tally

SPAN = 5.0  # [s] that verdicts are about
PIECE = 2.4  # margins of the filter in a piece: 0.3 s of it are new at 8 Hz
WARM = 1.0  # [s] of stamps after which the rate is told from them
MOST_HELD = 20_000  # rows that wait for joints that nobody tells of
MOST_KNOWN = 1000  # sorts of messages whose last arrival is remembered
HISTORY = 3600  # windows, of a second each, whose verdicts are kept for `found`


@dataclass(frozen=True, eq=False)
class Piece:
    """stamps (N,) [ns] of the samples of a Motion, as their messages have them, and predicted efforts (N, n)."""

    stamps: np.ndarray
    motion: Motion
    predicted: np.ndarray

    @property
    def residuals(self):
        """(N, n) measured less predicted, nan where no effort was measured."""
        return np.where(self.motion.measured, self.motion.efforts - self.predicted, np.nan)


@dataclass(frozen=True)
class Standing:
    """How a joint stands: its Verdict of the last seconds; since: the stamp [ns] since when it is out of tolerance,
    None where it is not; past: the stamps (first, last) between which it was out of tolerance the last time before."""

    verdict: object
    since: int | None
    past: tuple | None

    @property
    def doubts(self):
        """Why the joint does not pass, though it is not out of tolerance: nothing was measured, or it is near to it."""
        return "" if self.since is not None or self.verdict.passed else "; ".join(self.verdict.objections)


class LiveCheck:
    """What `check` says of a whole recording, said of the last `span` seconds of what is fed, when a second is over.

    Residuals of sound robots are not the same all the time: those of the last seconds may be larger than those of a
    whole recording, as those of one second may be `window_factor` times. So may those of n seconds 1 + (window_factor -
    1) / √n times; the joint is out of tolerance beyond this only.

    cutoff [Hz], rate [1/s]: as for `motions` and `Assembly`. Where the base of the robot moves, samples with SIGNALS
    of it are needed too.
    """

    def __init__(self, dynamics, drives, tolerances, *, cutoff=None, rate=None, span=SPAN):
        self._predictor, self._tolerances, self._span = Predictor(dynamics, drives), tolerances, span
        self.dynamics, self.drives, self.tally = dynamics, drives, Tally()
        of_base = SIGNALS if dynamics.robot.moving_base else ()
        self._assembly = Assembly(drives.names + of_base, self.tally, rate)
        self._smoothing = Smoothing(drives, self.tally, cutoff, PIECE)
        self._factor = 1 + (tolerances.window_factor - 1) * np.sqrt(WINDOW / max(span, WINDOW))
        self._first_stamp, self._arrivals, self._warm = None, {}, False
        self._number, self._window, self._recent = (
            0,
            [],
            deque(),
        )  # Pieces of the second that goes on; those of seconds before, lists
        self._total, self.latest = Comparison(dynamics.joint_names), None
        self._since, self._past = {}, {}
        self.standings, self.trouble = [], ""

    def feed(self, sample):
        """Take a JointSample, which came at `recorded`. Returns the Pieces that a jump of the clock ends.

        Raises RecordingError where it cannot be used.
        """
        if len(self._arrivals) >= MOST_KNOWN:
            self._arrivals.clear()
        if len(sample.position) == len(sample.names):
            self._arrivals[sample.names] = sample.recorded
        stamp = sample.stamp or sample.recorded
        if self._first_stamp is None or stamp < self._first_stamp:
            self._first_stamp = stamp
        self._warm = stamp - self._first_stamp > WARM * 1e9
        before = self._assembly.offset
        try:
            self._assembly.feed(sample)
        finally:
            ended, self._assembly.finished = self._assembly.finished, []
            jumped = before is not None and self._assembly.offset != before
            pieces = [*self._pieces(ended, before), *self._rest(before)] if jumped else []
        return pieces

    def silent(self, now, patience):
        """Names of what nobody told of in the last `patience` seconds; now: [ns], on the clock of `recorded`."""
        told = {name for names, arrival in self._arrivals.items() if now - arrival < patience * 1e9 for name in names}
        base = ["the base"] if self.dynamics.robot.moving_base and SIGNALS[0] not in told else []
        return [name for name in self.drives.names if name not in told] + base

    def advance(self):
        """The Pieces that can be told by now. Raises RecordingError."""
        if self._assembly.held > MOST_HELD:
            return self.finish()
        if self._assembly.step is None and not self._warm:
            return []
        return self._pieces(self._assembly.drain(), self._assembly.offset)

    def finish(self):
        """The Pieces of all that was fed: nothing more comes, for now. `trouble` says what could not be used."""
        stretches, self.trouble = [], ""
        try:
            stretches = self._assembly.drain(final=True) if self._assembly.held else []
        except RecordingError as error:
            self.trouble = str(error)
        offset = self._assembly.offset
        pieces = [*self._pieces(stretches, offset), *self._rest(offset)]
        if self._window:
            self._close(offset)
        return pieces

    @property
    def rate(self):
        """[1/s] of the grid, None where it is not known yet."""
        return None if self._assembly.step is None else 1 / self._assembly.step

    def found(self):
        """The Check of all seconds that are over, since the beginning. Raises RecordingError where there are none."""
        if self.latest is None:
            told = "; ".join(self.tally.sentences)
            raise RecordingError(f"nothing was compared yet: {told or 'no message tells of the joints'}")
        verdicts, segments = judged(self._total, self._limits(), self._tolerances)
        return Check("joint states", self.dynamics.robot.name, self.latest.rate, self.latest.cutoff, self.latest.end,
                     verdicts, segments, tuple(self.tally.sentences), self._total)  # fmt: skip

    def _limits(self):
        return effort_limits(self.dynamics.robot, self.dynamics.joint_names, self._total.peaks)

    def _rest(self, offset):
        pieces = [self._piece(motion, offset) for motion in self._smoothing.rest()]
        return [piece for piece in pieces if piece is not None]

    def _pieces(self, stretches, offset):
        pieces = [self._piece(motion, offset) for stretch in stretches for motion in self._smoothing.take(stretch)]
        return [piece for piece in pieces if piece is not None]

    def _piece(self, motion, offset):
        """The Piece of a Motion, counted; None where its numbers are beyond all bounds."""
        with np.errstate(all="ignore"):
            predicted = self._predictor(motion)
            bounded = np.isfinite(predicted * predicted).all() and np.isfinite(motion.efforts * motion.efforts).all()
        if not bounded:
            self.tally.counts["unbounded"] += len(motion)
            return None
        piece = Piece(np.round(motion.times * 1e9).astype(np.int64) - offset, motion, predicted)
        self._count(piece, offset)
        return piece

    def _count(self, piece, offset):
        """Put a Piece to the seconds that it is of; each that is over is judged."""
        numbers = np.floor(piece.motion.times / WINDOW + 1e-9).astype(int)
        cuts = [0, *(np.flatnonzero(np.diff(numbers)) + 1), len(numbers)]
        for begin, end in pairwise(cuts):
            if self._window and numbers[begin] != self._number:
                self._close(offset)
            self._number = numbers[begin]
            self._window.append((piece.motion.part(begin, end), piece.predicted[begin:end]))

    def _close(self, offset):
        window, self._window = self._window, []
        for part in window:
            self._total.add(*part)
        for number in [number for number in self._total.windows if number < self._number - HISTORY]:
            del self._total.windows[number]
        self.latest = window[-1][0]
        self._recent.append(window)
        while self._recent[0][0][0].time < self.latest.end - self._span - 1e-6 and len(self._recent) > 1:
            self._recent.popleft()
        self._judge(offset)

    def _judge(self, offset):
        recent = Comparison(self.dynamics.joint_names)
        for window in self._recent:
            for part in window:
                recent.add(*part)
        verdicts, segments = judged(recent, self._limits(), self._tolerances)
        starts, rms = recent.window_rms
        self.standings = []
        for column, verdict in enumerate(verdicts):
            name = verdict.joint.joint
            failed = recent.measured[column] and not verdict.joint.rms <= verdict.tolerated * self._factor
            if failed or any(segment.joint == name for segment in segments):
                first = starts[np.argmax(rms[:, column] > verdict.tolerated)]
                self._since.setdefault(name, round(first * 1e9) - offset)
            elif name in self._since:
                self._past[name] = self._since.pop(name), round(self.latest.end * 1e9) - offset
            self.standings.append(Standing(verdict, self._since.get(name), self._past.get(name)))
