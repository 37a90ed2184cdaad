"""The figures of a check as PNG files, by Matplotlib."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

MEASURED, PREDICTED, RESIDUAL, FAULT = "#1f6fb4", "#e07b00", "#57606a", "#d1242f"


def write_figures(check, folder):
    """Write `efforts.png`, `histograms.png` and `friction.png` of a Check into a folder; their Paths."""
    folder.mkdir(parents=True, exist_ok=True)
    times, measured, predicted, velocities = check.comparison.plot_samples
    n = len(check.verdicts)
    efforts = Figure(figsize=(11, 1.9 * n), layout="constrained")
    for column, (axes, verdict) in enumerate(zip(efforts.subplots(n, 2, sharex=True, squeeze=False), check.verdicts,
                                                 strict=True)):  # fmt: skip
        axes[0].plot(times, measured[:, column], color=MEASURED, lw=0.8, label="measured")
        axes[0].plot(times, predicted[:, column], color=PREDICTED, lw=0.8, label="predicted")
        axes[1].plot(times, measured[:, column] - predicted[:, column], color=RESIDUAL, lw=0.8)
        axes[1].axhspan(-verdict.tolerance, verdict.tolerance, color=RESIDUAL, alpha=0.1)
        for segment in check.segments:
            if segment.joint == verdict.joint.joint:
                axes[1].axvspan(segment.start, segment.end, color=FAULT, alpha=0.2)
        axes[0].set_title(f"{verdict.joint.joint}: {'passed' if verdict.passed else 'FAILED'}", fontsize=9)
        axes[1].set_title(f"residual, RMS {verdict.joint.rms:.3g}, tolerated {verdict.tolerance:.3g}", fontsize=9)
    efforts.axes[0].legend(fontsize=8)
    efforts.supxlabel("time [s]")
    residuals = measured - predicted
    histograms = _grid(n, check, lambda axis, column: axis.hist(residuals[:, column], bins=60, color=RESIDUAL))
    histograms.supxlabel("residual [N m or N]")
    friction = _grid(n, check, lambda axis, column: axis.plot(velocities[:, column], residuals[:, column], ".", ms=1.5))
    friction.supxlabel("velocity [rad/s or m/s]")
    friction.supylabel("residual [N m or N]")
    paths = []
    for name, figure in (("efforts", efforts), ("histograms", histograms), ("friction", friction)):
        FigureCanvasAgg(figure)
        paths.append(folder / f"{name}.png")
        figure.savefig(paths[-1], dpi=110)
    return paths


def _grid(n, check, draw):
    rows = int(np.ceil(n / 3))
    figure = Figure(figsize=(11, 2.6 * rows), layout="constrained")
    axes = figure.subplots(rows, 3, squeeze=False).ravel()
    for column, verdict in enumerate(check.verdicts):
        draw(axes[column], column)
        axes[column].set_title(verdict.joint.joint, fontsize=9)
    for axis in axes[n:]:
        axis.axis("off")
    return figure
