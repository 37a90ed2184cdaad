"""A recording against the model of a robot: measured efforts against those that `Dynamics` predicts, with a verdict for
each joint and the times that are out of tolerance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.checking.comparison import Comparison
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.joint_motions import Motion
from robot_dynamics.recordings.position_limits import note_limit_violations
from robot_dynamics.recordings.sample_statistics import SampleStatistics

if TYPE_CHECKING:
    from robot_dynamics.checking.comparison import JointComparison
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.recording import ProgressWrapper, Recording

OPPOSITE_CORRELATION = -0.9  # below it, a sign is probably wrong
CLOSE_CORRELATION = 0.98  # above it, a scale other than 1 is probably a wrong unit or ratio
MAX_SCALE_ERROR = 0.2
BIAS_SHARE = 0.9  # part of the RMS above which the bias is named as the cause

PieceCallback: TypeAlias = Callable[[Motion, Array, int], object]
"""Called with a motion, its predicted efforts (N, n), and the stamp [ns] of time 0."""


@dataclass(frozen=True)
class Verdict:
    """The verdict on a joint.

    Attributes
    ----------
    joint : the comparison of its efforts.
    tolerance : largest RMS of the residual that passes [N m or N].
    failures : sentences on the reasons why it does not pass; empty where it passes.
    """

    joint: JointComparison
    tolerance: float
    failures: tuple[str, ...]

    @property
    def passed(self) -> bool:
        """Whether there are no failures."""
        return not self.failures


@dataclass(frozen=True)
class FailedSegment:
    """Times from `start` to `end` [s] in which a joint is out of tolerance; rms: of its residual there [N m or N]."""

    joint: str
    start: float
    end: float
    rms: float


@dataclass(frozen=True, eq=False)
class CheckResult:
    """The result of a check.

    Attributes
    ----------
    recording, robot : names.
    rate : samples per second.
    cutoff : cut-off frequency of the filter [Hz].
    duration : time of the end of the last motion [s].
    verdicts : one for each joint, in the order of the model.
    segments : times out of tolerance.
    notes : sentences on samples that were skipped or replaced.
    comparison : sums over the samples, and some samples for figures.
    """

    recording: str
    robot: str
    rate: float
    cutoff: float
    duration: float
    verdicts: tuple[Verdict, ...]
    segments: tuple[FailedSegment, ...]
    notes: tuple[str, ...]
    comparison: Comparison

    @property
    def passed(self) -> bool:
        """Whether all joints pass."""
        return all(verdict.passed for verdict in self.verdicts)

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
            "passed": self.passed,
            "rate": self.rate,
            "cutoff": self.cutoff,
            "duration": self.duration,
            "joints": [_verdict_dict(verdict) for verdict in self.verdicts],
            "since": self.first_failure_time,
            "segments": [asdict(segment) for segment in self.segments],
            "notes": list(self.notes),
        }


def _verdict_dict(verdict: Verdict) -> dict[str, object]:
    values = {
        **asdict(verdict.joint),
        "tolerated": verdict.tolerance,
        "passed": verdict.passed,
        "objections": list(verdict.failures),
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
    on_piece : called with each piece of motion, its predicted efforts (N, n), and the stamp of time 0 [ns].

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
    predictor = Predictor(dynamics, recording.drives)
    statistics = SampleStatistics()
    comparison = Comparison(dynamics.joint_names)
    for motion in recording.motions(statistics, cutoff=cutoff, rate=rate, progress=progress):
        predicted = predictor(motion)
        note_limit_violations(dynamics, motion, statistics)
        comparison.add(motion, predicted)
        if on_piece is not None:
            on_piece(motion, predicted, statistics.origin)
    if not comparison.has_efforts.any():
        notes = "".join(f"; {note}" for note in recording.notes)
        raise RecordingError(f"{recording.name}: no efforts are recorded: nothing was measured{notes}")
    limits = effort_limits(dynamics.robot, dynamics.joint_names, comparison.peaks)
    verdicts, segments = compute_verdicts(comparison, limits, tolerances)
    if all(verdict.joint.spread == 0 for verdict in verdicts):
        raise RecordingError(f"{recording.name}: efforts are constant throughout: nothing was measured")
    return CheckResult(
        recording=recording.name,
        robot=dynamics.robot.name,
        rate=motion.rate,
        cutoff=motion.cutoff,
        duration=motion.end,
        verdicts=verdicts,
        segments=segments,
        notes=(*recording.notes, *statistics.sentences),
        comparison=comparison,
    )


def effort_limits(robot: Robot, joint_names: Sequence[str], peaks: Array) -> Array:
    """Effort limits (n,) [N m or N]; the largest measured effort (n,) where a joint has no limit."""
    limits = np.array([robot.joints[robot.joint_numbers[name]].limits.effort for name in joint_names])
    return np.where(np.isfinite(limits) & (limits > 0), limits, peaks)


def compute_verdicts(
    comparison: Comparison, limits: Array, tolerances: Tolerances
) -> tuple[tuple[Verdict, ...], tuple[FailedSegment, ...]]:
    """Verdicts of the joints and segments out of tolerance, of a comparison and effort limits (n,) [N m or N]."""
    joints = comparison.joint_comparisons
    tolerated = np.array(
        [
            tolerances.rms_tolerance(joint.joint, joint.spread, limit)
            for joint, limit in zip(joints, limits, strict=True)
        ]
    )
    segments = tuple(_failed_segments(comparison, tolerated * tolerances.window_factor))
    verdicts = []
    for joint, tolerance, has_efforts in zip(joints, tolerated, comparison.has_efforts, strict=True):
        failures = [*_joint_failures(joint, tolerance, has_efforts), *_segment_failures(joint.joint, segments)]
        verdicts.append(Verdict(joint, float(tolerance), tuple(failures)))
    return tuple(verdicts), segments


def _joint_failures(joint: JointComparison, tolerance: float, has_efforts: bool) -> Iterator[str]:
    """Reasons why a joint does not pass over the whole recording, with probable causes."""
    if not has_efforts:
        yield "no effort was measured"
    elif joint.spread == 0:
        yield "the measured effort is constant"
    elif not joint.rms <= tolerance:  # nan does not pass
        yield f"RMS {joint.rms:.3g} where {tolerance:.3g} is tolerated"
        yield from _probable_causes(joint)


def _segment_failures(name: str, segments: Sequence[FailedSegment]) -> Iterator[str]:
    own = [segment for segment in segments if segment.joint == name]
    if own:
        yield f"out of tolerance from {own[0].start:.4g} s on, {len(own)} times in all"


def _probable_causes(joint: JointComparison) -> Iterator[str]:
    if joint.correlation < OPPOSITE_CORRELATION:
        yield "measured and predicted efforts have opposite signs"
    elif joint.correlation > CLOSE_CORRELATION and abs(joint.scale - 1) > MAX_SCALE_ERROR:
        yield f"measured is {joint.scale:.3g} times the prediction: another unit, a current or a gear ratio?"
    elif abs(joint.bias) > BIAS_SHARE * joint.rms:
        yield f"most of it is a bias of {joint.bias:.3g}"


def _failed_segments(comparison: Comparison, tolerated: Array) -> Iterator[FailedSegment]:
    """Segments of neighbouring windows whose RMS of residuals exceeds what is tolerated (n,)."""
    starts, rms = comparison.window_rms
    for column, name in enumerate(comparison.joint_names):
        if not comparison.has_efforts[column]:
            continue
        above = np.flatnonzero(~(rms[:, column] <= tolerated[column]))
        cuts = np.flatnonzero(np.diff(starts[above]) > 1.5 * comparison.window) + 1
        for group in np.split(above, cuts):
            if len(group):
                segment_rms = float(np.sqrt(np.mean(rms[group, column] ** 2)))
                end = float(starts[group[-1]] + comparison.window)
                yield FailedSegment(name, float(starts[group[0]]), end, segment_rms)
