"""The verdicts of a check: which joints pass, which fail and why, and which cannot be judged.

A joint passes where the model explains its effort. Where the residual is tolerated only because it is within the noise
or the accuracy of the measurement, and these are more than half of the effort, a model that explains half of the effort
would be tolerated too: such a joint is not judged.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.scale_sums import Scale

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.comparison import Comparison, JointComparison
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.model.robot import Robot

MAX_TOLERATED_PART = 0.5  # of the effort: with more, the RMS of the residual does not judge a model
MIN_MOVING_TIME = 1.0  # [s] of motion of a joint that are needed for a verdict
SCALE_DEVIATIONS = 2.0  # standard deviations of the scale that are added to its tolerance
OPPOSITE_CORRELATION = -0.9  # below it, a sign is probably wrong
CLOSE_CORRELATION = 0.98  # above it, a scale other than 1 is probably a wrong unit or ratio
LARGE_SCALE_ERROR = 0.2
BIAS_SHARE = 0.9  # part of the RMS above which the bias is named as the cause


@dataclass(frozen=True)
class Verdict:
    """The verdict on a joint.

    Attributes
    ----------
    joint : the comparison of its efforts.
    tolerance : largest RMS of the residual that passes [N m or N]; nan where the joint never moves.
    failures : sentences on the reasons why it fails; empty where it does not.
    not_judged : the reason why it cannot be judged; empty where it can, and where it fails.
    """

    joint: JointComparison
    tolerance: float
    failures: tuple[str, ...]
    not_judged: str = ""

    @property
    def failed(self) -> bool:
        """Whether there are failures."""
        return bool(self.failures)

    @property
    def passed(self) -> bool:
        """Whether the joint is judged and has no failures."""
        return not self.failures and not self.not_judged

    @property
    def numbers(self) -> tuple[float, ...]:
        """The numbers of a table, from the RMS to the unfiltered RMS."""
        joint = self.joint
        return (
            joint.rms,
            self.tolerance,
            joint.normalised,
            joint.largest,
            joint.at,
            joint.bias,
            joint.correlation,
            joint.scale,
            joint.scale_deviation,
            joint.rms_unfiltered,
        )

    @property
    def word(self) -> str:
        """The verdict for a table: passed, FAILED or not judged."""
        if self.failed:
            return "FAILED"
        return "passed" if self.passed else "not judged"

    @property
    def reasons(self) -> tuple[str, ...]:
        """The failures, or why the joint is not judged; empty where it passes."""
        return self.failures or ((self.not_judged,) if self.not_judged else ())


@dataclass(frozen=True)
class FailedSegment:
    """Times from `start` to `end` [s] in which a joint is out of tolerance; rms: of its residual there [N m or N]."""

    joint: str
    start: float
    end: float
    rms: float


def effort_limits(robot: Robot, joint_names: Sequence[str], peaks: Array) -> Array:
    """Effort limits (n,) [N m or N]; the largest measured effort (n,) where a joint has no limit."""
    limits = np.array([robot.joints[robot.joint_numbers[name]].limits.effort for name in joint_names])
    return np.where(np.isfinite(limits) & (limits > 0), limits, peaks)


def tolerated_rms(comparison: Comparison, limits: Array, tolerances: Tolerances) -> Array:
    """Tolerated RMS (n,) of the residuals of the joints [N m or N], for effort limits (n,)."""
    joints = comparison.joint_comparisons
    return np.array([tolerances.rms_tolerance(joint, limit) for joint, limit in zip(joints, limits, strict=True)])


def compute_verdicts(
    comparison: Comparison, tolerated: Array, tolerances: Tolerances, rate: float
) -> tuple[tuple[Verdict, ...], tuple[FailedSegment, ...]]:
    """Compute the verdicts of the joints and the segments out of tolerance.

    Parameters
    ----------
    comparison : sums over the samples.
    tolerated : (n,) see `tolerated_rms` [N m or N].
    tolerances : see `load_tolerances`.
    rate : samples per second.
    """
    segments = tuple(_failed_segments(comparison, tolerated * tolerances.window_factor))
    verdicts = []
    columns = zip(comparison.joint_comparisons, tolerated, comparison.has_efforts, strict=True)
    for joint, tolerance, has_efforts in columns:
        failures = [
            *_joint_failures(joint, tolerance, has_efforts, tolerances),
            *_segment_failures(joint.joint, segments),
        ]
        not_judged = "" if failures else _why_not_judged(joint, tolerance, tolerances, rate)
        verdicts.append(Verdict(joint, float(tolerance), tuple(failures), not_judged))
    return tuple(verdicts), segments


def _why_not_judged(joint: JointComparison, tolerance: float, tolerances: Tolerances, rate: float) -> str:
    if joint.samples == 0:
        return "the joint rests throughout"
    if joint.samples < MIN_MOVING_TIME * rate:
        return f"the joint moves for {joint.samples / rate:.2g} s only"
    if joint.rms <= tolerances.model_tolerance(replace(joint, direction=0.0)):
        return ""
    if tolerance > MAX_TOLERATED_PART * joint.effort_rms:
        return f"its effort of {joint.effort_rms:.3g} RMS is too small for a tolerance of {tolerance:.3g}"
    if joint.moves_one_way:
        return f"the joint moves in one direction only: a residual of {joint.rms:.3g} may be friction"
    return ""


def _joint_failures(
    joint: JointComparison, tolerance: float, has_efforts: bool, tolerances: Tolerances
) -> Iterator[str]:
    """Reasons why a joint fails over the whole recording, with probable causes."""
    if not has_efforts:
        yield "no effort was measured"
        return
    if joint.samples == 0:
        return
    if joint.spread == 0:
        yield "the measured effort is constant"
        return
    if not joint.rms <= tolerance:  # nan does not pass
        yield f"RMS {joint.rms:.3g} where {tolerance:.3g} is tolerated"
    uncertainty = _uncertainty(joint, tolerance, tolerances)
    if uncertainty <= MAX_TOLERATED_PART * joint.spread:
        # the correlation of a perfect model is lower by noise
        attenuation = np.sqrt(1 - (uncertainty / joint.spread) ** 2)
        least = attenuation * tolerances.of_joint("min_correlation", joint.joint)
        if not joint.correlation >= least:
            yield f"correlation {joint.correlation:.3g} where {least:.3g} is needed"
        yield from _scale_failures(joint, tolerances.of_joint("max_scale_error", joint.joint))
    if not joint.rms <= tolerance:
        yield from _probable_causes(joint)


def _uncertainty(joint: JointComparison, tolerance: float, tolerances: Tolerances) -> float:
    """The part of the tolerated RMS [N m or N] that does not depend on the spread of the effort."""
    measurement_squares = max(0.0, tolerance**2 - tolerances.model_tolerance(joint) ** 2)
    load_error = tolerances.of_joint("relative_rms", joint.joint) * joint.effort_rms
    return float(np.sqrt(measurement_squares + load_error**2))


def _scale_failures(joint: JointComparison, tolerated: float) -> Iterator[str]:
    scale = Scale(joint.scale, joint.scale_deviation)
    if abs(scale.value - 1) > tolerated + SCALE_DEVIATIONS * scale.deviation:  # not so where one of them is nan
        yield (
            f"measured efforts are {scale.value:.3g} ± {scale.deviation:.2g} times the predicted ones, where "
            f"{1 - tolerated:.3g} to {1 + tolerated:.3g} is tolerated"
        )


def undetermined_scale(verdicts: Sequence[Verdict], tolerances: Tolerances) -> Iterator[str]:
    """Yield a sentence where scales of joints that pass are too uncertain for a verdict.

    It is general where no joint fails, and no scale is so certain that a wrong gain of all joints would show. Else it
    names the joints that pass with a scale beyond its tolerance, for its standard deviation or a small effort.
    """
    joints = [verdict.joint for verdict in verdicts if verdict.passed]
    limits = {joint.joint: tolerances.of_joint("max_scale_error", joint.joint) for joint in joints}
    is_certain = [
        SCALE_DEVIATIONS * joint.scale_deviation <= limits[joint.joint] for joint in joints
    ]  # not so where it is nan
    if joints and not any(verdict.failed for verdict in verdicts) and not any(is_certain):
        yield (
            f"scale not determined: efforts of all joints that are {200 * tolerances.max_scale_error:.3g} % too large "
            "may pass, because the motion is short, or friction is a large part of the efforts"
        )
        return
    uncertain = [
        f"{joint.joint} {joint.scale:.3g} ± {joint.scale_deviation:.2g}"
        for joint in joints
        if abs(joint.scale - 1) > limits[joint.joint] and np.isfinite(joint.scale_deviation)
    ]
    if uncertain:
        yield (
            f"scale too uncertain for a verdict, by its deviation or a small effort: {', '.join(uncertain)}. Record a "
            "longer motion, with loads that are large beside friction"
        )


def _segment_failures(name: str, segments: Sequence[FailedSegment]) -> Iterator[str]:
    own = [segment for segment in segments if segment.joint == name]
    if own:
        extent = f"{len(own)} times in all" if len(own) > 1 else f"until {own[0].end:.4g} s"
        yield f"out of tolerance from {own[0].start:.4g} s on, {extent}"


def _probable_causes(joint: JointComparison) -> Iterator[str]:
    if joint.correlation < OPPOSITE_CORRELATION:
        yield "measured and predicted efforts have opposite signs"
    elif joint.correlation > CLOSE_CORRELATION and abs(joint.scale - 1) > LARGE_SCALE_ERROR:
        cause = "a gain or a load" if 0.5 < joint.scale < 2 else "another unit, a current or a gear ratio"
        yield f"measured is {joint.scale:.3g} times the prediction: {cause}?"
    elif abs(joint.bias) > BIAS_SHARE * joint.rms:
        yield f"most of it is a bias of {joint.bias:.3g}"


def _failed_segments(comparison: Comparison, tolerated: Array) -> Iterator[FailedSegment]:
    """Segments of neighbouring windows whose RMS of residuals exceeds what is tolerated (n,)."""
    starts, rms = comparison.window_rms
    for column, name in enumerate(comparison.joint_names):
        if not comparison.has_efforts[column] or not comparison.counts[column]:
            continue
        above = np.flatnonzero(~(rms[:, column] <= tolerated[column]))
        cuts = np.flatnonzero(np.diff(starts[above]) > 1.5 * comparison.window) + 1
        for group in np.split(above, cuts):
            if len(group):
                segment_rms = float(np.sqrt(np.mean(rms[group, column] ** 2)))
                end = float(starts[group[-1]] + comparison.window)
                yield FailedSegment(name, float(starts[group[0]]), end, segment_rms)
