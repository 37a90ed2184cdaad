"""The picture of what a motion costs: parts of the limits that are used, and power, over time."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from robot_dynamics.plots.plot_colours import COLOURS
from robot_dynamics.plots.plot_labels import plain_label
from robot_dynamics.plots.plot_limits import LIMIT_LINE
from robot_dynamics.plots.plot_style import LINE_STYLES, PAGE_WIDTH, new_figure, plot_style, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from robot_dynamics.array_types import Array
    from robot_dynamics.motions.motion_cost import MotionCost

LEGEND_BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1, 0.5)}


@plot_style()
def draw_motion_cost(path: Path, cost: MotionCost, title: str) -> None:
    """Draw efforts and speeds relative to their limits, and powers, into a file, whose ending is the format."""
    figure = new_figure(PAGE_WIDTH, 6.5)
    figure.suptitle(plain_label(title))
    efforts, speeds, powers = figure.subplots(3, 1, sharex=True)
    names = [plain_label(actuator.name) for actuator in cost.actuators]
    _draw_usages(efforts, cost.times, 100 * cost.effort_usages, names, "effort [% of the limit]")
    _draw_usages(speeds, cost.times, 100 * cost.speed_usages, names, "speed [% of the limit]")
    for column, joint in enumerate(cost.joints):
        powers.plot(cost.times, cost.powers[:, column], label=plain_label(joint.name), **_line(column))
    powers.plot(cost.times, cost.powers.sum(axis=1), color="grey", linestyle="-", linewidth=2, label="all joints")
    powers.set_ylabel("power [W]")
    powers.set_xlabel("time [s]")
    powers.legend(**LEGEND_BESIDE)
    powers.set_xlim(cost.times[0], cost.times[-1])
    save_figure(figure, path)


def _line(column: int) -> dict[str, Any]:
    """Colour and dashes of the line of an actuator: a colour that comes again has other dashes."""
    rounds, place = divmod(column, len(COLOURS))
    return {"color": COLOURS[place], "linestyle": LINE_STYLES[(place + rounds) % len(LINE_STYLES)]}


def _draw_usages(axes: Axes, times: Array, percentages: Array, names: list[str], label: str) -> None:
    """Draw the parts of limits (N, c) that are used; actuators without a limit use none."""
    for column, name in enumerate(names):
        axes.plot(times, percentages[:, column], label=name, **_line(column))
    axes.axhline(100, **LIMIT_LINE)
    axes.set_ylim(bottom=0)
    axes.set_ylabel(label)
    axes.legend(**LEGEND_BESIDE)
