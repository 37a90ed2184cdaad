"""Limits of joints in plots of positions, velocities and efforts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.plots.limit_distance import is_near

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LIMIT_LINE: dict[str, Any] = {"color": "0.25", "linestyle": (0, (6, 2)), "linewidth": 0.9}
NOTE: dict[str, Any] = {
    "ha": "right",
    "va": "top",
    "fontsize": "small",
    "color": "0.25",
}
NOTE_ROOM = 0.16
"""Height of a note, relative to the range of the axis."""
LABEL = "limit"


def draw_limits(axes: Axes, lower: float, upper: float, unit: str) -> None:
    """Draw limits of what is plotted along y; limits that are far away are written above the curves.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With the curves.
    lower, upper : float
        Limits, infinite where there is none.
    unit : str
        Unit of the limits.
    """
    view = np.array(axes.get_ylim())
    far = []
    for limit in (lower, upper):
        if not np.isfinite(limit):
            continue
        if is_near(limit, view):
            is_first = LABEL not in axes.get_legend_handles_labels()[1]
            axes.axhline(limit, label=LABEL if is_first else None, **LIMIT_LINE)
        else:
            far.append(limit)
    is_symmetric = bool(np.isclose(lower, -upper))
    if len(far) == 2 or (far and not is_symmetric):  # of symmetric limits one line says all
        text = f"±{far[1]:.4g}" if is_symmetric else ", ".join(f"{limit:.4g}" for limit in far)
        note = f"limit{'s' if len(far) == 2 and not is_symmetric else ''} {text} {unit}"
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + NOTE_ROOM * (high - low))
        axes.text(0.98, 0.98 - 0.11 * len(axes.texts), note, transform=axes.transAxes, **NOTE)
