"""The picture of a PoseMap: where the platform can be, condition number, and the largest effort of any motor."""

import numpy as np
from matplotlib.colors import ListedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS

POSE_CLASSES = {
    "in reach": "#4c9f70",
    "singular: the motors do not hold it": "#c1272d",
    "motors beyond their limits": "#dddddd",
    "out of reach of the legs": "#a6a6a6",
}
LIMIT_LINE = {"color": "black", "linestyle": "--", "linewidth": 0.8}


def draw_pose_map(path, found, robot, acceleration=None):
    """Draw a PoseMap over one coordinate or two; acceleration: as pose_map was asked."""
    two = len(found.axes) == 2
    figure = Figure(figsize=(15, 5) if two else (9, 8), layout="constrained")
    panels = figure.subplots(*((1, 3) if two else (3, 1)), sharex=True, sharey=two)
    figure.suptitle(_title(found, robot, acceleration))
    if two:
        _draw_grid(figure, panels, found, robot)
    else:
        _draw_line(panels, found, robot)
    figure.savefig(path, dpi=120)


def _title(found, robot, acceleration):
    stands = ", ".join(
        f"{name} = {round(value, 9) + 0.0:.4g} {COORDINATE_UNITS[name]}"
        for name, value in found.fixed_coordinates.items()
    )
    title = f"{robot.name}: platform" + (f" at {stands}; " if stands else ", ")
    if acceleration is None or not np.any(acceleration):
        return title + "at rest"
    return title + "accelerated by " + " ".join(f"{value:g}" for value in acceleration) + " m/s², rad/s²"


def _draw_grid(figure, panels, found, robot):
    kinds, names = _kinds(found), list(found.axes)
    of_kinds = Normalize(-0.5, len(POSE_CLASSES) - 0.5), ListedColormap(list(POSE_CLASSES.values()))
    _fill(panels[0], found, kinds, *of_kinds)
    panels[0].set_title(f"reach: {found.within_limits.sum()} of {found.within_limits.size} poses")
    told = _told(kinds, any(_limits(found, robot, name) for name in names))
    panels[0].legend(handles=told, loc="upper center", bbox_to_anchor=(0.5, -0.14), fontsize="small", ncols=2)
    efforts, unit = _largest(found, robot)
    condition = np.where(found.is_nonsingular, found.condition_number, np.nan)
    for panel, values, title, norm, colours in (
        (panels[1], condition, "condition number", _colours(condition), "viridis_r"),
        (panels[2], efforts, f"largest effort of a motor [{unit}]", _colours(efforts), "plasma"),
    ):
        _fill(panel, found, np.where(found.is_nonsingular, np.nan, kinds), *of_kinds)
        panel.set_title(title)
        if found.is_nonsingular.any():
            figure.colorbar(_fill(panel, found, values, norm, colours), ax=panel)
    for panel in panels:
        panel.set_xlabel(f"{names[0]} [{COORDINATE_UNITS[names[0]]}]")
        for limit in _limits(found, robot, names[0]):
            panel.axvline(limit, **LIMIT_LINE)
        for limit in _limits(found, robot, names[1]):
            panel.axhline(limit, **LIMIT_LINE)
    panels[0].set_ylabel(f"{names[1]} [{COORDINATE_UNITS[names[1]]}]")


def _fill(panel, found, values, norm, colours):
    return panel.pcolormesh(*found.axes.values(), values.T, shading="nearest", norm=norm, cmap=colours)


def _draw_line(panels, found, robot):
    (name, values), kinds = next(iter(found.axes.items())), _kinds(found)
    panels[0].plot(values, np.where(found.is_nonsingular, found.condition_number, np.nan), color="#35608d")
    if isinstance(_colours(found.condition_number[found.is_nonsingular]), LogNorm):
        panels[0].set_yscale("log")
    panels[0].set_ylabel("condition number")
    for k, joint in enumerate(found.joint_names):
        kind = robot.joints[robot.joint_numbers[joint]].prismatic
        panels[1].plot(values, found.efforts[:, k], label=f"{joint} [{'N' if kind else 'N m'}]")
        panels[2].plot(values, found.positions[:, k], label=f"{joint} [{'m' if kind else 'rad'}]")
    panels[1].set_ylabel("effort")
    panels[2].set_ylabel("position of the motor")
    panels[2].set_xlabel(f"{name} [{COORDINATE_UNITS[name]}]")
    edges = np.concatenate([values[:1], (values[1:] + values[:-1]) / 2, values[-1:]])
    for panel in panels:
        panel.grid(alpha=0.3)
        panel.set_xlim(values[0], values[-1])
        for k, kind in enumerate(kinds):
            if kind:
                panel.axvspan(*edges[k : k + 2], color=list(POSE_CLASSES.values())[int(kind)], linewidth=0)
        for limit in _limits(found, robot, name):
            panel.axvline(limit, **LIMIT_LINE)
    for panel in panels[1:]:
        panel.legend(loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small")
    told = _told(kinds, bool(_limits(found, robot, name)), first=1)
    if told:
        panels[0].legend(handles=told, loc="center left", bbox_to_anchor=(1, 0.5), fontsize="small")


def _kinds(found):
    """Which of KINDS each pose is."""
    return np.select([found.is_nonsingular, found.within_limits, found.reachable], [0.0, 1.0, 2.0], 3.0)


def _told(kinds, limited, first=0):
    """What stands in a legend: the KINDS that there are, from the first on, and limits."""
    there = [
        Patch(color=colour, label=kind)
        for k, (kind, colour) in enumerate(POSE_CLASSES.items())
        if k >= first and (kinds == k).any()
    ]
    return there + [Line2D([], [], label="limits of the platform", **LIMIT_LINE)] * limited


def _largest(found, robot):
    """(the largest effort of any motor, nan where there is none, its unit)."""
    slides = [robot.joints[robot.joint_numbers[name]].prismatic for name in found.joint_names]
    unit = "N" if all(slides) else "N m" if not any(slides) else "N or N m"
    return np.where(
        found.is_nonsingular, np.abs(np.where(found.is_nonsingular[..., None], found.efforts, 0)).max(axis=-1), np.nan
    ), unit


def _colours(values):
    """Colours of numbers that are not negative: by their logarithm where they go over more than a decade."""
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    norm = LogNorm if known.max() > 10 * known.min() > 0 else Normalize
    return norm(known.min(), max(known.max(), 1.01 * known.min()))


def _limits(found, robot, name):
    """Limits of a coordinate that the description gives, as far as they are in the picture."""
    limits, values = robot.joints[robot.platform.joints[COORDINATES.index(name)]].limits, found.axes[name]
    return [limit for limit in (limits.lower, limits.upper) if values[0] < limit < values[-1]]
