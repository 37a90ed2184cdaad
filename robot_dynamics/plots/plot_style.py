"""The style of all pictures of Matplotlib: readable in print, in grey, and by those who do not tell colours apart.

Figures are as wide as a page or a column, so that their letters keep their size in print.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from matplotlib import style
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.rcsetup import cycler

from robot_dynamics.plots.plot_colours import COLOURS

if TYPE_CHECKING:
    from pathlib import Path

PAGE_WIDTH = 7.1
"""Width of a page between its margins [inch]."""
RESOLUTION = 160
"""Pixels of an inch."""
LINE_STYLES = ("-", "--", "-.", ":", (0, (5, 1, 1, 1)), (0, (2, 1)))
STYLE: dict[str, Any] = {
    "font.size": 8.0,
    "axes.titlesize": 8.5,
    "axes.labelsize": 8.0,
    "figure.titlesize": 9.5,
    "figure.titleweight": "bold",
    "legend.fontsize": 7.5,
    "legend.framealpha": 0.9,
    "xtick.labelsize": 7.5,
    "ytick.labelsize": 7.5,
    "axes.prop_cycle": cycler(color=COLOURS, linestyle=LINE_STYLES),
    "lines.linewidth": 1.2,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.alpha": 0.35,
    "grid.linewidth": 0.5,
    "hatch.linewidth": 0.5,
    "image.cmap": "viridis",
    "pdf.fonttype": 42,  # letters, not curves: text that can be found and copied
    "svg.fonttype": "path",  # as it is drawn here, whatever fonts a reader has
    "svg.hashsalt": "robot_dynamics",  # the same figure gives the same file
}


@contextmanager
def plot_style() -> Iterator[None]:
    """Use the style in a block, or in a function as ``@plot_style()``, whatever the settings of the user are."""
    with style.context(["default", STYLE]):
        yield


def new_figure(width: float, height: float) -> Figure:
    """Return an empty figure [inch] for a file: no window, and nothing that pyplot keeps."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def save_figure(figure: Figure, path: str | Path, file_format: str | None = None) -> None:
    """Write a figure: a picture of points, or letters and lines for .pdf and .svg.

    Parameters
    ----------
    figure : Figure
    path : str or Path
    file_format : str, optional
        Default: the ending of the path.
    """
    ending = file_format or str(path).rpartition(".")[2].lower()
    # no date: the same figure gives the same file
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(ending)
    figure.savefig(path, dpi=RESOLUTION, format=file_format, metadata=metadata)
