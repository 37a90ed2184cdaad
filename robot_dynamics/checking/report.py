"""The report of a check: one HTML file that opens without network, with figures to zoom in."""

from html import escape

from robot_dynamics.checking.figures import FAULT, MEASURED, PREDICTED, RESIDUAL
from robot_dynamics.optional_packages import import_optional

TABLE_HEADER = ("joint", "verdict", "RMS", "tolerated", "RMS / spread", "largest", "at [s]", "bias", "correlation", "scale",
        "RMS unfiltered", "what is wrong")  # fmt: skip
MAX_POINTS = 1500  # of a joint: each is an element of the page
STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2328; max-width: 1180px; margin: 2rem auto; padding: 0 1rem }
h1 { font-size: 1.6rem; margin: 0 } h2 { font-size: 1.15rem; margin: 2.2rem 0 .4rem } p { margin: .3rem 0 }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; font-size: 14px }
th { text-align: right; font-weight: 600; border-bottom: 2px solid #d0d7de; padding: .3rem .5rem }
td { text-align: right; border-bottom: 1px solid #eaeef2; padding: .3rem .5rem }
th:first-child, td:first-child, th:last-child, td:last-child { text-align: left }
.badge { border-radius: 1rem; padding: .1rem .7rem; color: white; font-weight: 600; font-size: 13px }
.passed { background: #1a7f37 } .failed { background: #d1242f } .quiet { color: #57606a }
"""


def import_plotly(module):
    """A module of the package that draws. Raises MissingPackageError."""
    return import_optional(f"plotly.{module}", "a report")


def html_report(check):
    """The text of the HTML file. Raises MissingPackageError where plotly is not installed."""
    figures = [(f"joint-{column}", _joint_figure(check, column)) for column in range(len(check.verdicts))]
    figures += [("histograms", _histograms(check)), ("friction", _friction(check))]
    titles = [verdict.joint.joint for verdict in check.verdicts]
    titles += [
        "Residuals: how often which",
        "Residuals over velocity: what looks like a step at zero or a slope is friction",
    ]
    parts = [
        "<!doctype html><html lang='en'><head><meta charset='utf-8'>",
        f"<title>{escape(check.recording)} against {escape(check.robot)}</title>",
        f"<link rel='icon' href='data:,'><style>{STYLE}</style>",
        f"<script>{import_plotly('offline').get_plotlyjs()}</script></head><body>",
        f"<h1>{escape(check.recording)} {_badge(check.passed)}</h1>",
        f"<p>against robot <b>{escape(check.robot)}</b>: {check.comparison.samples} samples at {check.rate:.5g} Hz, "
        f"{check.duration:.5g} s, filtered at {check.cutoff:.3g} Hz without delay. Efforts in N m (N where a joint "
        "slides); residual is measured less predicted, spread the standard deviation of what was measured.</p>",
        _summary(check), _segments(check), _notes(check),
    ]  # fmt: skip
    for (name, figure), title in zip(figures, titles, strict=True):
        parts.append(f"<h2>{escape(title)}</h2>")
        parts.append(
            figure.to_html(full_html=False, include_plotlyjs=False, div_id=name, config={"displaylogo": False})
        )
    return "\n".join([*parts, "</body></html>"])


def _badge(passed):
    return f"<span class='badge {'passed' if passed else 'failed'}'>{'passed' if passed else 'failed'}</span>"


def _summary(check):
    rows = []
    for verdict in check.verdicts:
        joint = verdict.joint
        numbers = (joint.rms, verdict.tolerance, joint.normalised, joint.largest, joint.at, joint.bias,
                   joint.correlation, joint.scale, joint.rms_unfiltered)  # fmt: skip
        cells = [escape(joint.joint), _badge(verdict.passed), *(f"{number:.3g}" for number in numbers),
                 escape("; ".join(verdict.failures))]  # fmt: skip
        rows.append("".join(f"<td>{cell}</td>" for cell in cells))
    head = "".join(f"<th>{title}</th>" for title in TABLE_HEADER)
    return f"<h2>Joints</h2><table id='joints'><tr>{head}</tr>{''.join(f'<tr>{row}</tr>' for row in rows)}</table>"


def _segments(check):
    if not check.segments:
        return "<p class='quiet'>No second is out of tolerance.</p>"
    ordered = sorted(check.segments, key=lambda segment: segment.start)
    rows = "".join(f"<tr><td>{escape(s.joint)}</td><td>{s.start:.4g}</td><td>{s.end:.4g}</td><td>{s.rms:.3g}</td></tr>"
                   for s in ordered)  # fmt: skip
    head = "<tr><th>joint</th><th>from [s]</th><th>to [s]</th><th>RMS</th></tr>"
    return f"<h2>Out of tolerance</h2><table id='segments'>{head}{rows}</table>"


def _notes(check):
    if not check.notes:
        return "<p class='quiet'>Nothing of the recording was left out.</p>"
    return f"<h2>Left out or filled in</h2><ul>{''.join(f'<li>{escape(note)}</li>' for note in check.notes)}</ul>"


def _joint_figure(check, column):
    go, subplots = import_plotly("graph_objects"), import_plotly("subplots")
    times, measured, predicted, _ = check.comparison.plot_samples
    verdict = check.verdicts[column]
    figure = subplots.make_subplots(rows=2, cols=1, shared_xaxes=True, vertical_spacing=0.06, row_heights=[0.6, 0.4])
    for row, values, name, colour in (
        (1, measured[:, column], "measured", MEASURED),
        (1, predicted[:, column], "predicted", PREDICTED),
        (2, measured[:, column] - predicted[:, column], "residual", RESIDUAL),
    ):
        figure.add_trace(go.Scatter(x=times, y=values, name=name, mode="lines", line={"color": colour, "width": 1.2}),
                         row=row, col=1)  # fmt: skip
    figure.add_hrect(-verdict.tolerance, verdict.tolerance, row=2, col=1, fillcolor=RESIDUAL, opacity=0.1, line_width=0)
    for segment in check.segments:
        if segment.joint == verdict.joint.joint:
            figure.add_vrect(segment.start, segment.end, fillcolor=FAULT, opacity=0.15, line_width=0)
    figure.update_xaxes(title_text="time [s]", row=2, col=1)
    return _styled(figure, 420)


def _histograms(check):
    _, measured, predicted, _ = check.comparison.plot_samples
    Histogram = import_plotly("graph_objects").Histogram
    return _grid(check, lambda column: Histogram(x=(measured - predicted)[:, column], nbinsx=80,
                                                    marker_color=RESIDUAL))  # fmt: skip


def _friction(check):
    _, measured, predicted, velocities = check.comparison.plot_samples
    some = slice(None, None, max(1, len(measured) // MAX_POINTS))
    Scatter = import_plotly("graph_objects").Scatter
    return _grid(check, lambda column: Scatter(
        x=velocities[some, column], y=(measured - predicted)[some, column], mode="markers",
        marker={"size": 3, "color": MEASURED}))  # fmt: skip


def _grid(check, trace):
    n = len(check.verdicts)
    rows = -(-n // 3)
    titles = [verdict.joint.joint for verdict in check.verdicts]
    figure = import_plotly("subplots").make_subplots(rows=rows, cols=3, subplot_titles=titles)
    for column in range(n):
        figure.add_trace(trace(column), row=1 + column // 3, col=1 + column % 3)
    figure.update_layout(showlegend=False)
    return _styled(figure, 240 * rows)


def _styled(figure, height):
    return figure.update_layout(template="plotly_white", height=height, margin={"l": 50, "r": 20, "t": 30, "b": 40})
