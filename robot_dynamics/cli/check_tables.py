"""Results of checks as text: a table for one recording, and summaries of several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from robot_dynamics.cli.text_table import format_table, print_table, round_to_digits

if TYPE_CHECKING:
    from robot_dynamics.checking.batch_check import JointSummary, Outcome
    from robot_dynamics.checking.check import CheckResult
    from robot_dynamics.cli.text_table import Cell

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


def print_outcomes(outcomes: Sequence[Outcome], joints: Sequence[JointSummary]) -> None:
    """Print the outcomes of several recordings, and the summary of each joint."""
    print_table(
        ["recording", "verdict", "samples", "since [s]", "what is wrong"], [_outcome_row(each) for each in outcomes]
    )
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
        if outcome.check is not None:
            for note in outcome.check.notes:
                print(f"note: {outcome.recording}: {note}")
    passed = sum(1 for outcome in outcomes if outcome.passed)
    unchecked = sum(1 for outcome in outcomes if outcome.check is None)
    print(f"\n{passed} passed, {len(outcomes) - passed - unchecked} FAILED, {unchecked} not checked")


def _outcome_row(outcome: Outcome) -> list[Cell]:
    """Return the cells of a recording in the table of outcomes."""
    if outcome.check is None:
        return [outcome.recording, "not checked", None, None, outcome.error]
    failed = ", ".join(verdict.joint.joint for verdict in outcome.check.verdicts if verdict.failed)
    fault = outcome.fault.sentence if outcome.fault else ""
    return [
        outcome.recording,
        "passed" if outcome.passed else "FAILED",
        outcome.check.comparison.samples,
        outcome.check.first_failure_time,
        "; ".join(filter(None, (failed, *outcome.check.failures, fault))),
    ]


def format_check(result: CheckResult, passed: bool | None = None, sentences: Sequence[str] = ()) -> str:
    """Format the result of a check as text.

    passed: verdict that includes the sentences; None: that of the result; sentences: further results, such as a fault.
    """
    passed = result.passed if passed is None else passed
    lines = [
        f"{result.recording} against {result.robot!r}: {result.comparison.samples} samples at {result.rate:.5g} Hz, "
        f"{result.duration:.5g} s, filtered at {result.cutoff:.3g} Hz, {100 * result.coverage:.3g} % of the recorded "
        "time"
    ]
    lines += [f"note: {note}" for note in result.notes]
    rows: list[list[Cell]] = []
    for verdict in result.verdicts:
        joint = verdict.joint
        numbers = (
            joint.rms,
            verdict.tolerance,
            joint.normalised,
            joint.largest,
            joint.at,
            joint.bias,
            joint.correlation,
            joint.scale,
            joint.scale_deviation,
            joint.rms_unfiltered,
            100 * joint.resting or None,
        )
        cells = [_round_finite(number) for number in numbers]
        rows.append([joint.joint, verdict.word, *cells])
    lines.append(format_table(TABLE_HEADER, rows, "Measured minus predicted effort [N m or N]"))
    lines += [f"{verdict.joint.joint}: {failure}" for verdict in result.verdicts for failure in verdict.reasons]
    lines += result.failures
    onset = result.first_failure_time
    since = "" if onset is None else f", out of tolerance since {onset:.4g} s"
    verdict_line = f"passed{_except_for(result.not_judged)}" if passed else f"FAILED{since}"
    return "\n".join([*lines, *sentences, "", verdict_line])


def _except_for(names: Sequence[str]) -> str:
    return f", except for joints that are not judged: {', '.join(names)}" if names else ""


def _round_finite(number: float | None) -> float | None:
    """Round to three digits; None where a number is missing or not finite."""
    return None if number is None or not math.isfinite(number) else round_to_digits(number, 3)
