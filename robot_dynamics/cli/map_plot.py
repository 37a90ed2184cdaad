"""The picture of a pose map: reach, condition number, and the largest effort of any motor."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from robot_dynamics.checking.plot_labels import plain_label
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.pose_map import PoseMap

POSE_CLASSES = {
    "in reach": "#4c9f70",
    "singular: the motors do not hold it": "#c1272d",
    "motors beyond their limits": "#dddddd",
    "out of reach of the legs": "#a6a6a6",
}
POSE_CLASS_COLOURS = list(POSE_CLASSES.values())
LIMIT_LINE: dict[str, Any] = {"color": "black", "linestyle": "--", "linewidth": 0.8}
LEGEND_BESIDE: dict[str, Any] = {"loc": "center left", "bbox_to_anchor": (1, 0.5), "fontsize": "small"}
LEGEND_BELOW: dict[str, Any] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.14), "fontsize": "small", "ncols": 2}


def draw_pose_map(path: str | Path, result: PoseMap, robot: Robot, acceleration: Sequence[float] | None = None) -> None:
    """Draw a pose map over one or two coordinates; acceleration: (6,) of the platform in the map, None: at rest."""
    is_grid = len(result.axes) == 2
    figure = Figure(figsize=(15, 5) if is_grid else (9, 8), layout="constrained")
    rows, columns = (1, 3) if is_grid else (3, 1)
    panels = figure.subplots(rows, columns, sharex=True, sharey=is_grid)
    figure.suptitle(_title(result, robot, acceleration))
    if is_grid:
        _draw_grid(figure, panels, result, robot)
    else:
        _draw_line(panels, result, robot)
    figure.savefig(path, dpi=120)


def _title(result: PoseMap, robot: Robot, acceleration: Sequence[float] | None) -> str:
    coordinates = ", ".join(
        f"{name} = {round(value, 9) + 0.0:.4g} {COORDINATE_UNITS[name]}"
        for name, value in result.fixed_coordinates.items()
    )
    title = f"{plain_label(robot.name)}: platform" + (f" at {coordinates}; " if coordinates else ", ")
    if acceleration is None or not np.any(acceleration):
        return title + "at rest"
    return title + "accelerated by " + " ".join(f"{value:g}" for value in acceleration) + " m/s², rad/s²"


def _draw_grid(figure: Figure, panels: Sequence[Axes], result: PoseMap, robot: Robot) -> None:
    """Draw three panels over two coordinates."""
    classes = _pose_classes(result)
    class_norm = Normalize(-0.5, len(POSE_CLASSES) - 0.5)
    class_colours = ListedColormap(POSE_CLASS_COLOURS)
    first, second = result.axes
    first_limits = _limits_in_range(result, robot, first)
    second_limits = _limits_in_range(result, robot, second)
    _draw_mesh(panels[0], result, classes, class_norm, class_colours)
    panels[0].set_title(f"reach: {result.within_limits.sum()} of {result.within_limits.size} poses")
    panels[0].legend(handles=_legend_handles(classes, bool(first_limits or second_limits)), **LEGEND_BELOW)
    efforts, unit = _largest_efforts(result, robot)
    condition = np.where(result.is_nonsingular, result.condition_number, np.nan)
    for panel, values, title, colours in (
        (panels[1], condition, "condition number", "viridis_r"),
        (panels[2], efforts, f"largest effort of a motor [{unit}]", "plasma"),
    ):
        _draw_mesh(panel, result, np.where(result.is_nonsingular, np.nan, classes), class_norm, class_colours)
        panel.set_title(title)
        if result.is_nonsingular.any():
            figure.colorbar(_draw_mesh(panel, result, values, _colour_norm(values), colours), ax=panel)
    for panel in panels:
        panel.set_xlabel(_axis_label(first))
        for limit in first_limits:
            panel.axvline(limit, **LIMIT_LINE)
        for limit in second_limits:
            panel.axhline(limit, **LIMIT_LINE)
    panels[0].set_ylabel(_axis_label(second))


def _draw_mesh(panel: Axes, result: PoseMap, values: Array, norm: Normalize | None, colours: str | Colormap) -> Any:
    first, second = result.axes.values()
    return panel.pcolormesh(first, second, values.T, shading="nearest", norm=norm, cmap=colours)


def _draw_line(panels: Sequence[Axes], result: PoseMap, robot: Robot) -> None:
    """Draw three panels over one coordinate."""
    (name,) = result.axes
    values = np.asarray(result.axes[name], dtype=float)
    classes = _pose_classes(result)
    limits = _limits_in_range(result, robot, name)
    panels[0].plot(values, np.where(result.is_nonsingular, result.condition_number, np.nan), color="#35608d")
    if isinstance(_colour_norm(result.condition_number[result.is_nonsingular]), LogNorm):
        panels[0].set_yscale("log")
    panels[0].set_ylabel("condition number")
    for k, joint in enumerate(result.joint_names):
        prismatic = robot.joints[robot.joint_numbers[joint]].prismatic
        label = plain_label(joint)
        panels[1].plot(values, result.efforts[:, k], label=f"{label} [{'N' if prismatic else 'N m'}]")
        panels[2].plot(values, result.positions[:, k], label=f"{label} [{'m' if prismatic else 'rad'}]")
    panels[1].set_ylabel("effort")
    panels[2].set_ylabel("position of the motor")
    panels[2].set_xlabel(_axis_label(name))
    edges = np.concatenate([values[:1], (values[1:] + values[:-1]) / 2, values[-1:]])
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.set_xlim(values[0], values[-1])
        for k, pose_class in enumerate(classes):
            if pose_class:
                panel.axvspan(*edges[k : k + 2], color=POSE_CLASS_COLOURS[int(pose_class)], linewidth=0)
        for limit in limits:
            panel.axvline(limit, **LIMIT_LINE)
    for panel in panels[1:]:
        panel.legend(**LEGEND_BESIDE)
    handles = _legend_handles(classes, bool(limits), first=1)
    if handles:
        panels[0].legend(handles=handles, **LEGEND_BESIDE)


def _pose_classes(result: PoseMap) -> Array:
    """Return the index in POSE_CLASSES of each pose."""
    return np.select([result.is_nonsingular, result.within_limits, result.reachable], [0.0, 1.0, 2.0], 3.0)


def _legend_handles(classes: Array, has_limits: bool, first: int = 0) -> list[Artist]:
    """Return the entries of a legend: the pose classes that occur, from index `first`, and limits."""
    handles: list[Artist] = [
        Patch(color=colour, label=label)
        for k, (label, colour) in enumerate(POSE_CLASSES.items())
        if k >= first and (classes == k).any()
    ]
    if has_limits:
        handles.append(Line2D([], [], label="limits of the platform", **LIMIT_LINE))
    return handles


def _largest_efforts(result: PoseMap, robot: Robot) -> tuple[Array, str]:
    """Return the largest effort of any motor at each pose, nan where there is none, and its unit."""
    prismatic = [robot.joints[robot.joint_numbers[name]].prismatic for name in result.joint_names]
    unit = "N" if all(prismatic) else "N m" if not any(prismatic) else "N or N m"
    efforts = np.abs(np.where(result.is_nonsingular[..., None], result.efforts, 0)).max(axis=-1)
    return np.where(result.is_nonsingular, efforts, np.nan), unit


def _colour_norm(values: Array) -> Normalize | None:
    """Return the colour scale of values that are not negative: logarithmic if they span more than a decade."""
    finite = values[np.isfinite(values)]
    if not len(finite):
        return None
    norm = LogNorm if finite.max() > 10 * finite.min() > 0 else Normalize
    return norm(finite.min(), max(finite.max(), 1.01 * finite.min()))


def _limits_in_range(result: PoseMap, robot: Robot, name: str) -> list[float]:
    """Return the limits of a coordinate in the description that lie within the map."""
    if robot.platform is None:
        return []
    limits = robot.joints[robot.platform.joints[COORDINATES.index(name)]].limits
    values = np.asarray(result.axes[name], dtype=float)
    return [limit for limit in (limits.lower, limits.upper) if values[0] < limit < values[-1]]


def _axis_label(coordinate: str) -> str:
    return f"{coordinate} [{COORDINATE_UNITS[coordinate]}]"
