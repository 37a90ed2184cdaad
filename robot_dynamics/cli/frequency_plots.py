"""Maps of frequencies and moving modes as HTML files that need nothing else, by Plotly; maps as PNG by Matplotlib."""

from html import escape

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robot_dynamics.optional_packages import import_optional
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS

FRAMES = 24
DEFLECTION = 0.12  # of the size of the robot, to which modes are drawn


def import_plotly():
    """The module of plotly that draws. Raises MissingPackageError."""
    return import_optional("plotly.graph_objects", "a picture in HTML")


def _page(figure, title):
    text = figure.to_html(include_plotlyjs=True, full_html=True, config={"displaylogo": False})
    return text.replace("<head>", f"<head><title>{escape(title)}</title>", 1)


def map_html(name, found):
    """The HTML of a FrequencyMap over two coordinates: one frequency at a time, which a menu chooses."""
    go = import_plotly()
    (first, rows), (second, columns) = found.axes.items()
    figure = go.Figure()
    for k in range(found.frequencies.shape[-1]):
        figure.add_trace(go.Heatmap(
            x=rows, y=columns, z=found.frequencies[..., k].T, visible=k == 0, colorbar={"title": "Hz"},
            hovertemplate=f"{first} %{{x:.4g}}<br>{second} %{{y:.4g}}<br>%{{z:.4g}} Hz<extra></extra>",
        ))  # fmt: skip
    count = len(figure.data)
    buttons = [{"label": f"f{k + 1}", "method": "update", "args": [{"visible": [n == k for n in range(count)]}]}
               for k in range(count)]  # fmt: skip
    figure.update_layout(
        title=f"Natural frequencies of {escape(name)}", template="plotly_white", width=820, height=700,
        updatemenus=[{"buttons": buttons, "x": 1.0, "y": 1.1}],
        xaxis={"title": f"{first} [{COORDINATE_UNITS[first]}]"}, yaxis={"title": f"{second} [{COORDINATE_UNITS[second]}]"},
    )  # fmt: skip
    if COORDINATE_UNITS[first] == COORDINATE_UNITS[second]:
        figure.update_yaxes(scaleanchor="x")
    return _page(figure, f"{name}: natural frequencies")


def save_map_png(name, found, path):
    """Writes a FrequencyMap over two coordinates as a PNG: a field for each frequency."""
    (first, rows), (second, columns) = found.axes.items()
    count = found.frequencies.shape[-1]
    across = min(3, count)
    figure = Figure(figsize=(4.2 * across, 3.6 * -(-count // across)), layout="constrained")
    FigureCanvasAgg(figure)
    for k, axes in enumerate(figure.subplots(-(-count // across), across, squeeze=False).flat):
        if k >= count:
            axes.set_visible(False)
            continue
        shown = axes.pcolormesh(rows, columns, found.frequencies[..., k].T, shading="nearest")
        figure.colorbar(shown, ax=axes, label="Hz")
        axes.set(
            title=f"f{k + 1}",
            xlabel=f"{first} [{COORDINATE_UNITS[first]}]",
            ylabel=f"{second} [{COORDINATE_UNITS[second]}]",
        )
        if COORDINATE_UNITS[first] == COORDINATE_UNITS[second]:
            axes.set_aspect("equal")
    figure.suptitle(f"Natural frequencies of {name}")
    figure.savefig(path, dpi=110)


def mode_html(name, title, rests, moves, segments):
    """The HTML of a mode that swings.

    rests, moves: (nodes, 3) [m] where the nodes are and how they move, to any scale; segments: pairs of nodes.
    """
    go = import_plotly()
    size, largest = np.ptp(rests, axis=0).max(), np.abs(moves).max()
    moves = moves * (DEFLECTION * size / largest if largest > 0 else 0.0)
    ends = np.array([[a, b, -1] for a, b in segments]).ravel()

    def drawn(share, colour, width):
        points = np.vstack([rests + share * moves, np.full(3, np.nan)])[ends]  # nan: between two segments
        x, y, z = (values.round(6) for values in points.T)
        return go.Scatter3d(x=x, y=y, z=z, mode="lines", line={"color": colour, "width": width}, hoverinfo="skip")

    swing = [drawn(np.sin(2 * np.pi * k / FRAMES), "#1f6fb4", 6) for k in range(FRAMES)]
    figure = go.Figure(
        data=[drawn(0.0, "#c0c4c8", 3), swing[FRAMES // 4]],
        frames=[go.Frame(data=[line], traces=[1], name=str(k)) for k, line in enumerate(swing)],
    )
    playing = {"frame": {"duration": 50, "redraw": True}, "mode": "immediate", "fromcurrent": True}
    paused = {"frame": {"duration": 0}, "mode": "immediate"}
    reach = [rests.min(axis=0) - 1.2 * DEFLECTION * size, rests.max(axis=0) + 1.2 * DEFLECTION * size]
    sides = {
        f"{axis}axis": {"range": [reach[0][k], reach[1][k]], "title": f"{axis} [m]"} for k, axis in enumerate("xyz")
    }
    figure.update_layout(
        title=f"{escape(name)}: {escape(title)}", showlegend=False, template="plotly_white", width=900, height=760,
        scene={**sides, "aspectmode": "data"},
        updatemenus=[{"type": "buttons", "buttons": [
            {"label": "play", "method": "animate", "args": [None, playing]},
            {"label": "pause", "method": "animate", "args": [[None], paused]},
        ]}],
    )  # fmt: skip
    return _page(figure, f"{name}: {title}")
