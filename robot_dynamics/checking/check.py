"""A recording against the model of a robot: efforts that were measured beside those that `Dynamics` predicts, and what
is to be thought of it, joint by joint and second by second."""

from dataclasses import asdict, dataclass

import numpy as np

from robot_dynamics.checking.comparison import Comparison, JointComparison
from robot_dynamics.errors import RecordingError
from robot_dynamics.recordings.position_limits import note_limit_violations
from robot_dynamics.recordings.sample_statistics import SampleStatistics


@dataclass(frozen=True)
class Verdict:
    """Of one joint: what was compared, the RMS that is tolerated [N m or N], and what is wrong: sentences."""

    joint: JointComparison
    tolerance: float
    failures: tuple

    @property
    def passed(self):
        return not self.failures


@dataclass(frozen=True)
class FailedSegment:
    """A time [s] from `start` to `end` in which a joint is out of tolerance; rms: of its residual there."""

    joint: str
    start: float
    end: float
    rms: float


@dataclass(frozen=True, eq=False)
class CheckResult:
    """All that a check found. notes: sentences on what was left out of the recording; comparison: the sums, with
    samples for pictures."""

    recording: str
    robot: str
    rate: float
    cutoff: float
    duration: float
    verdicts: tuple
    segments: tuple
    notes: tuple
    comparison: Comparison

    @property
    def passed(self):
        return all(verdict.passed for verdict in self.verdicts)

    @property
    def first_failure_time(self):
        """Beginning [s] of the first segment out of tolerance, None where there is none."""
        return min((segment.start for segment in self.segments), default=None)

    def as_dict(self):
        """Plain data, for JSON: None where a number is not finite."""
        joints = [{**asdict(verdict.joint), "tolerated": verdict.tolerance, "passed": verdict.passed,
                   "objections": list(verdict.failures)} for verdict in self.verdicts]  # fmt: skip
        joints = [{key: None if isinstance(value, float) and not np.isfinite(value) else value
                   for key, value in joint.items()} for joint in joints]  # fmt: skip
        return {
            "format": 1, "recording": self.recording, "robot": self.robot, "passed": self.passed, "rate": self.rate,
            "cutoff": self.cutoff, "duration": self.duration, "joints": joints, "since": self.first_failure_time,
            "segments": [asdict(segment) for segment in self.segments], "notes": list(self.notes),
        }  # fmt: skip


class Predictor:
    """Efforts that a robot and its drives demand for Motions, less gravity where drives do not measure it."""

    def __init__(self, dynamics, drives):
        self.dynamics, self.drives = dynamics, drives
        dynamics.compile(
            "inverse", prescribed_base=dynamics.robot.moving_base
        )  # now, rather than after the first pieces

    def __call__(self, motion):
        """(N, n)"""
        return self.efforts(self.dynamics, motion)

    def efforts(self, dynamics, motion):
        """(N, n): those of another Dynamics of the same joints."""
        efforts = dynamics.inverse(motion.q, motion.qd, motion.qdd, base=motion.base)
        efforts = efforts + self.drives.drive_efforts(motion.qd, motion.qdd)
        if not self.drives.excludes_gravity:
            return efforts
        return efforts - dynamics.gravity(motion.q, base=motion.base)[..., -efforts.shape[-1] :]


def check(recording, dynamics, tolerances, *, cutoff=None, rate=None, progress=None, on_piece=None):
    """The Check of a Recording against the Dynamics of a robot. Raises RecordingError.

    cutoff [Hz], rate [1/s], watch: as for `Recording.motions`; each: called with (motion, predicted, stamp of
    time 0 [ns]) of each piece.
    """
    predictor, statistics = Predictor(dynamics, recording.drives), SampleStatistics()
    comparison, motion = Comparison(dynamics.joint_names), None
    for motion in recording.motions(statistics, cutoff=cutoff, rate=rate, progress=progress):
        predicted = predictor(motion)
        note_limit_violations(dynamics, motion, statistics)
        comparison.add(motion, predicted)
        if on_piece is not None:
            on_piece(motion, predicted, statistics.origin)
    if not comparison.has_efforts.any():
        told = "".join(f"; {note}" for note in recording.notes)
        raise RecordingError(f"{recording.name}: no efforts are recorded: nothing was measured{told}")
    limits = effort_limits(dynamics.robot, dynamics.joint_names, comparison.peaks)
    verdicts, segments = compute_verdicts(comparison, limits, tolerances)
    if all(verdict.joint.spread == 0 for verdict in verdicts):
        raise RecordingError(f"{recording.name}: efforts are constant throughout: nothing was measured")
    end = motion.time + len(motion) / motion.rate
    notes = (*recording.notes, *statistics.sentences)
    return CheckResult(recording.name, dynamics.robot.name, motion.rate, motion.cutoff, end, verdicts, segments, notes,
                 comparison)  # fmt: skip


def effort_limits(robot, joint_names, peaks):
    """(n,) effort limits [N m or N]; of joints without one the largest effort that was measured."""
    limits = np.array([robot.joints[robot.joint_numbers[name]].limits.effort for name in joint_names])
    return np.where(np.isfinite(limits) & (limits > 0), limits, peaks)


def compute_verdicts(comparison, limits, tolerances):
    """(Verdicts of the joints, Segments that are out of tolerance) of a Comparison and effort limits (n,)."""
    compared = comparison.joint_comparisons
    tolerated = np.array([tolerances.rms_tolerance(joint.joint, joint.spread, limit)
                          for joint, limit in zip(compared, limits, strict=True)])  # fmt: skip
    segments = tuple(_segments(comparison, tolerated * tolerances.window_factor))
    verdicts = []
    for joint, allowed, measured in zip(compared, tolerated, comparison.has_efforts, strict=True):
        objections = []
        if not measured or joint.spread == 0:
            objections.append("no effort was measured" if not measured else "the effort measured is constant")
        elif not joint.rms <= allowed:  # nan is no pass
            objections.append(f"RMS {joint.rms:.3g} where {allowed:.3g} is tolerated")
            objections += _hints(joint)
        own = [segment for segment in segments if segment.joint == joint.joint]
        if own:
            objections.append(f"out of tolerance from {own[0].start:.4g} s on, {len(own)} times in all")
        verdicts.append(Verdict(joint, float(allowed), tuple(objections)))
    return tuple(verdicts), segments


def _hints(joint):
    """What may be the matter with a whole recording of a joint."""
    if joint.correlation < -0.9:
        yield "measured and predicted efforts have opposite signs"
    elif joint.correlation > 0.98 and abs(joint.scale - 1) > 0.2:
        yield f"measured is {joint.scale:.3g} times the prediction: another unit, a current or a gear ratio?"
    elif abs(joint.bias) > 0.9 * joint.rms:
        yield f"most of it is a bias of {joint.bias:.3g}"


def _segments(comparison, tolerated):
    """Segments of neighbouring windows whose residuals are above what is tolerated (n,)."""
    starts, rms = comparison.window_rms
    for column, name in enumerate(comparison.joint_names):
        if not comparison.has_efforts[column]:
            continue
        above = np.flatnonzero(~(rms[:, column] <= tolerated[column]))
        for group in np.split(above, np.flatnonzero(np.diff(starts[above]) > 1.5 * comparison.window) + 1):
            if len(group):
                worst = float(np.sqrt(np.mean(rms[group, column] ** 2)))
                yield FailedSegment(name, float(starts[group[0]]), float(starts[group[-1]] + comparison.window), worst)
