"""Many recordings of one robot: each is checked by itself, in this process or another, and all are summarized."""

from __future__ import annotations

from collections.abc import Generator, Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.checking.check import Predictor, compare, judge
from robot_dynamics.checking.faults import Evidence
from robot_dynamics.checking.load_hint import LoadHint
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.recordings.recording import moving_base_link, open_recording
from robot_dynamics.recordings.recording_division import divide_recording
from robot_dynamics.recordings.recording_parts import IndivisibleRecordingError
from robot_dynamics.recordings.sample_range import WHOLE

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import CheckResult, CheckSums, PieceCallback
    from robot_dynamics.checking.fault_search import Fault
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.recordings.drives import Drives
    from robot_dynamics.recordings.joint_motions import Motion
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.recording import ProgressWrapper, Recording
    from robot_dynamics.recordings.recording_parts import RecordingPart
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
    part_messages : number of messages in each part of a long recording; None: as for `divide_recording`.
    """

    dynamics: Dynamics
    drives: Drives
    topics: tuple[str, ...]
    tolerances: Tolerances
    cutoff: float | None = None
    rate: float | None = None
    faults: bool = False
    sample_range: SampleRange = WHOLE
    part_messages: int | None = None


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

    executor: its processes read and check, a long recording in parts; None: this process does.
    """
    if executor is None:
        outcomes: Iterable[Outcome] = map(partial(_check_path, options), map(Path, paths))
    else:
        absolute = [Path(path).absolute() for path in paths]
        results = executor.map(partial(_check_or_divide, options), absolute)
        outcomes = (
            result if isinstance(result, Outcome) else _check_parts(options, path, result, executor)
            for path, result in zip(absolute, results, strict=True)
        )
    for path, outcome in zip(paths, outcomes, strict=True):
        name = str(path)
        error = outcome.error and outcome.error.replace(str(Path(path).absolute()), name)
        yield replace(
            outcome, recording=name, error=error, check=outcome.check and replace(outcome.check, recording=name)
        )


def check_recording(
    recording: Recording,
    options: CheckOptions,
    *,
    progress: ProgressWrapper | None = None,
    callbacks: Sequence[PieceCallback] = (),
) -> tuple[CheckResult, Fault | None]:
    """Check one recording, a long one in parts.

    callbacks: called with each piece, as `on_piece` of `check`; then the recording is not divided. Raises
    RecordingError.
    """
    if not callbacks:
        parts = _divide(recording, options)
        try:
            with closing(_ticks(progress)) as ticks:
                sums = (_sum_part(options, part, progress=partial(_tick, ticks, part.part)) for part in parts)
                return _judge(recording.name, options, sums)
        except IndivisibleRecordingError:
            pass
    return _judge(recording.name, options, [_sum_part(options, recording, progress=progress, callbacks=callbacks)])


def _ticks(progress: ProgressWrapper | None) -> Generator[None, None, None]:
    """An iterator without end whose progress is shown: one for all parts of a recording."""
    yield from repeat(None) if progress is None else progress(repeat(None))


def _tick(
    ticks: Iterator[None], part: RecordingPart | None, samples: Iterable[JointSample]
) -> Generator[JointSample, None, None]:
    """Pass samples on; those that belong to a part, or to the whole recording, advance the ticks."""
    for sample in samples:
        if part is None or part.contains(sample.receive_time):
            next(ticks)
        yield sample


@dataclass(frozen=True, eq=False)
class _PartSums:
    """The sums of a part of a recording, and its evidence of faults and loads."""

    sums: CheckSums
    evidence: Evidence | None
    load_hint: LoadHint

    def append(self, later: _PartSums) -> None:
        self.sums.append(later.sums)
        if self.evidence is not None and later.evidence is not None:
            self.evidence.append(later.evidence)
        self.load_hint.append(later.load_hint)


def _sum_part(
    options: CheckOptions,
    recording: Recording,
    *,
    progress: ProgressWrapper | None = None,
    callbacks: Sequence[PieceCallback] = (),
) -> _PartSums:
    evidence = Evidence(Predictor(options.dynamics, recording.drives)) if options.faults else None
    load_hint = LoadHint(options.dynamics, recording.drives)

    def on_piece(motion: Motion, predicted: Array, origin: int) -> None:
        for callback in callbacks:
            callback(motion, predicted, origin)
        if evidence is not None:
            evidence.add(motion, predicted, origin)
        load_hint.add(motion, predicted, origin)

    sums = compare(
        recording, options.dynamics, cutoff=options.cutoff, rate=options.rate, progress=progress, on_piece=on_piece
    )
    return _PartSums(sums, evidence, load_hint)


def _judge(recording: str, options: CheckOptions, parts: Iterable[_PartSums]) -> tuple[CheckResult, Fault | None]:
    """The result and the fault from the sums of all parts of a recording, in their order."""
    total: _PartSums | None = None
    for part in parts:
        if total is None:
            total = part
        else:
            total.append(part)
    assert total is not None, "a recording has at least one part"
    result = judge(recording, options.dynamics, options.tolerances, total.sums)
    fault = None if total.evidence is None else total.evidence.find_fault()
    if fault is None and any(verdict.failed for verdict in result.verdicts):
        hint = total.load_hint.sentence(np.array([verdict.tolerance for verdict in result.verdicts]))
        result = replace(result, notes=(*result.notes, hint) if hint else result.notes)
    return result, fault


def _open(options: CheckOptions, path: Path) -> Recording:
    base = moving_base_link(options.dynamics)
    return open_recording(path, options.drives, options.topics, base, options.sample_range)


def _divide(recording: Recording, options: CheckOptions) -> tuple[Recording, ...]:
    return divide_recording(recording, rate=options.rate, cutoff=options.cutoff, part_messages=options.part_messages)


def _check_path(options: CheckOptions, path: Path) -> Outcome:
    try:
        return Outcome(str(path), *check_recording(_open(options, path), options))
    except RobotDynamicsError as error:
        return Outcome(str(path), error=str(error))


def _check_or_divide(options: CheckOptions, path: Path) -> Outcome | tuple[RecordingPart, ...]:
    """The outcome of a recording, or its parts if it is long: without the recording, whose files a process opens."""
    try:
        parts = [recording.part for recording in _divide(_open(options, path), options) if recording.part is not None]
    except RobotDynamicsError as error:
        return Outcome(str(path), error=str(error))
    return tuple(parts) or _check_path(options, path)


def _check_parts(options: CheckOptions, path: Path, parts: Sequence[RecordingPart], executor: Executor) -> Outcome:
    """The outcome of a recording whose parts are tasks."""
    try:
        return Outcome(
            str(path), *_judge(str(path), options, executor.map(partial(_open_and_sum_part, options, path), parts))
        )
    except IndivisibleRecordingError:
        return executor.submit(_check_path, options, path).result()
    except RobotDynamicsError as error:
        return Outcome(str(path), error=str(error))


def _open_and_sum_part(options: CheckOptions, path: Path, part: RecordingPart) -> _PartSums:
    return _sum_part(options, replace(_open(options, path), part=part))


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
