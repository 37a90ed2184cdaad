"""Results of checks as text: a table for one recording, and summaries of several."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

from robot_dynamics.cli.recording_notes import merge_notes
from robot_dynamics.cli.text_table import format_table, print_table, round_to_digits

if TYPE_CHECKING:
    from robot_dynamics.checking.baseline import JointChange
    from robot_dynamics.checking.batch_check import JointSummary, Outcome
    from robot_dynamics.checking.check import CheckResult
    from robot_dynamics.checking.fault_search import Fault
    from robot_dynamics.cli.text_table import Cell

OUTCOME_HEADER = ["recording", "verdict", "samples", "out of tolerance since [s]", "joints"]
TABLE_HEADER = [
    "joint",
    "verdict",
    "RMS",
    "tolerated",
    "RMS/spread",
    "largest",
    "at [s]",
    "bias",
    "correlation",
    "scale",
    "deviation",
    "unfiltered",
    "at rest [%]",
]


def print_outcomes(
    outcomes: Sequence[Outcome],
    results: Sequence[Mapping[str, object]],
    joints: Sequence[JointSummary],
    *,
    faults: bool = False,
) -> None:
    """Print the outcomes of several recordings, and the summary of each joint.

    results: of the recordings in the form of the JSON file, whose verdicts include the comparison with a baseline;
    faults: whether faults were searched.
    """
    print_table(OUTCOME_HEADER, [_outcome_row(*pair) for pair in zip(outcomes, results, strict=True)])
    notes = {outcome.recording: outcome.check.notes for outcome in outcomes if outcome.check is not None}
    for note in merge_notes(notes):
        print(f"note: {note}")
    if joints:
        rows: list[list[Cell]] = [
            [joint.joint, round_to_digits(joint.rms, 3), round_to_digits(joint.bias, 3), len(joint.failed), joint.worst]
            for joint in joints
        ]
        print_table(
            ["joint", "RMS", "bias", "failed", "largest in"],
            rows,
            "Measured minus predicted effort of all recordings [N m or N]",
        )
    for outcome in outcomes:
        if outcome.error is not None:
            begins_with_name = outcome.error.startswith((f"{outcome.recording}:", f"{outcome.recording} "))
            print(f"not checked: {'' if begins_with_name else f'{outcome.recording}: '}{outcome.error}")
        for failure in outcome.check.failures if outcome.check is not None else ():
            print(f"{outcome.recording}: {failure}")
        if outcome.fault is not None:
            print(f"{outcome.recording}: {describe_fault(outcome.fault)}")
    if faults and not any(outcome.fault for outcome in outcomes):
        print(describe_fault(None))


def describe_fault(fault: Fault | None) -> str:
    """The sentence on the fault that --faults finds in a recording."""
    return f"fault: {fault.sentence}" if fault else "no fault found"


def format_counts(results: Sequence[Mapping[str, object]]) -> str:
    """Count the verdicts on recordings, from their results in the form of the JSON file."""
    words = ["not checked" if "joints" not in result else _overall_word(result["passed"]) for result in results]
    counts = {word: words.count(word) for word in ("passed", "FAILED", "not judged", "not checked")}
    return ", ".join(f"{count} {word}" for word, count in counts.items() if count or word in ("passed", "FAILED"))


def _outcome_row(outcome: Outcome, result: Mapping[str, object]) -> list[Cell]:
    """Return the cells of a recording in the table of outcomes; result: in the form of the JSON file."""
    if outcome.check is None:
        return [outcome.recording, "not checked", None, None, None]
    failed = [verdict.joint.joint for verdict in outcome.check.verdicts if verdict.failed]
    not_judged = outcome.check.not_judged
    joints = [
        f"{word}: {', '.join(names)}" for word, names in (("failed", failed), ("not judged", not_judged)) if names
    ]
    return [
        outcome.recording,
        _overall_word(result["passed"]),
        outcome.check.comparison.samples,
        outcome.check.first_failure_time,
        "; ".join(joints),
    ]


def format_changes(changes: Sequence[JointChange]) -> list[str]:
    """Format the changes since a baseline: a table, and a sentence for each reason why a joint is worse."""
    if not changes:
        return []
    several = len({change.recording for change in changes}) > 1
    rows: list[list[Cell]] = [
        [
            change.recording if several else None,
            change.joint,
            "WORSE" if change.reasons else "not worse",
            change.verdict_before,
            change.verdict,
            _round_finite(change.rms_before),
            _round_finite(change.rms),
            _round_finite(change.tolerated_increase),
            _round_finite(change.scale_before),
            _round_finite(change.scale),
        ]
        for change in changes
        if change.reasons or not several
    ]
    header = ["recording", "joint", "change", "verdict before", "verdict", "RMS before", "RMS", "tolerated increase"]
    lines = [format_table([*header, "scale before", "scale"], rows, "Compared with the baseline")] if rows else []
    for change in changes:
        name = f"{change.recording}: {change.joint}" if several else change.joint
        lines += [f"{name}: worse than the baseline: {reason}" for reason in change.reasons]
    worse = sum(bool(change.reasons) for change in changes)
    return [*lines, f"{worse} of {len(changes)} joints are worse than in the baseline"]


def format_check(result: CheckResult, passed: bool | None = None, sentences: Sequence[str] = ()) -> str:
    """Format the result of a check as text.

    passed: verdict that includes the sentences; None: that of the result; sentences: further results, such as a fault.
    """
    passed = result.passed_or_not_judged if passed is None else passed
    lines = [
        f"{result.recording} against {result.robot!r}: {result.comparison.samples} samples at {result.rate:.5g} Hz, "
        f"{result.duration:.5g} s, filtered at {result.cutoff:.3g} Hz, {100 * result.coverage:.3g} % of the recorded "
        "time"
    ]
    lines += [f"note: {note}" for note in result.notes]
    rows: list[list[Cell]] = []
    for verdict in result.verdicts:
        joint = verdict.joint
        numbers = (*verdict.numbers, 100 * joint.resting or None)
        cells = [_round_finite(number) for number in numbers]
        rows.append([joint.joint, verdict.word, *cells])
    lines.append(format_table(TABLE_HEADER, rows, "Measured minus predicted effort [N m or N]"))
    lines += [f"{verdict.joint.joint}: {failure}" for verdict in result.verdicts for failure in verdict.reasons]
    lines += result.failures
    onset = result.first_failure_time
    since = "" if onset is None else f", out of tolerance since {onset:.4g} s"
    details = "" if passed is None else _except_for(result.not_judged) if passed else since
    verdict_line = f"{_overall_word(passed)}{details}"
    return "\n".join([*lines, *sentences, "", verdict_line])


def _overall_word(passed: object) -> str:
    """The verdict on a recording; passed: None where nothing could be judged."""
    return "not judged" if passed is None else "passed" if passed else "FAILED"


def _except_for(names: Sequence[str]) -> str:
    return f", except for joints that are not judged: {', '.join(names)}" if names else ""


def _round_finite(number: float | None) -> float | None:
    """Round to three digits; None where a number is missing or not finite."""
    return None if number is None or not math.isfinite(number) else round_to_digits(number, 3)
