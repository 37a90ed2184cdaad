"""Maps over poses of platforms as HTML: a summary and the picture."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.notebook.markup import block, heading, number_text, paragraph, table
from robot_dynamics.notebook.plots import figure_picture

if TYPE_CHECKING:
    from lxml.html import HtmlElement
    from matplotlib.figure import Figure

    from robot_dynamics.array_types import Array
    from robot_dynamics.flexible.frequency_map import FrequencyMap
    from robot_dynamics.parallel.pose_map import PoseMap

MAX_PANELS = 6


def pose_map_html(result: PoseMap) -> HtmlElement:
    """Return the summary and the picture of a pose map over one or two coordinates."""
    title = f"Pose map over {', '.join(result.axes)}: {result.within_limits.sum()} of {result.within_limits.size} poses"
    rows = [["condition number", *_range(np.where(result.is_nonsingular, result.condition_number, np.nan))]]
    for k, name in enumerate(result.joint_names):
        rows.append([f"effort of {name} [N m or N]", *_range(result.efforts[..., k])])
    content = [heading(f"{title} in reach"), table(("", "least", "greatest"), rows)]

    def make() -> Figure:
        from robot_dynamics.plots.pose_map_plot import pose_map_figure

        return pose_map_figure(result)

    if len(result.axes) <= 2:
        content.append(figure_picture(make, title))
    return block(*content)


def frequency_map_html(result: FrequencyMap) -> HtmlElement:
    """Return the summary and the picture of a map of natural frequencies over two coordinates."""
    count = result.frequencies.shape[-1]
    title = f"Natural frequencies over {', '.join(result.axes)}: {result.reachable.sum()} of {result.reachable.size}"
    rows = [[f"frequency {k + 1} [Hz]", *_range(result.frequencies[..., k])] for k in range(count)]
    content = [heading(f"{title} poses in reach"), table(("", "least", "greatest"), rows)]

    def make() -> Figure:
        from robot_dynamics.plots.frequency_map_plot import frequency_map_figure

        return frequency_map_figure(result, "", panels=MAX_PANELS)

    if len(result.axes) == 2:
        content.append(figure_picture(make, title))
        content.append(paragraph("One colour scale for all frequencies; dotted: out of reach of the legs."))
    return block(*content)


def _range(values: Array) -> tuple[str, str]:
    """Return the least and the greatest finite value."""
    finite = values[np.isfinite(values)]
    return number_text(finite.min(initial=np.inf)), number_text(finite.max(initial=-np.inf))
