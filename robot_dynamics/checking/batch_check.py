"""Many recordings of one robot: each is checked by itself, in this process or another, and all are summarized."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.check import Predictor, check
from robot_dynamics.checking.faults import Evidence
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.recordings.recording import moving_base_link, open_recording
from robot_dynamics.recordings.sample_range import WHOLE

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import CheckResult, PieceCallback
    from robot_dynamics.checking.fault_search import Fault
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.recording import ProgressWrapper, Recording
    from robot_dynamics.recordings.sample_range import SampleRange


@dataclass(frozen=True, eq=False)
class CheckOptions:
    """Options for the check of each recording.

    Attributes
    ----------
    dynamics, tolerances : as for `check`.
    drives, topics : as for `open_recording`.
    cutoff : cut-off frequency [Hz]; None: as for `check`.
    rate : samples per second of the grid; None: as recorded.
    faults : whether to find the fault that explains the residuals.
    sample_range : the part of each recording that is used.
    """

    dynamics: Dynamics
    drives: Drives
    topics: tuple[str, ...]
    tolerances: Tolerances
    cutoff: float | None = None
    rate: float | None = None
    faults: bool = False
    sample_range: SampleRange = WHOLE


@dataclass(frozen=True, eq=False)
class Outcome:
    """The result of one recording: its check and fault, or the reason why it could not be checked."""

    recording: str
    check: CheckResult | None = None
    fault: Fault | None = None
    error: str | None = None

    @property
    def passed(self) -> bool:
        """Whether all joints pass and no fault was found."""
        return self.check is not None and self.check.passed and self.fault is None

    @property
    def passed_or_not_judged(self) -> bool | None:
        """As `passed`; None where the recording could not be checked, or no joint can be judged."""
        if self.check is None:
            return None
        return False if self.fault is not None else self.check.passed_or_not_judged

    def as_dict(self) -> dict[str, object]:
        """Plain data for JSON."""
        if self.check is None:
            return {"recording": self.recording, "passed": None, "refused": self.error}
        return {**self.check.as_dict(), "passed": self.passed_or_not_judged, "fault": self.fault and vars(self.fault)}


@dataclass(frozen=True)
class JointSummary:
    """A joint in many recordings.

    Attributes
    ----------
    joint : name.
    rms, bias : RMS and mean of the residual over the samples of all recordings [N m or N].
    failed : recordings in which the joint does not pass.
    worst : the recording in which its RMS is largest.
    """

    joint: str
    rms: float
    bias: float
    failed: tuple[str, ...]
    worst: str


def check_recordings(
    paths: Sequence[str | Path], options: CheckOptions, executor: Executor | None = None
) -> Iterator[Outcome]:
    """Yield the outcome of the recording at each path, in their order; errors of one do not stop the others.

    executor: its processes read and check; None: this process does.
    """
    run = map if executor is None else executor.map
    outcomes = run(partial(_check_path, options), [Path(path).absolute() for path in paths])
    for path, outcome in zip(paths, outcomes, strict=True):
        name = str(path)
        yield replace(outcome, recording=name, check=outcome.check and replace(outcome.check, recording=name))


def check_recording(
    recording: Recording,
    options: CheckOptions,
    *,
    progress: ProgressWrapper | None = None,
    callbacks: Sequence[PieceCallback] = (),
) -> tuple[CheckResult, Fault | None]:
    """Check one recording; callbacks: called with each piece, as `on_piece` of `check`. Raises RecordingError."""
    evidence = Evidence(Predictor(options.dynamics, recording.drives)) if options.faults else None

    def on_piece(motion: Motion, predicted: Array, origin: int) -> None:
        for callback in callbacks:
            callback(motion, predicted, origin)
        if evidence is not None:
            evidence.add(motion, predicted, origin)

    result = check(
        recording,
        options.dynamics,
        options.tolerances,
        cutoff=options.cutoff,
        rate=options.rate,
        progress=progress,
        on_piece=on_piece,
    )
    return result, None if evidence is None else evidence.find_fault()


def _check_path(options: CheckOptions, path: Path) -> Outcome:
    try:
        base = moving_base_link(options.dynamics)
        recording = open_recording(path, options.drives, options.topics, base, options.sample_range)
        return Outcome(str(path), *check_recording(recording, options))
    except RobotDynamicsError as error:
        return Outcome(str(path), error=str(error))


def summarize_joints(outcomes: Iterable[Outcome]) -> list[JointSummary]:
    """Summarize each joint over outcomes, of which at least one has a check."""
    checks = [outcome.check for outcome in outcomes if outcome.check is not None]
    samples = sum(result.comparison.counts for result in checks)
    total = np.zeros_like(checks[0].comparison.residual_sums)
    for result in checks:
        total += result.comparison.residual_sums
    bias, mean_squares = total / np.maximum(samples, 1)
    return [
        JointSummary(
            joint=name,
            rms=float(np.sqrt(mean_squares[column])),
            bias=float(bias[column]),
            failed=tuple(result.recording for result in checks if result.verdicts[column].failed),
            worst=_worst_recording(checks, column),
        )
        for column, name in enumerate(checks[0].comparison.joint_names)
    ]


def _worst_recording(checks: Sequence[CheckResult], column: int) -> str:
    """The recording in which the RMS of a joint is largest."""
    return max(checks, key=lambda result: np.nan_to_num(result.verdicts[column].joint.rms, nan=-1.0)).recording
