"""The figures of a check as PNG files, by Matplotlib: Plotly, which the report uses, needs a browser to write PNG."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from robot_dynamics.checking.plot_colours import FAILED, MEASURED, PREDICTED, RESIDUAL
from robot_dynamics.checking.plot_labels import plain_label
from robot_dynamics.file_output import replaced_file

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.check import CheckResult

COLUMNS = 3  # of a grid of joints


def write_figures(check: CheckResult, folder: Path) -> list[Path]:
    """Write `efforts.png`, `histograms.png` and `friction.png` of a check into a folder; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {
        "efforts": _draw_efforts(check),
        "histograms": _draw_histograms(check),
        "friction": _draw_friction(check),
    }
    paths = []
    for name, figure in figures.items():
        FigureCanvasAgg(figure)
        path = folder / f"{name}.png"
        with replaced_file(path) as file:
            figure.savefig(file, dpi=110)
        paths.append(path)
    return paths


def _draw_efforts(check: CheckResult) -> Figure:
    """Measured and predicted efforts over time on the left, residuals on the right, a row for each joint."""
    times, measured, predicted, _, _ = check.comparison.plot_samples
    n = len(check.verdicts)
    figure = Figure(figsize=(11, 1.9 * n), layout="constrained")
    rows = figure.subplots(n, 2, sharex=True, squeeze=False)
    for column, (axes, verdict) in enumerate(zip(rows, check.verdicts, strict=True)):
        joint = verdict.joint
        axes[0].plot(times, measured[:, column], color=MEASURED, lw=0.8, label="measured")
        axes[0].plot(times, predicted[:, column], color=PREDICTED, lw=0.8, label="predicted")
        axes[0].set_title(f"{plain_label(joint.joint)}: {verdict.word}", fontsize=9)
        axes[1].plot(times, measured[:, column] - predicted[:, column], color=RESIDUAL, lw=0.8)
        axes[1].axhspan(-verdict.tolerance, verdict.tolerance, color=RESIDUAL, alpha=0.1)
        axes[1].set_title(f"residual, RMS {joint.rms:.3g}, tolerated {verdict.tolerance:.3g}", fontsize=9)
        for segment in check.segments:
            if segment.joint == joint.joint:
                axes[1].axvspan(segment.start, segment.end, color=FAILED, alpha=0.2)
    figure.axes[0].legend(fontsize=8)
    figure.supxlabel("time [s]")
    return figure


def _draw_histograms(check: CheckResult) -> Figure:
    """Histograms of the residuals."""
    residuals = _moving_residuals(check)
    figure = _draw_grid(check, lambda axes, column: _draw_histogram(axes, residuals[:, column]))
    figure.supxlabel("residual [N m or N]")
    return figure


def _draw_histogram(axes: Axes, values: Array) -> None:
    axes.hist(values[np.isfinite(values)], bins=60, color=RESIDUAL)


def _draw_friction(check: CheckResult) -> Figure:
    """Residuals over velocity."""
    velocities = check.comparison.plot_samples.velocities
    residuals = _moving_residuals(check)
    figure = _draw_grid(check, lambda axes, column: axes.plot(velocities[:, column], residuals[:, column], ".", ms=1.5))
    figure.supxlabel("velocity [rad/s or m/s]")
    figure.supylabel("residual [N m or N]")
    return figure


def _moving_residuals(check: CheckResult) -> Array:
    """Residuals (K, n) of the samples for figures; nan where the joint rests."""
    samples = check.comparison.plot_samples
    return np.where(samples.moving, samples.measured - samples.predicted, np.nan)


def _draw_grid(check: CheckResult, draw: Callable[[Axes, int], object]) -> Figure:
    """A figure with axes for each joint; draw: called with the axes and the number of the joint."""
    n = len(check.verdicts)
    rows = int(np.ceil(n / COLUMNS))
    figure = Figure(figsize=(11, 2.6 * rows), layout="constrained")
    grid = figure.subplots(rows, COLUMNS, squeeze=False).ravel()
    for column, verdict in enumerate(check.verdicts):
        draw(grid[column], column)
        grid[column].set_title(plain_label(verdict.joint.joint), fontsize=9)
    for axes in grid[n:]:
        axes.axis("off")
    return figure
