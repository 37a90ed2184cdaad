"""A check of a running robot: joint samples in as they come, predicted efforts and verdicts out a little later.

The filters without delay use later samples. Predictions therefore follow their samples by the margins of the filters of
motions and of predictions, 6 and 3 periods of the cut-off (1.125 s at 8 Hz), plus the new part of a piece; verdicts
follow when their window is complete.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.check import CheckResult, Predictor
from robot_dynamics.checking.coverage import compute_coverage, coverage_failure, recording_failures
from robot_dynamics.checking.prediction_filter import PredictionFilter
from robot_dynamics.checking.status_tracker import StatusTracker
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.alignment import Resampler
from robot_dynamics.recordings.joint_motions import MotionFilter
from robot_dynamics.recordings.odometry import BASE_SIGNALS
from robot_dynamics.recordings.recorded_duration import RecordedDuration
from robot_dynamics.recordings.sample_statistics import SampleStatistics

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.checking.prediction_filter import PredictedMotion
    from robot_dynamics.checking.status_tracker import JointStatus
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.alignment import SignalSegment
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.joint_samples import JointSample

DEFAULT_SPAN = 5.0  # [s] of the latest samples that verdicts refer to
PIECE_MARGINS = 2.4  # length of a piece in margins of the filter: 0.3 s of it are new at 8 Hz
WARM_UP_DURATION = 1.0  # [s] of stamps that are needed to measure the rate
MAX_WAITING_TIME = 5.0  # [s] that messages wait for windows and filters; later ones were skipped
MAX_PENDING_ROWS = 20_000  # rows that wait for joints without messages
MAX_MESSAGE_LAYOUTS = 1000  # kinds of messages whose last arrival is kept


@dataclass(frozen=True, eq=False)
class EffortPrediction:
    """Predicted efforts of a motion.

    Attributes
    ----------
    stamps : (N,) [ns] stamps of the samples, as in their messages.
    motion : of N samples.
    predicted : (N, n) efforts of the model [N m or N].
    filtered : (N, n) the same through the filter of the measured efforts.
    """

    stamps: IntArray
    motion: Motion
    predicted: Array
    filtered: Array

    @property
    def residuals(self) -> Array:
        """(N, n) measured less predicted efforts, both filtered; nan where no effort was measured."""
        return np.where(self.motion.has_efforts, self.motion.efforts - self.filtered, np.nan)


class LiveCheck:
    """The check of `check`, for the latest `span` seconds of samples that come one by one.

    Residuals of a robot without fault vary: those of one window may be `window_factor` times larger than those of a
    whole recording. A joint is out of tolerance where the RMS over n windows exceeds the tolerance by the factor
    1 + (window_factor - 1) / √n, or that of one window exceeds it by `window_factor`.

    Parameters
    ----------
    dynamics : model of the robot.
    drives : conversion from signals to joints.
    tolerances : see `load_tolerances`.
    cutoff : cut-off frequency of the low-pass filter [Hz]; None: 8, or a fifth of the rate.
    rate : samples per second of the grid; None: as the samples come.
    span : duration of the samples that verdicts refer to [s].

    Attributes
    ----------
    statistics : counts of the samples that were skipped.
    error_message : why the samples before the last `finish` could not be used; empty where they could.

    Notes
    -----
    Where the base of the robot moves, samples of `BASE_SIGNALS` are needed too.
    """

    def __init__(
        self,
        dynamics: Dynamics,
        drives: Drives,
        tolerances: Tolerances,
        *,
        cutoff: float | None = None,
        rate: float | None = None,
        span: float = DEFAULT_SPAN,
    ) -> None:
        self.dynamics = dynamics
        self.drives = drives
        self.statistics = SampleStatistics()
        self.error_message = ""
        self._tracker = StatusTracker(dynamics, tolerances, span)
        self._predictor = Predictor(dynamics, drives)
        base_signals = BASE_SIGNALS if dynamics.robot.moving_base else ()
        self._resampler = Resampler(drives.names + base_signals, self.statistics, rate)
        self._filter = MotionFilter(drives, self.statistics, cutoff, PIECE_MARGINS)
        self._prediction_filter = PredictionFilter()
        self._tolerances = tolerances
        self._recorded = RecordedDuration()
        self._first_stamp: int | None = None
        self._is_warm = False  # whether stamps cover the warm-up
        self._arrivals: dict[tuple[str, ...], int] = {}  # receive time [ns] of the last message with these names

    @property
    def joint_statuses(self) -> list[JointStatus]:
        """State of each joint; empty before the first window is complete."""
        return self._tracker.joint_statuses

    @property
    def latest_motion(self) -> Motion | None:
        """Last part of a motion in the last complete window; None before the first."""
        return self._tracker.latest_motion

    def feed(self, sample: JointSample) -> list[EffortPrediction]:
        """Add a joint sample, whose `receive_time` is the time of its arrival.

        Returns
        -------
        list of EffortPrediction
            The predictions that a clock jump completes.

        Raises
        ------
        RecordingError
            Where the sample cannot be used.
        """
        self._note_arrival(sample)
        self._recorded.feed(sample)
        offset = self._resampler.offset
        try:
            self._resampler.feed(sample)
        finally:
            segments = self._resampler.finished
            self._resampler.finished = []
            predictions = []
            if offset is not None and self._resampler.offset != offset:
                predictions = [*self._predict_segments(segments, offset), *self._flush_filter(offset)]
        return predictions

    def _note_arrival(self, sample: JointSample) -> None:
        if len(self._arrivals) >= MAX_MESSAGE_LAYOUTS:
            self._arrivals.clear()
        if len(sample.position) == len(sample.names):
            self._arrivals[sample.names] = sample.receive_time
        stamp = sample.stamp or sample.receive_time
        if self._first_stamp is None or stamp < self._first_stamp:
            self._first_stamp = stamp
        self._is_warm = stamp - self._first_stamp > WARM_UP_DURATION * 1e9

    def find_stale_names(self, now: int, timeout: float) -> list[str]:
        """Names of the signals without message in the last `timeout` [s]; now: [ns], on the clock of `receive_time`."""
        fresh = {name for names, arrival in self._arrivals.items() if now - arrival < timeout * 1e9 for name in names}
        stale = [name for name in self.drives.names if name not in fresh]
        if self.dynamics.robot.moving_base and BASE_SIGNALS[0] not in fresh:
            stale.append("the base")
        return stale

    def advance(self) -> list[EffortPrediction]:
        """The predictions that are complete by now. Raises RecordingError."""
        if self._resampler.pending_rows > MAX_PENDING_ROWS:
            return self.finish()
        if self._resampler.step is None and not self._is_warm:
            return []
        return self._predict_segments(self._resampler.drain(), self._resampler.offset)

    def finish(self) -> list[EffortPrediction]:
        """The predictions of all samples so far; later samples begin anew.

        `error_message` says why samples could not be used.
        """
        segments: list[SignalSegment] = []
        self.error_message = ""
        try:
            if self._resampler.pending_rows:
                segments = self._resampler.drain(final=True)
        except RecordingError as error:
            self.error_message = str(error)
        offset = self._resampler.offset
        predictions = [*self._predict_segments(segments, offset), *self._flush_filter(offset)]
        if offset is not None:
            self._tracker.close_window(offset)
        return predictions

    @property
    def rate(self) -> float | None:
        """Samples per second of the grid; None before it is known."""
        return None if self._resampler.step is None else 1 / self._resampler.step

    def result(self) -> CheckResult:
        """The check of all complete windows since the beginning; segments are those of the last `HISTORY_WINDOWS`.

        Raises RecordingError where there are none.
        """
        latest_motion = self._tracker.latest_motion
        if latest_motion is None:
            reason = "; ".join(self.statistics.sentences) or "no message names the joints"
            raise RecordingError(f"nothing was compared yet: {reason}")
        verdicts, segments = self._tracker.total_verdicts()
        coverage = self.coverage
        return CheckResult(
            recording="joint states",
            robot=self.dynamics.robot.name,
            joints=tuple(
                self.dynamics.robot.joints[self.dynamics.robot.joint_numbers[name]]
                for name in self.dynamics.joint_names
            ),
            rate=latest_motion.rate,
            cutoff=latest_motion.cutoff,
            duration=latest_motion.end,
            coverage=coverage,
            verdicts=verdicts,
            failures=tuple(recording_failures(coverage, verdicts, self._tolerances)),
            segments=segments,
            notes=tuple(self.statistics.sentences),
            comparison=self._tracker.total,
        )

    @property
    def coverage(self) -> float:
        """Part of the time of the messages, 0 to 1, that is compared, without messages that wait in the filters."""
        motion = self._tracker.latest_motion
        offset = self._resampler.offset
        if motion is None or offset is None or self._recorded.latest_stamp is None:
            return 1.0
        waiting = (self._recorded.latest_stamp + offset) / 1e9 - motion.end
        waiting = min(max(0.0, waiting), MAX_WAITING_TIME)
        return compute_coverage(self._tracker.total.samples / motion.rate, self._recorded.seconds - waiting)

    @property
    def coverage_failure(self) -> str:
        """Why the coverage is no pass; empty where it is."""
        if self._recorded.seconds < MAX_WAITING_TIME:
            return ""
        return coverage_failure(self.coverage, self._tolerances)

    def _flush_filter(self, offset: int | None) -> list[EffortPrediction]:
        """The predictions of samples that wait in the filters for later ones."""
        predictions = self._predict_motions(self._filter.flush(), offset)
        return predictions + [self._compare(part, offset) for part in self._prediction_filter.flush()]

    def _predict_segments(self, segments: Iterable[SignalSegment], offset: int | None) -> list[EffortPrediction]:
        motions = (motion for segment in segments for motion in self._filter.feed(segment))
        return self._predict_motions(motions, offset)

    def _predict_motions(self, motions: Iterable[Motion], offset: int | None) -> list[EffortPrediction]:
        return [self._compare(part, offset) for motion in motions for part in self._predict(motion)]

    def _predict(self, motion: Motion) -> Iterator[PredictedMotion]:
        """Yield the predictions that are complete with a motion; a motion of too large numbers is skipped."""
        with np.errstate(all="ignore"):
            predicted = self._predictor(motion)
            # squares, as comparisons sum them
            is_bounded = np.isfinite(predicted * predicted).all() and np.isfinite(motion.efforts * motion.efforts).all()
        if is_bounded:
            yield from self._prediction_filter.feed(motion, predicted)
        else:
            self.statistics.counts["unbounded"] += len(motion)

    def _compare(self, part: PredictedMotion, offset: int | None) -> EffortPrediction:
        """Add a filtered prediction to the comparisons; offset: added to stamps [ns] to get times."""
        assert offset is not None, "a motion follows from samples, which set the offset"
        self._tracker.add(part, offset)
        stamps = np.round(part.motion.times * 1e9).astype(np.int64) - offset
        return EffortPrediction(stamps, part.motion, part.predicted, part.filtered)
