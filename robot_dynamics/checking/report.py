"""The report of a check: one HTML file that opens without network, with figures to zoom in, by Plotly.

Matplotlib, which `figures` uses, draws no figures that a browser can zoom.
"""

from __future__ import annotations

from collections.abc import Callable
from html import escape
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.optional_packages import import_optional
from robot_dynamics.plots.limit_distance import is_near
from robot_dynamics.plots.plot_colours import FAILED, MEASURED, PREDICTED, RESIDUAL

if TYPE_CHECKING:
    from plotly.basedatatypes import BaseTraceType
    from plotly.graph_objects import Figure

    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import CheckResult
    from robot_dynamics.checking.verdicts import Verdict

TABLE_HEADER = (
    "joint",
    "verdict",
    "RMS",
    "tolerated",
    "RMS / spread",
    "largest",
    "at [s]",
    "bias",
    "correlation",
    "scale",
    "deviation",
    "RMS unfiltered",
    "at rest",
    "reason",
)
MAX_POINTS = 1500  # points of a joint over velocity: each is an element of the page
COLUMNS = 3  # of a grid of joints
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2328; max-width: 1180px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem; margin: 0 } h2 { font-size: 1.15rem; margin: 2.2rem 0 .4rem } p { margin: .3rem 0 }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 14px }
th { text-align: right; font-weight: 600; border-bottom: 2px solid #d0d7de; padding: .3rem .5rem }
td { text-align: right; border-bottom: 1px solid #eaeef2; padding: .3rem .5rem }
th:first-child, td:first-child, th:last-child, td:last-child { text-align: left }
.badge { border-radius: 1rem; padding: .1rem .7rem; color: white; font-weight: 600; font-size: 13px }
.passed { background: #1a7f37 } .failed { background: #d1242f }
.not-judged { background: #6e7781 } .quiet { color: #57606a }
"""


def import_plotly(module: str) -> ModuleType:
    """A module of Plotly. Raises MissingPackageError."""
    return import_optional(f"plotly.{module}", "a report")


def html_report(check: CheckResult) -> str:
    """The text of the HTML file. Raises MissingPackageError where Plotly is not installed."""
    figures = [
        (f"joint-{column}", verdict.joint.joint, _joint_figure(check, column))
        for column, verdict in enumerate(check.verdicts)
    ]
    figures.append(("histograms", "Histograms of residuals", _histograms(check)))
    friction_title = "Residuals over velocity: a step at zero or a slope indicates friction"
    figures.append(("friction", friction_title, _friction(check)))
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>",
        f"<title>{escape(check.recording)} against {escape(check.robot)}</title>",
        f"<link rel='icon' href='data:,'><style>{STYLE}</style>",
        f"<script>{import_plotly('offline').get_plotlyjs()}</script></head><body>",
        f"<h1>{escape(check.recording)} {_badge(_overall_word(check))}</h1>",
        f"<p>against robot <b>{escape(check.robot)}</b>: {check.comparison.samples} samples at {check.rate:.5g} Hz, "
        f"{check.duration:.5g} s, filtered at {check.cutoff:.3g} Hz without delay, {100 * check.coverage:.3g} % of the "
        "recorded time. Efforts are in N m (N for prismatic joints). The residual is measured less predicted effort, "
        "both filtered; the spread is the standard deviation of the measured effort. Samples at which a joint rests do "
        "not count.</p>",
        *(f"<p><b>{escape(failure)}</b></p>" for failure in check.failures),
        _joint_table(check),
        _segment_table(check),
        _note_list(check),
    ]
    for name, title, figure in figures:
        parts.append(f"<h2>{escape(title)}</h2>")
        parts.append(
            figure.to_html(full_html=False, include_plotlyjs=False, div_id=name, config={"displaylogo": False})
        )
    return "\n".join([*parts, "</body></html>"])


def _overall_word(check: CheckResult) -> str:
    passed = check.passed_or_not_judged
    return "not judged" if passed is None else "passed" if passed else "failed"


def _badge(word: str) -> str:
    """A verdict: passed, failed or not judged."""
    return f"<span class='badge {word.replace(' ', '-')}'>{word}</span>"


def _joint_table(check: CheckResult) -> str:
    header = "".join(f"<th>{title}</th>" for title in TABLE_HEADER)
    rows = "".join(f"<tr>{_joint_row(verdict)}</tr>" for verdict in check.verdicts)
    return f"<h2>Joints</h2><table id='joints'><tr>{header}</tr>{rows}</table>"


def _joint_row(verdict: Verdict) -> str:
    joint = verdict.joint
    numbers = (*verdict.numbers, joint.resting)
    cells = [
        escape(joint.joint),
        _badge(verdict.word.lower()),
        *(f"{number:.3g}" for number in numbers),
        escape("; ".join(verdict.reasons)),
    ]
    return "".join(f"<td>{cell}</td>" for cell in cells)


def _segment_table(check: CheckResult) -> str:
    if not check.segments:
        return "<p class='quiet'>No second is out of tolerance.</p>"
    segments = sorted(check.segments, key=lambda segment: segment.start)
    header = "<tr><th>joint</th><th>from [s]</th><th>to [s]</th><th>RMS</th></tr>"
    rows = "".join(
        f"<tr><td>{escape(s.joint)}</td><td>{s.start:.4g}</td><td>{s.end:.4g}</td><td>{s.rms:.3g}</td></tr>"
        for s in segments
    )
    return f"<h2>Out of tolerance</h2><table id='segments'>{header}{rows}</table>"


def _note_list(check: CheckResult) -> str:
    if not check.notes:
        return "<p class='quiet'>No samples were skipped or replaced.</p>"
    notes = "".join(f"<li>{escape(note)}</li>" for note in check.notes)
    return f"<h2>Skipped or replaced samples</h2><ul>{notes}</ul>"


def _joint_figure(check: CheckResult, column: int) -> Figure:
    """Efforts over time, and the residual below, with the tolerance and the segments that exceed it."""
    go = import_plotly("graph_objects")
    times, measured, predicted, _, _ = check.comparison.plot_samples
    verdict = check.verdicts[column]
    figure = import_plotly("subplots").make_subplots(
        rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.6, 0.4]
    )
    for row, values, name, colour in (
        (1, measured[:, column], "measured", MEASURED),
        (1, predicted[:, column], "predicted", PREDICTED),
        (2, measured[:, column] - predicted[:, column], "residual", RESIDUAL),
    ):
        line = {"color": colour, "width": 1.2}
        figure.add_trace(go.Scatter(x=times, y=values, name=name, mode="lines", line=line), row=row, col=1)
    figure.add_hrect(-verdict.tolerance, verdict.tolerance, row=2, col=1, fillcolor=RESIDUAL, opacity=0.1, line_width=0)
    for segment in check.segments:
        if segment.joint == verdict.joint.joint:
            figure.add_vrect(segment.start, segment.end, fillcolor=FAILED, opacity=0.15, line_width=0)
    _draw_limit(figure, check, column)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    return _set_layout(figure, 420)


def _draw_limit(figure: Figure, check: CheckResult, column: int) -> None:
    """Write the unit and the limit of the effort of a joint, and draw the limit where it is near the curves."""
    if not check.joints:
        return
    joint = check.joints[column]
    unit = "N" if joint.prismatic else "N m"
    limit = joint.limits.effort
    figure.update_yaxes(title_text=f"residual [{unit}]", row=2, col=1)
    has_limit = np.isfinite(limit)
    figure.update_yaxes(title_text=f"effort [{unit}]" + (f"<br>limit ±{limit:.4g}" if has_limit else ""), row=1, col=1)
    samples = check.comparison.plot_samples
    efforts = np.concatenate([samples.measured[:, column], samples.predicted[:, column]])
    efforts = efforts[np.isfinite(efforts)]
    # one that is far away would flatten the curves: plotly fits the axis to lines too
    near = [value for value in (-limit, limit) if has_limit and len(efforts) and is_near(value, efforts)]
    for value in near:
        figure.add_hline(value, row=1, col=1, line={"color": RESIDUAL, "dash": "longdash", "width": 1})


def _histograms(check: CheckResult) -> Figure:
    residuals = _moving_residuals(check)
    Histogram = import_plotly("graph_objects").Histogram
    return _grid(check, lambda column: Histogram(x=residuals[:, column], nbinsx=80, marker_color=RESIDUAL))


def _friction(check: CheckResult) -> Figure:
    """Residuals over velocity, of MAX_POINTS samples or a few more."""
    velocities = check.comparison.plot_samples.velocities
    rows = slice(None, None, max(1, len(velocities) // MAX_POINTS))
    residuals = _moving_residuals(check)[rows]
    Scatter = import_plotly("graph_objects").Scatter
    marker = {"size": 3, "color": MEASURED}
    return _grid(
        check,
        lambda column: Scatter(x=velocities[rows, column], y=residuals[:, column], mode="markers", marker=marker),
    )


def _moving_residuals(check: CheckResult) -> Array:
    """Residuals (K, n) of the samples for figures; nan where the joint rests."""
    samples = check.comparison.plot_samples
    return np.where(samples.moving, samples.measured - samples.predicted, np.nan)


def _grid(check: CheckResult, make_trace: Callable[[int], BaseTraceType]) -> Figure:
    """A figure with a plot for each joint; make_trace: called with the number of the joint."""
    n = len(check.verdicts)
    rows = -(-n // COLUMNS)
    titles = [verdict.joint.joint for verdict in check.verdicts]
    figure = import_plotly("subplots").make_subplots(rows=rows, cols=COLUMNS, subplot_titles=titles)
    for column in range(n):
        figure.add_trace(make_trace(column), row=1 + column // COLUMNS, col=1 + column % COLUMNS)
    figure.update_layout(showlegend=False)
    return _set_layout(figure, 240 * rows)


def _set_layout(figure: Figure, height: int) -> Figure:
    return figure.update_layout(template="plotly_white", height=height, margin={"l": 50, "r": 20, "t": 30, "b": 40})
