"""The picture of a map of natural frequencies, with a panel for each frequency and one colour scale for all."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.parallel.pose_map import COORDINATE_UNITS
from robot_dynamics.plots.colour_scale import fit_scale
from robot_dynamics.plots.map_labels import axis_label
from robot_dynamics.plots.plot_labels import plain_label
from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure, plot_style, save_figure
from robot_dynamics.plots.pose_classes import HATCHES, POSE_CLASS_COLOURS
from robot_dynamics.plots.pose_map_plot import draw_scale, draw_values

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from robot_dynamics.flexible.frequency_map import FrequencyMap
    from robot_dynamics.plots.colour_scale import ColourScale

COLUMNS = 3


@plot_style()
def draw_frequency_map(
    path: str | Path, frequencies: FrequencyMap, name: str, scale: ColourScale | None = None
) -> None:
    """Draw a map over two coordinates into a file.

    Parameters
    ----------
    path : str or Path
        Its ending is the format.
    frequencies : FrequencyMap
    name : str
        Name of the robot.
    scale : ColourScale, optional
        Of all frequencies [Hz]. Default: their range in round numbers.
    """
    save_figure(frequency_map_figure(frequencies, name, scale), path)


def frequency_map_figure(
    frequencies: FrequencyMap, name: str, scale: ColourScale | None = None, panels: int | None = None
) -> Figure:
    """Return the figure of `draw_frequency_map`, with at most some panels, to be drawn within `plot_style`."""
    first, second = frequencies.axes
    count = frequencies.frequencies.shape[-1] if panels is None else min(panels, frequencies.frequencies.shape[-1])
    columns = min(COLUMNS, count)
    rows = -(-count // columns)
    scale = scale or fit_scale(frequencies.frequencies)
    figure = new_figure(PAGE_WIDTH if columns > 1 else PAGE_WIDTH / 2, 2.4 * rows + 0.3)
    grid = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for k, axes in enumerate(grid.flat):
        if k >= count:
            axes.set_visible(False)
            continue
        axes.set_facecolor(POSE_CLASS_COLOURS[-1])
        axes.patch.set(hatch=HATCHES[-1], edgecolor="0.4")
        axes.grid(False)
        mesh = draw_values(axes, tuple(frequencies.axes.values()), frequencies.frequencies[..., k], scale)
        axes.set(title=f"frequency {k + 1} [Hz]" if count > 1 else "[Hz]", xlabel=axis_label(first))
        if COORDINATE_UNITS[first] == COORDINATE_UNITS[second]:
            axes.set_aspect("equal")
    draw_scale(figure, mesh, grid, frequencies.frequencies, scale)
    for row in grid:
        row[0].set_ylabel(axis_label(second))
    hidden = "" if np.isfinite(frequencies.frequencies[..., 0]).all() else "; dotted: out of reach"
    title = f"Natural frequencies of {plain_label(name)}" if name else "Natural frequencies"
    figure.suptitle(title + hidden)
    return figure
