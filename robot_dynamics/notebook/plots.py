"""Plots in notebooks, where Matplotlib is installed."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING

from robot_dynamics.notebook.markup import paragraph, picture

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from lxml.html import HtmlElement
    from matplotlib.figure import Figure

    from robot_dynamics.array_types import Array

RESOLUTION = 100
"""Pixels of an inch."""
PANEL_HEIGHT = 1.7
"""[inch]"""
MAX_CURVES = 12
MAX_SAMPLES = 2000


def figure_picture(make: Callable[[], Figure], description: str) -> HtmlElement:
    """Return a figure as a picture, or a line that says what to install.

    Parameters
    ----------
    make : callable
        Makes the figure, in the style of all pictures.
    description : str
        For those who do not see the picture.
    """
    try:
        from robot_dynamics.plots.plot_style import plot_style  # here: Matplotlib is an extra
    except ModuleNotFoundError as error:
        return paragraph(f"A plot needs {error.name}: pip install 'robot_dynamics[plots]'")
    stream = io.BytesIO()
    with plot_style():
        make().savefig(stream, format="png", dpi=RESOLUTION)
    return picture(stream.getvalue(), description)


def curves(quantities: Mapping[str, Array], x: Array, x_label: str) -> Figure:
    """Return a figure with a panel for each quantity (N, n) over x (N,): a curve for each joint.

    Only MAX_CURVES joints are drawn, and every k-th sample of long batches.
    """
    from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure

    figure = new_figure(PAGE_WIDTH, PANEL_HEIGHT * max(1, len(quantities)) + 0.3)
    panels = figure.subplots(max(1, len(quantities)), 1, sharex=True, squeeze=False)[:, 0]
    step = slice(None, None, max(1, len(x) // MAX_SAMPLES))
    for panel, (name, values) in zip(panels, quantities.items(), strict=False):
        for joint in range(min(MAX_CURVES, values.shape[-1])):
            panel.plot(x[step], values[step, joint], label=str(joint + 1))
        panel.set_ylabel(name)
    panels[-1].set_xlabel(x_label)
    panels[0].legend(title="joint", loc="center left", bbox_to_anchor=(1, 0.5))
    return figure
