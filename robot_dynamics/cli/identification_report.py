"""Results of an identification as tables and as plain data."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.text_table import print_table, round_to_digits

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.identification.drive_gains import DriveGains
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.sample_sums import FitQuality

MAX_EXPRESSION_LENGTH = 60


def print_fit(fit: Fit, essential: BoolArray, consistent_quality: FitQuality | None) -> None:
    """Print a fit.

    essential: (P,) which parameters are essential; consistent_quality: residuals of the physically consistent robot,
    None if there is none.
    """
    model = fit.model
    base_count = len(model.parameter_indices)
    print(
        f"{model.inertial_count} base parameters with {base_count - model.inertial_count} of friction and "
        f"{len(model.names) - base_count} of drives, {fit.method} least squares over {fit.training_quality.samples} "
        f"samples, condition number {fit.condition:.3g}"
    )
    for note in fit.notes:
        print(f"note: {note}")
    for warning in fit.warnings:
        print(f"warning: {warning}")
    _print_residuals(fit, consistent_quality)
    rows: list[list[Cell]] = []
    for expression, value, deviation, is_essential in zip(
        model.expressions, fit.values, fit.standard_deviations, essential, strict=True
    ):
        name = textwrap.shorten(expression, MAX_EXPRESSION_LENGTH, placeholder=" ...")
        rows.append([name, round_to_digits(value, 4), round_to_digits(deviation, 2), "" if is_essential else "no"])
    print_table(["parameter", "value", "deviation", "essential"], rows, "Parameters, SI")


def print_gains(gains: DriveGains) -> None:
    """Print drive gains."""
    rows: list[list[Cell]] = [
        [name, round_to_digits(gain, 5), round_to_digits(deviation, 2)]
        for name, gain, deviation in zip(
            gains.drives.names, gains.drives.effort_gains, gains.standard_deviations, strict=True
        )
    ]
    print_table(["motor", "gain", "deviation"], rows, "Drive gains: motor efforts per measured value")


def as_dict(
    fit: Fit, essential: BoolArray, consistent_quality: FitQuality | None, gains: DriveGains | None = None
) -> dict[str, object]:
    """Convert results to plain data for JSON; arguments as for `print_fit`."""
    model = fit.model
    parameters = [
        {
            "name": name,
            "sum": expression,
            "value": float(value),
            "deviation": float(deviation),
            "essential": bool(is_essential),
        }
        for name, expression, value, deviation, is_essential in zip(
            model.names, model.expressions, fit.values, fit.standard_deviations, essential, strict=True
        )
    ]
    return {
        "format": 1,
        "robot": model.dynamics.robot.name,
        "joints": list(model.dynamics.joint_names),
        "method": fit.method,
        "condition": fit.condition,
        "inertial": model.inertial_count,
        "parameters": parameters,
        "trained": _quality_as_dict(fit.training_quality),
        "validated": _quality_as_dict(fit.validation_quality),
        "consistent": _quality_as_dict(consistent_quality),
        "warnings": list(fit.warnings),
        "notes": list(fit.notes),
        "gains": None if gains is None else _gains_as_dicts(gains),
    }


def _print_residuals(fit: Fit, consistent_quality: FitQuality | None) -> None:
    """Print the RMS residuals of each joint."""
    training = fit.training_quality
    validation = fit.validation_quality
    columns: list[tuple[str, Array | None]] = [
        ("RMS", training.rms),
        ("RMS/spread", training.rms / training.spread),
        ("unfiltered", training.rms_unfiltered),
        ("validated", None if validation is None else validation.rms),
        ("validated, unfiltered", None if validation is None else validation.rms_unfiltered),
        ("consistent", None if consistent_quality is None else consistent_quality.rms),
    ]
    rows: list[list[Cell]] = []
    for index, name in enumerate(fit.model.dynamics.joint_names):
        cells = [None if values is None else round_to_digits(values[index], 3) for _, values in columns]
        rows.append([name, *cells])
    print_table(["joint", *(title for title, _ in columns)], rows, "Measured minus fitted effort [N m or N]")


def _quality_as_dict(quality: FitQuality | None) -> dict[str, object] | None:
    if quality is None:
        return None
    return {key: np.asarray(value).tolist() for key, value in vars(quality).items()}


def _gains_as_dicts(gains: DriveGains) -> list[dict[str, object]]:
    return [
        {"name": name, "gain": float(gain), "deviation": float(deviation)}
        for name, gain, deviation in zip(
            gains.drives.names, gains.drives.effort_gains, gains.standard_deviations, strict=True
        )
    ]
