"""The check of a recording as HTML: the verdicts, and measured and predicted efforts."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.notebook.markup import block, heading, paragraph, table
from robot_dynamics.notebook.plots import figure_picture

if TYPE_CHECKING:
    from lxml.html import HtmlElement
    from matplotlib.figure import Figure

    from robot_dynamics.checking.check import CheckResult
    from robot_dynamics.notebook.markup import Cell

HEADER = ("joint", "verdict", "RMS", "tolerated", "largest", "scale", "correlation", "reason")


def check_html(check: CheckResult) -> HtmlElement:
    """Return the verdicts on the joints, the failures, and the efforts over time."""
    words = {True: "passed", False: "FAILED", None: "not judged"}
    title = f"{check.recording} against {check.robot}: {words[check.passed_or_not_judged]}"
    rows: list[list[Cell]] = []
    for verdict in check.verdicts:
        joint = verdict.joint
        numbers = (joint.rms, verdict.tolerance, joint.largest, joint.scale, joint.correlation)
        rows.append([joint.joint, verdict.word, *map(float, numbers), "; ".join(verdict.reasons)])

    def make() -> Figure:
        from robot_dynamics.checking.figures import effort_figure

        return effort_figure(check)

    lines = [*check.failures, *check.notes]
    return block(heading(title), table(HEADER, rows), *map(paragraph, lines), figure_picture(make, title))
