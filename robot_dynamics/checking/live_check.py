"""A check that goes on: joint samples in as they come, predicted efforts and verdicts out a little later.

Filtering without delay needs what comes after a sample, so that all is told later than it was measured: by the margin
of the filter, 6 periods of the cut-off (0.75 s at 8 Hz), and what is new of a piece; a verdict when its second is over.
"""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from robot_dynamics.checking.check import CheckResult, Predictor, compute_verdicts, effort_limits
from robot_dynamics.checking.comparison import WINDOW, Comparison
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.alignment import Resampler
from robot_dynamics.recordings.joint_motions import Motion, MotionFilter
from robot_dynamics.recordings.odometry import BASE_SIGNALS
from robot_dynamics.recordings.sample_statistics import SampleStatistics

DEFAULT_SPAN = 5.0  # [s] that verdicts are about
PIECE_MARGINS = 2.4  # margins of the filter in a piece: 0.3 s of it are new at 8 Hz
WARM_UP_DURATION = 1.0  # [s] of stamps after which the rate is told from them
MAX_PENDING_ROWS = 20_000  # rows that wait for joints that nobody tells of
MAX_MESSAGE_LAYOUTS = 1000  # sorts of messages whose last arrival is remembered
HISTORY_WINDOWS = 3600  # windows, of a second each, whose verdicts are kept for `found`


@dataclass(frozen=True, eq=False)
class EffortPrediction:
    """stamps (N,) [ns] of the samples of a Motion, as their messages have them, and predicted efforts (N, n)."""

    stamps: np.ndarray
    motion: Motion
    predicted: np.ndarray

    @property
    def residuals(self):
        """(N, n) measured less predicted, nan where no effort was measured."""
        return np.where(self.motion.has_efforts, self.motion.efforts - self.predicted, np.nan)


@dataclass(frozen=True)
class JointStatus:
    """How a joint stands: its Verdict of the last seconds; since: the stamp [ns] since when it is out of tolerance,
    None where it is not; past: the stamps (first, last) between which it was out of tolerance the last time before."""

    verdict: object
    failed_since: int | None
    last_failure: tuple | None

    @property
    def warning(self):
        """Why the joint does not pass, though it is not out of tolerance: nothing was measured, or it is near to it."""
        return "" if self.failed_since is not None or self.verdict.passed else "; ".join(self.verdict.failures)


class LiveCheck:
    """What `check` says of a whole recording, said of the last `span` seconds of what is fed, when a second is over.

    Residuals of sound robots are not the same all the time: those of the last seconds may be larger than those of a
    whole recording, as those of one second may be `window_factor` times. So may those of n seconds 1 + (window_factor -
    1) / √n times; the joint is out of tolerance beyond this only.

    cutoff [Hz], rate [1/s]: as for `motions` and `Assembly`. Where the base of the robot moves, samples with SIGNALS
    of it are needed too.
    """

    def __init__(self, dynamics, drives, tolerances, *, cutoff=None, rate=None, span=DEFAULT_SPAN):
        self._predictor, self._tolerances, self._span = Predictor(dynamics, drives), tolerances, span
        self.dynamics, self.drives, self.statistics = dynamics, drives, SampleStatistics()
        of_base = BASE_SIGNALS if dynamics.robot.moving_base else ()
        self._assembly = Resampler(drives.names + of_base, self.statistics, rate)
        self._smoothing = MotionFilter(drives, self.statistics, cutoff, PIECE_MARGINS)
        self._factor = 1 + (tolerances.window_factor - 1) * np.sqrt(WINDOW / max(span, WINDOW))
        self._first_stamp, self._arrivals, self._warm = None, {}, False
        self._number, self._window, self._recent = (
            0,
            [],
            deque(),
        )  # Pieces of the second that goes on; those of seconds before, lists
        self._total, self.latest_motion = Comparison(dynamics.joint_names), None
        self._since, self._past = {}, {}
        self.joint_statuses, self.error_message = [], ""

    def feed(self, sample):
        """Take a JointSample, which came at `recorded`. Returns the Pieces that a jump of the clock ends.

        Raises RecordingError where it cannot be used.
        """
        if len(self._arrivals) >= MAX_MESSAGE_LAYOUTS:
            self._arrivals.clear()
        if len(sample.position) == len(sample.names):
            self._arrivals[sample.names] = sample.receive_time
        stamp = sample.stamp or sample.receive_time
        if self._first_stamp is None or stamp < self._first_stamp:
            self._first_stamp = stamp
        self._warm = stamp - self._first_stamp > WARM_UP_DURATION * 1e9
        before = self._assembly.offset
        try:
            self._assembly.feed(sample)
        finally:
            ended, self._assembly.finished = self._assembly.finished, []
            jumped = before is not None and self._assembly.offset != before
            pieces = [*self._pieces(ended, before), *self._rest(before)] if jumped else []
        return pieces

    def find_stale_names(self, now, timeout):
        """Names of what nobody told of in the last `patience` seconds; now: [ns], on the clock of `recorded`."""
        told = {name for names, arrival in self._arrivals.items() if now - arrival < timeout * 1e9 for name in names}
        base = ["the base"] if self.dynamics.robot.moving_base and BASE_SIGNALS[0] not in told else []
        return [name for name in self.drives.names if name not in told] + base

    def advance(self):
        """The Pieces that can be told by now. Raises RecordingError."""
        if self._assembly.pending_rows > MAX_PENDING_ROWS:
            return self.finish()
        if self._assembly.step is None and not self._warm:
            return []
        return self._pieces(self._assembly.drain(), self._assembly.offset)

    def finish(self):
        """The Pieces of all that was fed: nothing more comes, for now. `trouble` says what could not be used."""
        signal_segments, self.error_message = [], ""
        try:
            signal_segments = self._assembly.drain(final=True) if self._assembly.pending_rows else []
        except RecordingError as error:
            self.error_message = str(error)
        offset = self._assembly.offset
        pieces = [*self._pieces(signal_segments, offset), *self._rest(offset)]
        if self._window:
            self._close(offset)
        return pieces

    @property
    def rate(self):
        """[1/s] of the grid, None where it is not known yet."""
        return None if self._assembly.step is None else 1 / self._assembly.step

    def result(self):
        """The Check of all seconds that are over, since the beginning. Raises RecordingError where there are none."""
        if self.latest_motion is None:
            told = "; ".join(self.statistics.sentences)
            raise RecordingError(f"nothing was compared yet: {told or 'no message tells of the joints'}")
        verdicts, segments = compute_verdicts(self._total, self._limits(), self._tolerances)
        return CheckResult("joint states", self.dynamics.robot.name, self.latest_motion.rate, self.latest_motion.cutoff, self.latest_motion.end,
                     verdicts, segments, tuple(self.statistics.sentences), self._total)  # fmt: skip

    def _limits(self):
        return effort_limits(self.dynamics.robot, self.dynamics.joint_names, self._total.peaks)

    def _rest(self, offset):
        pieces = [self._piece(motion, offset) for motion in self._smoothing.flush()]
        return [piece for piece in pieces if piece is not None]

    def _pieces(self, signal_segments, offset):
        pieces = [
            self._piece(motion, offset) for stretch in signal_segments for motion in self._smoothing.feed(stretch)
        ]
        return [piece for piece in pieces if piece is not None]

    def _piece(self, motion, offset):
        """The Piece of a Motion, counted; None where its numbers are beyond all bounds."""
        with np.errstate(all="ignore"):
            predicted = self._predictor(motion)
            bounded = np.isfinite(predicted * predicted).all() and np.isfinite(motion.efforts * motion.efforts).all()
        if not bounded:
            self.statistics.counts["unbounded"] += len(motion)
            return None
        piece = EffortPrediction(np.round(motion.times * 1e9).astype(np.int64) - offset, motion, predicted)
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
            self._window.append((piece.motion.slice_samples(begin, end), piece.predicted[begin:end]))

    def _close(self, offset):
        window, self._window = self._window, []
        for part in window:
            self._total.add(*part)
        for number in [number for number in self._total.windows if number < self._number - HISTORY_WINDOWS]:
            del self._total.windows[number]
        self.latest_motion = window[-1][0]
        self._recent.append(window)
        while self._recent[0][0][0].time < self.latest_motion.end - self._span - 1e-6 and len(self._recent) > 1:
            self._recent.popleft()
        self._judge(offset)

    def _judge(self, offset):
        recent = Comparison(self.dynamics.joint_names)
        for window in self._recent:
            for part in window:
                recent.add(*part)
        verdicts, segments = compute_verdicts(recent, self._limits(), self._tolerances)
        starts, rms = recent.window_rms
        self.joint_statuses = []
        for column, verdict in enumerate(verdicts):
            name = verdict.joint.joint
            failed = recent.has_efforts[column] and not verdict.joint.rms <= verdict.tolerance * self._factor
            if failed or any(segment.joint == name for segment in segments):
                first = starts[np.argmax(rms[:, column] > verdict.tolerance)]
                self._since.setdefault(name, round(first * 1e9) - offset)
            elif name in self._since:
                self._past[name] = self._since.pop(name), round(self.latest_motion.end * 1e9) - offset
            self.joint_statuses.append(JointStatus(verdict, self._since.get(name), self._past.get(name)))
