"""How much of a recording was compared: a verdict on a small part of it says little."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from robot_dynamics.checking.tolerances import Tolerances
    from robot_dynamics.checking.verdicts import Verdict


NOTHING_JUDGED = "no joint can be judged"


def compute_coverage(compared: float, recorded: float) -> float:
    """Part of a recorded duration [s] that was compared [s], 0 to 1; 1 where nothing is known to be recorded."""
    return min(1.0, compared / recorded) if recorded > 0 else 1.0


def coverage_failure(coverage: float, tolerances: Tolerances) -> str:
    """Why a coverage, 0 to 1, is no pass; empty where it is."""
    if coverage >= tolerances.min_coverage:
        return ""
    return (
        f"{100 * coverage:.3g} % of the recorded time was compared, {100 * tolerances.min_coverage:.3g} % is needed: "
        "the notes say what was skipped"
    )


def recording_failures(coverage: float, verdicts: Sequence[Verdict], tolerances: Tolerances) -> Iterator[str]:
    """Yield the reasons why a recording fails although none of its joints does."""
    failure = coverage_failure(coverage, tolerances)
    if failure:
        yield failure
    if all(verdict.not_judged for verdict in verdicts):
        yield NOTHING_JUDGED
