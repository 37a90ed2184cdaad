"""The state of each joint over the latest windows of a stream of motions, and the times out of tolerance."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.checking.comparison import WINDOW, Comparison
from robot_dynamics.checking.verdicts import compute_verdicts, effort_limits, tolerated_rms

if TYPE_CHECKING:
    from robot_dynamics.checking.prediction_filter import PredictedMotion
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.checking.verdicts import FailedSegment, Verdict
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.joint_motions import Motion

HISTORY_WINDOWS = 3600  # windows whose sums are kept for the segments out of tolerance


class FailureTimes(NamedTuple):
    """First and last stamp [ns] of a time out of tolerance."""

    first: int
    last: int


@dataclass(frozen=True)
class JointStatus:
    """The state of a joint.

    Attributes
    ----------
    verdict : on the latest samples.
    failed_since : stamp [ns] since which the joint is out of tolerance; None where it is not.
    last_failure : the previous time out of tolerance; None where there was none.
    """

    verdict: Verdict
    failed_since: int | None
    last_failure: FailureTimes | None

    @property
    def warning(self) -> str:
        """Why a joint within tolerance does not pass: no effort was measured, or its RMS is close to the limit."""
        return "" if self.failed_since is not None else "; ".join(self.verdict.failures)


class StatusTracker:
    """Splits motions and their predicted efforts by windows of one second; each complete window updates the statuses.

    Parameters
    ----------
    dynamics : model of the robot.
    tolerances : see `load_tolerances`.
    span : duration of the latest samples that the statuses refer to [s].

    Attributes
    ----------
    total : sums over all complete windows.
    joint_statuses : state of each joint; empty before the first window is complete.
    latest_motion : last part of a motion in the last complete window; None before the first.
    """

    def __init__(self, dynamics: Dynamics, tolerances: Tolerances, span: float) -> None:
        self.total = Comparison(dynamics.joint_names)
        self.joint_statuses: list[JointStatus] = []
        self.latest_motion: Motion | None = None
        self._dynamics = dynamics
        self._tolerances = tolerances
        self._span = span
        self._span_factor = 1 + (tolerances.window_factor - 1) * np.sqrt(WINDOW / max(span, WINDOW))
        self._window_number = 0
        self._window: list[PredictedMotion] = []  # the window that is not complete yet
        self._recent_windows: deque[list[PredictedMotion]] = deque()  # complete windows in the span
        self._failed_since: dict[str, int] = {}  # by joint
        self._last_failures: dict[str, FailureTimes] = {}  # by joint

    def add(self, part: PredictedMotion, offset: int) -> None:
        """Add a motion and its predicted efforts; offset: added to stamps [ns] to get times."""
        numbers = np.floor(part.motion.times / WINDOW + 1e-9).astype(int)
        cuts = [0, *(np.flatnonzero(np.diff(numbers)) + 1), len(numbers)]
        for begin, end in pairwise(cuts):
            if numbers[begin] != self._window_number:
                self.close_window(offset)
            self._window_number = int(numbers[begin])
            self._window.append(part.slice_samples(begin, end))

    def close_window(self, offset: int) -> None:
        """Add the current window, complete or not, to the sums, and update the statuses."""
        window = self._window
        if not window:
            return
        self._window = []
        for part in window:
            self.total.add(part)
        self.total.drop_windows_before(self._window_number - HISTORY_WINDOWS)
        self.latest_motion = window[-1].motion
        self._recent_windows.append(window)
        span_start = self.latest_motion.end - self._span - 1e-6
        while self._recent_windows[0][0].motion.time < span_start and len(self._recent_windows) > 1:
            self._recent_windows.popleft()
        self._update_statuses(self.latest_motion.end, offset)

    def total_verdicts(self) -> tuple[tuple[Verdict, ...], tuple[FailedSegment, ...]]:
        """Verdicts on all complete windows, and segments of the last `HISTORY_WINDOWS` out of tolerance."""
        return self._verdicts(self.total)

    def _verdicts(self, comparison: Comparison) -> tuple[tuple[Verdict, ...], tuple[FailedSegment, ...]]:
        """Verdicts on a comparison; what is tolerated depends on the efforts of all samples so far."""
        assert self.latest_motion is not None, "a window is complete"
        limits = effort_limits(self._dynamics.robot, self._dynamics.joint_names, self.total.peaks)
        tolerated = tolerated_rms(self.total, limits, self._tolerances)
        return compute_verdicts(comparison, tolerated, self._tolerances, self.latest_motion.rate)

    def _update_statuses(self, end: float, offset: int) -> None:
        """Compute the states of the joints from the windows in the span, which end at a time [s]."""
        recent = Comparison(self._dynamics.joint_names)
        for window in self._recent_windows:
            for part in window:
                recent.add(part)
        verdicts, segments = self._verdicts(recent)
        failed_names = {segment.joint for segment in segments}
        starts, rms = recent.window_rms
        self.joint_statuses = []
        for column, verdict in enumerate(verdicts):
            name = verdict.joint.joint
            is_compared = recent.has_efforts[column] and recent.counts[column] > 0
            exceeds = is_compared and not verdict.joint.rms <= verdict.tolerance * self._span_factor
            if exceeds or name in failed_names:
                first = starts[np.argmax(rms[:, column] > verdict.tolerance)]
                self._failed_since.setdefault(name, round(first * 1e9) - offset)
            elif name in self._failed_since:
                self._last_failures[name] = FailureTimes(self._failed_since.pop(name), round(end * 1e9) - offset)
            self.joint_statuses.append(
                JointStatus(verdict, self._failed_since.get(name), self._last_failures.get(name))
            )
