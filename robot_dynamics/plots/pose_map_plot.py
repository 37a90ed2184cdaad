"""The picture of a pose map: reach, condition number, and the largest effort of any motor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib import patheffects
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.plots.colour_scale import CONDITION_SCALE, fit_scale
from robot_dynamics.plots.map_labels import axis_label, fixed_text, map_title
from robot_dynamics.plots.plot_colours import CONDITION_COLOURS, EFFORT_COLOURS
from robot_dynamics.plots.plot_labels import plain_label
from robot_dynamics.plots.plot_limits import draw_limits
from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure, plot_style, save_figure
from robot_dynamics.plots.pose_classes import HATCHES, POSE_CLASS_COLOURS, POSE_CLASSES, largest_efforts, pose_classes

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.cm import ScalarMappable
    from matplotlib.figure import Figure

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.pose_map import PoseMap
    from robot_dynamics.plots.colour_scale import ColourScale

PLATFORM_LIMIT_LINE: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 0.9}
LABEL_EDGE = patheffects.withStroke(linewidth=1.6, foreground="white")
SMALLEST_PART = 0.06
"""Of a map, between two contours."""


@plot_style()
def draw_pose_map(
    path: str | Path,
    result: PoseMap,
    robot: Robot | None = None,
    acceleration: Sequence[float] | None = None,
    condition_scale: ColourScale = CONDITION_SCALE,
    effort_scale: ColourScale | None = None,
) -> None:
    """Draw a pose map over one or two coordinates into a file.

    Parameters
    ----------
    path : str or Path
        Its ending is the format: .png, .pdf, .svg or .jpg.
    result : PoseMap
    robot : Robot, optional
        For the title, units and limits. Default: the picture is without them, and does not say how the platform moves.
    acceleration : (6,) sequence of float, optional
        Of the platform in the map, for the title. Default: at rest.
    condition_scale, effort_scale : ColourScale, optional
        Default: 1 to 100, and the range of the efforts in round numbers.
    """
    figure = pose_map_figure(result, robot, acceleration, condition_scale, effort_scale)
    save_figure(figure, path)


def pose_map_figure(
    result: PoseMap,
    robot: Robot | None = None,
    acceleration: Sequence[float] | None = None,
    condition_scale: ColourScale = CONDITION_SCALE,
    effort_scale: ColourScale | None = None,
) -> Figure:
    """Return the figure of `draw_pose_map`, to be drawn within `plot_style`."""
    is_grid = len(result.axes) == 2
    figure = new_figure(PAGE_WIDTH, 3.3 if is_grid else 6.0)
    rows, columns = (1, 3) if is_grid else (3, 1)
    panels = figure.subplots(rows, columns, sharex=True, sharey=is_grid)
    if robot is None:
        figure.suptitle(
            f"platform at {fixed_text(result.fixed_coordinates)}" if result.fixed_coordinates else "platform"
        )
    else:
        figure.suptitle(map_title(plain_label(robot.name), result.fixed_coordinates, acceleration))
    if is_grid:
        _draw_grid(figure, panels, result, robot, condition_scale, effort_scale)
    else:
        _draw_line(panels, result, robot)
    return figure


def _draw_grid(
    figure: Figure,
    panels: Sequence[Axes],
    result: PoseMap,
    robot: Robot | None,
    condition_scale: ColourScale,
    effort_scale: ColourScale | None,
) -> None:
    """Draw three panels over two coordinates."""
    classes = pose_classes(result)
    first, second = result.axes
    limits = [_limits_in_range(result, robot, name) for name in result.axes]
    panels[0].set_title(f"reach: {result.within_limits.sum()} of {result.within_limits.size} poses")
    _draw_classes(panels[0], result, classes)
    efforts, unit = largest_efforts(result, robot)
    condition = np.where(result.is_nonsingular, result.condition_number, np.nan)
    effort_scale = effort_scale or fit_scale(efforts)
    for panel, values, title, colours, scale in (
        (panels[1], condition, "condition number", CONDITION_COLOURS, condition_scale),
        (panels[2], efforts, f"largest effort of a motor [{unit}]", EFFORT_COLOURS, effort_scale),
    ):
        panel.set_title(title)
        _draw_classes(panel, result, np.where(result.is_nonsingular, np.nan, classes))
        mesh = draw_values(panel, tuple(result.axes.values()), values, scale, colours)
        draw_scale(figure, mesh, panel, values, scale)
    for panel in panels:
        panel.grid(False)
        panel.set_xlabel(axis_label(first))
        for limit in limits[0]:
            panel.axvline(limit, **PLATFORM_LIMIT_LINE)
        for limit in limits[1]:
            panel.axhline(limit, **PLATFORM_LIMIT_LINE)
    panels[0].set_ylabel(axis_label(second))
    handles = _legend_handles(classes, any(limits))
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles))


def draw_values(
    panel: Axes, axes: Sequence[Any], values: Array, scale: ColourScale, colours: str = "viridis"
) -> ScalarMappable:
    """Draw values (k, m) over two coordinates: colours, and contours with their numbers. Returns what has the colours.

    Parameters
    ----------
    panel : Axes
    axes : two array_like, shape (k,) and (m,)
        The coordinates.
    values : ndarray, shape (k, m)
        nan is left out.
    scale : ColourScale
    colours : str
        Name of the colours.
    """
    norm = (LogNorm if scale.is_logarithmic else Normalize)(scale.lower, scale.upper)
    mesh = panel.pcolormesh(*axes, values.T, shading="nearest", norm=norm, cmap=colours, rasterized=True)
    levels = contour_levels(values, scale)
    if levels and min(values.shape) > 1:
        lines = panel.contour(*axes, values.T, levels=levels, colors="black", linewidths=0.6)
        for text in panel.clabel(lines, fmt="%g", fontsize=6.5):
            text.set_path_effects([LABEL_EDGE])
    return mesh


def contour_levels(values: Array, scale: ColourScale) -> list[float]:
    """Return those levels of a scale that divide the map into parts large enough for the numbers of contours."""
    finite = np.sort(values[np.isfinite(values)])
    levels: list[float] = []
    passed = 0
    for level in scale.levels:
        below = int(np.searchsorted(finite, level))
        if min(below - passed, len(finite) - below) > SMALLEST_PART * len(finite):
            levels.append(float(level))
            passed = below
    return levels


def draw_scale(figure: Figure, mesh: ScalarMappable, panels: Any, values: Array, scale: ColourScale) -> None:
    """Draw the colour scale of panels, with a pointed end where values are beyond it."""
    low, high = _range(values)
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}[low < scale.lower, high > scale.upper]
    bar = figure.colorbar(mesh, ax=panels, extend=extend, ticks=scale.levels, format="%g", pad=0.02)
    bar.minorticks_off()


def _range(values: Array) -> tuple[float, float]:
    """Return the least and the greatest of the finite values; (inf, -inf) where there is none."""
    finite = values[np.isfinite(values)]
    return float(finite.min(initial=np.inf)), float(finite.max(initial=-np.inf))


def _draw_classes(panel: Axes, result: PoseMap, classes: Array) -> None:
    """Draw the classes of poses as colours, and as hatches that differ without colour; nan is left out."""
    norm = Normalize(-0.5, len(POSE_CLASSES) - 0.5)
    axes = tuple(result.axes.values())
    colours = ListedColormap(POSE_CLASS_COLOURS)
    panel.pcolormesh(*axes, classes.T, shading="nearest", norm=norm, cmap=colours, rasterized=True)
    for number, hatch in enumerate(HATCHES):
        share = (classes == number).astype(float)
        if hatch and share.any() and min(share.shape) > 1:
            panel.contourf(*axes, share.T, levels=[0.5, 1.5], colors="none", hatches=[hatch])


def _draw_line(panels: Sequence[Axes], result: PoseMap, robot: Robot | None) -> None:
    """Draw three panels over one coordinate."""
    (name,) = result.axes
    values = np.asarray(result.axes[name], dtype=float)
    classes = pose_classes(result)
    panels[0].plot(values, np.where(result.is_nonsingular, result.condition_number, np.nan))
    if fit_scale(result.condition_number[result.is_nonsingular]).is_logarithmic:
        panels[0].set_yscale("log")
    panels[0].set_ylabel("condition number")
    for k, joint in enumerate(result.joint_names):
        effort_unit, position_unit = _units(robot, joint)
        panels[1].plot(values, result.efforts[:, k], label=f"{plain_label(joint)} [{effort_unit}]")
        panels[2].plot(values, result.positions[:, k], label=f"{plain_label(joint)} [{position_unit}]")
    panels[1].set_ylabel("effort")
    panels[2].set_ylabel("position of the motor")
    panels[2].set_xlabel(axis_label(name))
    _draw_motor_limits(panels, result, robot)
    edges = np.concatenate([values[:1], (values[1:] + values[:-1]) / 2, values[-1:]])
    limits = _limits_in_range(result, robot, name)
    for panel in panels:
        panel.set_xlim(values[0], values[-1])
        for k, pose_class in enumerate(classes):
            if pose_class:
                colour, hatch = POSE_CLASS_COLOURS[int(pose_class)], HATCHES[int(pose_class)]
                panel.axvspan(*edges[k : k + 2], linewidth=0, zorder=0.5, facecolor=colour, hatch=hatch)
        for limit in limits:
            panel.axvline(limit, **PLATFORM_LIMIT_LINE)
    for panel in panels[1:]:
        panel.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    handles = _legend_handles(classes, bool(limits), first=1)
    if handles:
        panels[0].legend(handles=handles, loc="center left", bbox_to_anchor=(1, 0.5))


def _draw_motor_limits(panels: Sequence[Axes], result: PoseMap, robot: Robot | None) -> None:
    """Draw the limits of the efforts and positions of the motors, each pair once."""
    if robot is None:
        return
    joints = [robot.joints[robot.joint_numbers[name]] for name in result.joint_names]
    for prismatic in (False, True):
        limits = [joint.limits for joint in joints if joint.prismatic == prismatic]
        for effort in sorted({limit.effort for limit in limits}):
            draw_limits(panels[1], -effort, effort, "N" if prismatic else "N m")
        for lower, upper in sorted({(limit.lower, limit.upper) for limit in limits}):
            draw_limits(panels[2], lower, upper, "m" if prismatic else "rad")


def _units(robot: Robot | None, joint: str) -> tuple[str, str]:
    """Return the units of the effort and the position of a motor."""
    if robot is None:
        return "N m or N", "rad or m"
    return ("N", "m") if robot.joints[robot.joint_numbers[joint]].prismatic else ("N m", "rad")


def _legend_handles(classes: Array, has_limits: bool, first: int = 0) -> list[Artist]:
    """Return the entries of a legend: the pose classes that occur, from index `first`, and limits."""
    handles: list[Artist] = [
        Patch(facecolor=colour, label=label, hatch=HATCHES[k], edgecolor="0.4", linewidth=0)
        for k, (label, colour) in enumerate(POSE_CLASSES.items())
        if k >= first and (classes == k).any()
    ]
    if has_limits:
        handles.append(Line2D([], [], label="limits of the platform", **PLATFORM_LIMIT_LINE))
    return handles


def _limits_in_range(result: PoseMap, robot: Robot | None, name: str) -> list[float]:
    """Return the limits of a coordinate in the description that lie within the map."""
    if robot is None or robot.platform is None:
        return []
    limits = robot.joints[robot.platform.joints[COORDINATES.index(name)]].limits
    values = np.asarray(result.axes[name], dtype=float)
    return [limit for limit in (limits.lower, limits.upper) if values[0] < limit < values[-1]]
