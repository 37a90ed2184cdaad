"""Drawings of natural frequencies: maps as self-contained HTML files and as PNG files."""

from __future__ import annotations

from html import escape
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robot_dynamics.checking.plot_labels import plain_label
from robot_dynamics.optional_packages import import_optional
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS

if TYPE_CHECKING:
    from robot_dynamics.flexible.frequency_map import FrequencyMap


def import_plotly() -> ModuleType:
    """Import the module of plotly that draws. Raises MissingPackageError."""
    return import_optional("plotly.graph_objects", "a picture in HTML")


def map_html(name: str, frequencies: FrequencyMap) -> str:
    """Draw a map over two coordinates as HTML, with a menu that selects one of the frequencies."""
    go = import_plotly()
    (first, first_values), (second, second_values) = frequencies.axes.items()
    figure = go.Figure()
    for k in range(frequencies.frequencies.shape[-1]):
        figure.add_trace(
            go.Heatmap(
                x=first_values,
                y=second_values,
                z=frequencies.frequencies[..., k].T,
                visible=k == 0,
                colorbar={"title": "Hz"},
                hovertemplate=f"{first} %{{x:.4g}}<br>{second} %{{y:.4g}}<br>%{{z:.4g}} Hz<extra></extra>",
            )
        )
    count = len(figure.data)
    buttons = [
        {"label": f"f{k + 1}", "method": "update", "args": [{"visible": [n == k for n in range(count)]}]}
        for k in range(count)
    ]
    figure.update_layout(
        title=f"Natural frequencies of {escape(name)}",
        template="plotly_white",
        width=820,
        height=700,
        updatemenus=[{"buttons": buttons, "x": 1.0, "y": 1.1}],
        xaxis={"title": _axis_label(first)},
        yaxis={"title": _axis_label(second)},
    )
    if COORDINATE_UNITS[first] == COORDINATE_UNITS[second]:
        figure.update_yaxes(scaleanchor="x")
    return _page(figure, f"{name}: natural frequencies")


def save_map_png(name: str, frequencies: FrequencyMap, path: str | Path) -> None:
    """Draw a map over two coordinates into a PNG file, with one panel per frequency."""
    (first, first_values), (second, second_values) = frequencies.axes.items()
    count = frequencies.frequencies.shape[-1]
    columns = min(3, count)
    rows = -(-count // columns)
    figure = Figure(figsize=(4.2 * columns, 3.6 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    for k, axes in enumerate(figure.subplots(rows, columns, squeeze=False).flat):
        if k >= count:
            axes.set_visible(False)
            continue
        mesh = axes.pcolormesh(first_values, second_values, frequencies.frequencies[..., k].T, shading="nearest")
        figure.colorbar(mesh, ax=axes, label="Hz")
        axes.set(title=f"f{k + 1}", xlabel=_axis_label(first), ylabel=_axis_label(second))
        if COORDINATE_UNITS[first] == COORDINATE_UNITS[second]:
            axes.set_aspect("equal")
    figure.suptitle(f"Natural frequencies of {plain_label(name)}")
    figure.savefig(path, dpi=110)


def _axis_label(coordinate: str) -> str:
    return f"{coordinate} [{COORDINATE_UNITS[coordinate]}]"


def _page(figure: Any, title: str) -> str:
    """Return the HTML page of a plotly figure, with a title of the page."""
    text: str = figure.to_html(include_plotlyjs=True, full_html=True, config={"displaylogo": False})
    return text.replace("<head>", f"<head><title>{escape(title)}</title>", 1)
