"""A recording against the model of a robot: measured efforts against those that `Dynamics` predicts, with a verdict for
each joint and the times that are out of tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.checking.comparison import Comparison
from robot_dynamics.checking.coverage import NOTHING_JUDGED, compute_coverage, recording_failures
from robot_dynamics.checking.prediction_filter import PredictionFilter
from robot_dynamics.checking.verdicts import compute_verdicts, effort_limits, tolerated_rms, undetermined_scale
from robot_dynamics.errors import RecordingError
from robot_dynamics.notebook_display import notebook_html
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.position_limits import note_limit_violations
from robot_dynamics.recordings.sample_statistics import SampleStatistics

if TYPE_CHECKING:
    from robot_dynamics.checking.prediction_filter import PredictedMotion
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.checking.verdicts import FailedSegment, Verdict
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.recording import ProgressWrapper, Recording

PieceCallback: TypeAlias = Callable[[Motion, Array, int], object]
"""Called with a motion, its predicted efforts (N, n), not filtered, and the stamp [ns] of time 0."""


@dataclass(frozen=True, eq=False)
class CheckResult:
    """The result of a check.

    Attributes
    ----------
    recording, robot : names.
    rate : samples per second.
    cutoff : cut-off frequency of the filter [Hz].
    duration : time of the end of the last motion [s].
    coverage : part of the recorded time, 0 to 1, that is compared; pauses between messages of more than a second are
        not recorded time.
    verdicts : one for each joint, in the order of the model.
    failures : sentences on the reasons why the recording fails, beside those of the joints.
    segments : times out of tolerance.
    notes : sentences on samples that were skipped or replaced.
    comparison : sums over the samples, and some samples for figures.
    joints : the joints of the verdicts, which have their limits; empty where they are not known.
    """

    _repr_html_ = notebook_html

    recording: str
    robot: str
    rate: float
    cutoff: float
    duration: float
    coverage: float
    verdicts: tuple[Verdict, ...]
    failures: tuple[str, ...]
    segments: tuple[FailedSegment, ...]
    notes: tuple[str, ...]
    comparison: Comparison
    joints: tuple[Joint, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether no joint fails, at least one is judged, and enough of the recording was compared."""
        return not self.failures and not any(verdict.failed for verdict in self.verdicts)

    @property
    def passed_or_not_judged(self) -> bool | None:
        """As `passed`; None where nothing fails, but no joint can be judged: a robot that rests throughout."""
        return None if self.failures == (NOTHING_JUDGED,) else self.passed

    @property
    def not_judged(self) -> tuple[str, ...]:
        """Names of the joints that are not judged."""
        return tuple(verdict.joint.joint for verdict in self.verdicts if verdict.not_judged)

    @property
    def first_failure_time(self) -> float | None:
        """Beginning [s] of the first segment out of tolerance; None where there is none."""
        return min((segment.start for segment in self.segments), default=None)

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON; None where a number is not finite."""
        return {
            "format": 1,
            "recording": self.recording,
            "robot": self.robot,
            "passed": self.passed_or_not_judged,
            "rate": self.rate,
            "cutoff": self.cutoff,
            "duration": self.duration,
            "coverage": self.coverage,
            "objections": list(self.failures),
            "joints": [_verdict_dict(verdict) for verdict in self.verdicts],
            "since": self.first_failure_time,
            "segments": [asdict(segment) for segment in self.segments],
            "notes": list(self.notes),
        }


def _verdict_dict(verdict: Verdict) -> dict[str, object]:
    values = {
        **asdict(verdict.joint),
        "tolerated": verdict.tolerance,
        "verdict": verdict.word.lower(),
        "passed": None if verdict.not_judged else verdict.passed,
        "objections": list(verdict.reasons),
    }
    return {
        key: None if isinstance(value, float) and not np.isfinite(value) else value for key, value in values.items()
    }


class Predictor:
    """Predicts the efforts of a robot and its drives for motions; without gravity where drives do not measure it."""

    def __init__(self, dynamics: Dynamics, drives: Drives) -> None:
        self.dynamics = dynamics
        self.drives = drives
        # compiled here, so that the first pieces do not run interpreted
        dynamics.compile("inverse", prescribed_base=dynamics.robot.moving_base)

    def __call__(self, motion: Motion) -> Array:
        """Predicted efforts (N, n)."""
        return self.efforts(self.dynamics, motion)

    def efforts(self, dynamics: Dynamics, motion: Motion) -> Array:
        """Predicted efforts (N, n) of another Dynamics with the same joints."""
        efforts: Array = dynamics.inverse(motion.q, motion.qd, motion.qdd, base=motion.base)
        efforts = efforts + self.drives.drive_efforts(motion.qd, motion.qdd)
        if not self.drives.excludes_gravity:
            return efforts
        gravity: Array = dynamics.gravity(motion.q, base=motion.base)
        return efforts - gravity[..., -efforts.shape[-1] :]


def check(
    recording: Recording,
    dynamics: Dynamics,
    tolerances: Tolerances,
    *,
    cutoff: float | None = None,
    rate: float | None = None,
    progress: ProgressWrapper | None = None,
    on_piece: PieceCallback | None = None,
) -> CheckResult:
    """Check a recording against the model of a robot.

    Parameters
    ----------
    recording : the recording; see `open_recording`.
    dynamics : model of the robot.
    tolerances : see `load_tolerances`.
    cutoff : cut-off frequency of the low-pass filter [Hz]; None: 8, or a fifth of the rate.
    rate : samples per second of the grid; None: as recorded.
    progress : wraps the iterator over messages, to show progress.
    on_piece : called with each piece of motion, its predicted efforts (N, n), not filtered, and the stamp of time 0
        [ns].

    Returns
    -------
    CheckResult

    Raises
    ------
    RecordingError
        Where the recording cannot be read, or has no efforts that vary.
    InvalidInputError
        Where the recording does not fit the robot.
    """
    sums = compare(recording, dynamics, cutoff=cutoff, rate=rate, progress=progress, on_piece=on_piece)
    return judge(recording.name, dynamics, tolerances, sums)


@dataclass(eq=False)
class CheckSums:
    """What a check keeps of a recording, or of a part of it.

    Attributes
    ----------
    comparison : sums over the samples.
    statistics : counts of skipped samples.
    notes : sentences on damage of the files.
    rate : samples per second; 0: no motion.
    cutoff : cut-off frequency of the filter [Hz].
    end : time of the end of the last motion [s].
    """

    comparison: Comparison
    statistics: SampleStatistics
    notes: tuple[str, ...] = ()
    rate: float = 0.0
    cutoff: float = 0.0
    end: float = 0.0

    def append(self, later: CheckSums) -> None:
        """Add the sums of a later part of the same recording."""
        self.comparison.append(later.comparison)
        self.statistics.append(later.statistics)
        self.notes = tuple(dict.fromkeys([*self.notes, *later.notes]))
        if later.rate:
            self.rate, self.cutoff, self.end = later.rate, later.cutoff, later.end


def compare(
    recording: Recording,
    dynamics: Dynamics,
    *,
    cutoff: float | None = None,
    rate: float | None = None,
    progress: ProgressWrapper | None = None,
    on_piece: PieceCallback | None = None,
) -> CheckSums:
    """Sum measured against predicted efforts over a recording, or a part of it. Arguments and errors as for `check`."""
    predictor = Predictor(dynamics, recording.drives)
    sums = CheckSums(Comparison(dynamics.joint_names), SampleStatistics())
    prediction_filter = PredictionFilter()
    start, stop = recording.time_range

    def add(parts: Iterable[PredictedMotion]) -> None:
        for part in parts:
            first, last = np.searchsorted(part.motion.times, [start, stop])
            if last > first:
                sums.comparison.add(part.slice_samples(first, last))

    for motion in recording.motions(sums.statistics, cutoff=cutoff, rate=rate, progress=progress):
        predicted = predictor(motion)
        add(prediction_filter.feed(motion, predicted))
        first, last = np.searchsorted(motion.times, [start, stop])
        if last > first:
            own = motion.slice_samples(first, last)
            note_limit_violations(dynamics, own, sums.statistics)
            if on_piece is not None:
                on_piece(own, predicted[first:last], sums.statistics.origin)
            sums.rate, sums.cutoff, sums.end = own.rate, own.cutoff, own.end
    add(prediction_filter.flush())
    sums.notes = recording.notes
    return sums


def judge(recording: str, dynamics: Dynamics, tolerances: Tolerances, sums: CheckSums) -> CheckResult:
    """Return the result of a check from the name of a recording and the sums over it. Errors as for `check`."""
    comparison, statistics = sums.comparison, sums.statistics
    if not comparison.samples:
        reason = "; ".join([*sums.notes, *statistics.sentences]) or "It has no motion"
        raise RecordingError(f"{recording}: no samples are left. {reason}")
    if not comparison.has_efforts.any():
        notes = "".join(f"; {note}" for note in sums.notes)
        raise RecordingError(f"{recording}: no efforts are recorded: nothing was measured{notes}")
    limits = effort_limits(dynamics.robot, dynamics.joint_names, comparison.peaks)
    tolerated = tolerated_rms(comparison, limits, tolerances)
    verdicts, segments = compute_verdicts(comparison, tolerated, tolerances, sums.rate)
    moving = [verdict.joint for verdict in verdicts if verdict.joint.samples]
    if moving and all(joint.spread == 0 for joint in moving):
        raise RecordingError(f"{recording}: efforts are constant throughout: nothing was measured")
    coverage = compute_coverage(comparison.samples / sums.rate, statistics.recorded_duration)
    return CheckResult(
        recording=recording,
        robot=dynamics.robot.name,
        joints=checked_joints(dynamics),
        rate=sums.rate,
        cutoff=sums.cutoff,
        duration=sums.end,
        coverage=coverage,
        verdicts=verdicts,
        failures=tuple(recording_failures(coverage, verdicts, tolerances)),
        segments=segments,
        notes=(*sums.notes, *statistics.sentences, *undetermined_scale(verdicts, tolerances)),
        comparison=comparison,
    )


def checked_joints(dynamics: Dynamics) -> tuple[Joint, ...]:
    """Return the joints that are compared, with their limits."""
    return tuple(dynamics.robot.joints[dynamics.robot.joint_numbers[name]] for name in dynamics.joint_names)
