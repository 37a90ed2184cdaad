"""The figures of a check as files, by Matplotlib: Plotly, which the report uses, needs a browser to write pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.file_output import replaced_file
from robot_dynamics.plots.plot_colours import FAILED, MEASURED, PREDICTED, RESIDUAL
from robot_dynamics.plots.plot_labels import plain_label
from robot_dynamics.plots.plot_limits import draw_limits
from robot_dynamics.plots.plot_style import PAGE_WIDTH, new_figure, plot_style, save_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import CheckResult

COLUMNS = 3  # of a grid of joints


@plot_style()
def write_figures(check: CheckResult, folder: Path) -> list[Path]:
    """Write `efforts.png`, `histograms.png` and `friction.png` of a check into a folder; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
        "efforts": effort_figure(check),
        "histograms": _draw_histograms(check),
        "friction": _draw_friction(check),
    }
    paths = []
    for name, figure in figures.items():
        path = folder / f"{name}.png"
        with replaced_file(path) as file:
            save_figure(figure, file)
        paths.append(path)
    return paths


def effort_figure(check: CheckResult) -> Figure:
    """Measured and predicted efforts over time on the left, residuals on the right, a row for each joint."""
    times, measured, predicted, _, _ = check.comparison.plot_samples
    n = len(check.verdicts)
    figure = new_figure(PAGE_WIDTH, 1.4 * n + 0.4)
    rows = figure.subplots(n, 2, sharex=True, squeeze=False)
    for column, (axes, verdict) in enumerate(zip(rows, check.verdicts, strict=True)):
        joint = verdict.joint
        unit = effort_unit(check, column)
        axes[0].plot(times, measured[:, column], "-", color=MEASURED, lw=0.9, label="measured")
        axes[0].plot(times, predicted[:, column], "--", color=PREDICTED, lw=0.9, label="predicted")
        axes[0].set(title=f"{plain_label(joint.joint)}: {verdict.word}", ylabel=f"effort [{unit}]")
        if check.joints:
            limit = check.joints[column].limits.effort
            draw_limits(axes[0], -limit, limit, unit)
        axes[1].plot(times, measured[:, column] - predicted[:, column], "-", color=RESIDUAL, lw=0.9)
        axes[1].axhspan(-verdict.tolerance, verdict.tolerance, color=RESIDUAL, alpha=0.15)
        axes[1].set(title=f"residual: RMS {joint.rms:.3g}, tolerated {verdict.tolerance:.3g}", ylabel=f"[{unit}]")
        for segment in check.segments:
            if segment.joint == joint.joint:
                axes[1].axvspan(segment.start, segment.end, facecolor=FAILED, alpha=0.25, hatch="////")
    handles, labels = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=len(handles))
    figure.supxlabel("time [s]")
    return figure


def effort_unit(check: CheckResult, column: int) -> str:
    """Return the unit of the effort of a joint."""
    if not check.joints:
        return "N m or N"
    return "N" if check.joints[column].prismatic else "N m"


def _draw_histograms(check: CheckResult) -> Figure:
    """Histograms of the residuals."""
    residuals = _moving_residuals(check)
    figure = _draw_grid(check, lambda axes, column: _draw_histogram(axes, residuals[:, column]))
    figure.supxlabel(f"residual [{_common_unit(check)}]")
    figure.supylabel("samples")
    return figure


def _draw_histogram(axes: Axes, values: Array) -> None:
    axes.hist(values[np.isfinite(values)], bins=60, color=RESIDUAL)


def _draw_friction(check: CheckResult) -> Figure:
    """Residuals over velocity."""
    velocities = check.comparison.plot_samples.velocities
    residuals = _moving_residuals(check)

    def draw(axes: Axes, column: int) -> None:
        axes.plot(velocities[:, column], residuals[:, column], ".", ms=1.5, color=MEASURED)

    figure = _draw_grid(check, draw)
    figure.supxlabel(f"velocity [{_common_unit(check, 'm/s', 'rad/s')}]")
    figure.supylabel(f"residual [{_common_unit(check)}]")
    return figure


def _common_unit(check: CheckResult, prismatic: str = "N", revolute: str = "N m") -> str:
    """Return the unit of all joints; both where they differ or are not known."""
    kinds = {joint.prismatic for joint in check.joints} or {False, True}
    return " or ".join(prismatic if kind else revolute for kind in sorted(kinds))


def _moving_residuals(check: CheckResult) -> Array:
    """Residuals (K, n) of the samples for figures; nan where the joint rests."""
    samples = check.comparison.plot_samples
    return np.where(samples.moving, samples.measured - samples.predicted, np.nan)


def _draw_grid(check: CheckResult, draw: Callable[[Axes, int], object]) -> Figure:
    """A figure with axes for each joint; draw: called with the axes and the number of the joint."""
    n = len(check.verdicts)
    rows = int(np.ceil(n / COLUMNS))
    figure = new_figure(PAGE_WIDTH, 1.8 * rows + 0.3)
    grid = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for column, verdict in enumerate(check.verdicts):
        draw(grid[column], column)
        grid[column].set_title(plain_label(verdict.joint.joint))
    for axes in grid[n:]:
        axes.axis("off")
    return figure
