"""Maps over poses as pages for a browser: the pose and its values under the cursor, by Plotly, without a network."""

from __future__ import annotations

from html import escape
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.optional_packages import import_optional
from robot_dynamics.parallel.pose_map import COORDINATE_UNITS
from robot_dynamics.plots.colour_scale import CONDITION_SCALE, fit_scale
from robot_dynamics.plots.map_labels import axis_label, fixed_text, map_title
from robot_dynamics.plots.plot_colours import COLOURS, CONDITION_COLOURS, EFFORT_COLOURS
from robot_dynamics.plots.pose_classes import POSE_CLASSES, largest_efforts, pose_classes

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.flexible.frequency_map import FrequencyMap
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.pose_map import PoseMap
    from robot_dynamics.plots.colour_scale import ColourScale

COLOUR_BARS = {"viridis": "Viridis", "viridis_r": "Viridis_r", "cividis": "Cividis"}


def import_plotly(module: str = "graph_objects") -> ModuleType:
    """Import a module of plotly. Raises MissingPackageError."""
    return import_optional(f"plotly.{module}", "a picture in HTML")


def pose_map_page(
    result: PoseMap,
    robot: Robot,
    acceleration: Sequence[float] | None = None,
    condition_scale: ColourScale = CONDITION_SCALE,
    effort_scale: ColourScale | None = None,
) -> str:
    """Return the page of a pose map, with the arguments of `draw_pose_map`. Raises MissingPackageError."""
    draw = _pose_grid if len(result.axes) == 2 else _pose_line
    figure = draw(result, robot, condition_scale, effort_scale)
    title = map_title("", result.fixed_coordinates, acceleration)
    figure.update_layout(title=f"{_plain(robot.name)}: {title}", template="plotly_white")
    return _page(figure, f"{robot.name}: {title}")


def frequency_map_page(frequencies: FrequencyMap, name: str, scale: ColourScale | None = None) -> str:
    """Return the page of a map of frequencies, with a menu that selects one, and one colour scale for all.

    Parameters
    ----------
    frequencies : FrequencyMap
    name : str
        Name of the robot.
    scale : ColourScale, optional
        Of all frequencies [Hz]. Default: their range in round numbers.

    Raises
    ------
    MissingPackageError
        plotly is not installed.
    """
    figure = import_plotly().Figure()
    scale = scale or fit_scale(frequencies.frequencies)
    count = frequencies.frequencies.shape[-1]
    pose = _pose_text(frequencies.axes, frequencies.fixed_coordinates)
    for k in range(count):
        hover = f"{pose}<br>frequency {k + 1}: %{{customdata:.4g}} Hz<extra></extra>"
        values = frequencies.frequencies[..., k]
        figure.add_trace(_heatmap(frequencies.axes, values, values, scale, "viridis", "Hz", hover))
        figure.data[-1].visible = k == 0
    buttons = [
        {"label": f"frequency {k + 1}", "method": "update", "args": [{"visible": [n == k for n in range(count)]}]}
        for k in range(count)
    ]
    (first, second), fixed = frequencies.axes, fixed_text(frequencies.fixed_coordinates)
    figure.update_layout(
        title=f"Natural frequencies of {_plain(name)}" + (f" at {fixed}" if fixed else ""),
        template="plotly_white",
        width=820,
        height=700,
        plot_bgcolor=POSE_CLASSES["out of reach of the legs"],
        updatemenus=[{"buttons": buttons, "x": 1.0, "y": 1.1}],
        xaxis={"title": axis_label(first), "showgrid": False, "zeroline": False, "constrain": "domain"},
        yaxis={"title": axis_label(second), "showgrid": False, "zeroline": False},
    )
    if COORDINATE_UNITS[first] == COORDINATE_UNITS[second]:
        figure.update_yaxes(scaleanchor="x")
    return _page(figure, f"{name}: natural frequencies")


def _pose_grid(result: PoseMap, robot: Robot, condition_scale: ColourScale, effort_scale: ColourScale | None) -> Any:
    """Return a figure of two panels over two coordinates: condition number and largest effort."""
    efforts, unit = largest_efforts(result, robot)
    condition = np.where(result.is_nonsingular, result.condition_number, np.nan)
    titles = ("condition number", f"largest effort of a motor [{unit}]")
    figure = import_plotly("subplots").make_subplots(
        rows=1, cols=2, subplot_titles=titles, shared_yaxes=True, horizontal_spacing=0.14
    )
    pose = _pose_text(result.axes, result.fixed_coordinates)
    hover = f"{pose}<br>condition number: %{{customdata[0]:.4g}}<br>largest effort: %{{customdata[1]:.4g}} {unit}"
    numbers = np.stack([condition, efforts], axis=-1)
    classes = pose_classes(result)
    for column, (values, scale, colours, place) in enumerate(
        [
            (condition, condition_scale, CONDITION_COLOURS, 0.43),
            (efforts, effort_scale or fit_scale(efforts), EFFORT_COLOURS, 1.0),
        ],
        start=1,
    ):
        for number, (name, colour) in enumerate(POSE_CLASSES.items()):
            if number and (classes == number).any():
                trace = _class_trace(result.axes, classes == number, colour, f"{pose}<br>{name}<extra></extra>")
                figure.add_trace(trace, row=1, col=column)
        trace = _heatmap(result.axes, values, numbers, scale, colours, "", f"{hover}<extra></extra>")
        trace.colorbar.x = place
        figure.add_trace(trace, row=1, col=column)
    for number, (name, colour) in enumerate(POSE_CLASSES.items()):
        if number and (classes == number).any():  # those in reach have the colours of the scales
            figure.add_trace(_legend_entry(name, colour))
    first, second = result.axes
    figure.update_xaxes(title=axis_label(first), showgrid=False, zeroline=False)
    figure.update_yaxes(showgrid=False, zeroline=False)
    figure.update_yaxes(title=axis_label(second), col=1)
    figure.update_layout(width=1150, height=600, showlegend=True, legend={"orientation": "h", "y": -0.15})
    return figure


def _pose_line(result: PoseMap, robot: Robot, condition_scale: ColourScale, effort_scale: ColourScale | None) -> Any:
    """Return a figure of three panels over one coordinate."""
    (name,) = result.axes
    go = import_plotly()
    titles = ("condition number", "effort [N or N m]", "position of the motor [m or rad]")
    figure = import_plotly("subplots").make_subplots(
        rows=3,
        cols=1,
        shared_xaxes=True,
        subplot_titles=titles,
        vertical_spacing=0.07,
    )
    x = np.asarray(result.axes[name], dtype=float)
    condition = np.where(result.is_nonsingular, result.condition_number, np.nan)
    line = {"color": COLOURS[0]}
    trace = go.Scatter(x=x, y=condition, name="condition number", showlegend=False, line=line)
    figure.add_trace(trace, row=1, col=1)
    for row, values in ((2, result.efforts), (3, result.positions)):
        for k, joint in enumerate(result.joint_names):
            line = {"color": COLOURS[k % len(COLOURS)]}
            trace = go.Scatter(x=x, y=values[:, k], name=_plain(joint), showlegend=row == 2, line=line)
            figure.add_trace(trace, row=row, col=1)
    figure.update_traces(hovertemplate="%{y:.4g}")
    figure.update_xaxes(hoverformat=".4g")
    figure.update_xaxes(title=axis_label(name), row=3)
    ranges = ((1, condition_scale if condition_scale != CONDITION_SCALE else None), (2, effort_scale))
    for row, scale in ranges:
        if scale is not None:
            figure.update_yaxes(range=list(scale), row=row)
    figure.update_layout(width=950, height=800, hovermode="x unified")
    return figure


def _heatmap(
    axes: Mapping[str, ArrayLike],
    values: Array,
    numbers: Array,
    scale: ColourScale,
    colours: str,
    unit: str,
    hover: str,
) -> Any:
    """Return the colours of values (k, m); numbers: (k, m, ...) for the text under the cursor."""
    x, y = (np.asarray(coordinates, dtype=float) for coordinates in axes.values())
    with np.errstate(divide="ignore"):
        scaled, marks, ends = (
            (np.log10(array) if scale.is_logarithmic else np.asarray(array))
            for array in (values, scale.levels, np.array(scale, dtype=float))
        )
    bar = {"title": unit, "tickvals": marks, "ticktext": [f"{level:.6g}" for level in scale.levels], "thickness": 18}
    return import_plotly().Heatmap(
        x=x,
        y=y,
        z=scaled.T,
        zmin=ends[0],
        zmax=ends[1],
        customdata=np.swapaxes(numbers, 0, 1),
        colorscale=COLOUR_BARS[colours],
        colorbar=bar,
        hoverongaps=False,
        hovertemplate=hover,
    )


def _class_trace(axes: Mapping[str, ArrayLike], is_member: Array, colour: str, hover: str) -> Any:
    """Return the poses of a class in one colour."""
    x, y = (np.asarray(coordinates, dtype=float) for coordinates in axes.values())
    return import_plotly().Heatmap(
        x=x,
        y=y,
        z=np.where(is_member, 0.0, np.nan).T,
        colorscale=[[0, colour], [1, colour]],
        showscale=False,
        hoverongaps=False,
        hovertemplate=hover,
    )


def _legend_entry(name: str, colour: str) -> Any:
    """Return a trace without points, whose class of poses is in the legend."""
    marker = {"color": colour, "size": 12, "symbol": "square"}
    return import_plotly().Scatter(x=[None], y=[None], mode="markers", marker=marker, name=name)


def _pose_text(axes: Mapping[str, ArrayLike], fixed_coordinates: Mapping[str, float]) -> str:
    """Return the pose under the cursor, with places for the two coordinates that vary."""
    first, second = axes
    varied = f"{first}: %{{x:.4g}} {COORDINATE_UNITS[first]}<br>{second}: %{{y:.4g}} {COORDINATE_UNITS[second]}"
    fixed = fixed_text(fixed_coordinates)
    return varied + (f"<br>{fixed}" if fixed else "")


def _plain(name: str) -> str:
    """Return a name as text for plotly, which reads some elements and entities of HTML, but no quotation marks."""
    return escape(name, quote=False)


def _page(figure: Any, title: str) -> str:
    """Return the HTML page of a figure, with a title of the page."""
    text: str = figure.to_html(include_plotlyjs=True, full_html=True, config={"displaylogo": False})
    return text.replace("<head>", f"<head><title>{escape(title)}</title><link rel='icon' href='data:,'>", 1)
