"""Results of an identification as tables and as plain data."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.cli.friction_report import friction_as_dict, print_friction
from robot_dynamics.cli.parameter_rows import describe_negative_values, parameter_rows, print_parameters
from robot_dynamics.cli.recording_notes import merge_notes
from robot_dynamics.cli.text_table import print_table, round_to_digits
from robot_dynamics.identification.validation_verdict import failed_validations, validation_growth

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.cli.friction_report import FrictionResults
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.identification.alternatives import Alternative
    from robot_dynamics.identification.determination import Determination
    from robot_dynamics.identification.drive_gains import DriveGains
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.physical_consistency import WrittenRobot
    from robot_dynamics.identification.sample_sums import FitQuality

MAX_NAMES = 6
RESIDUAL_LEGEND = (
    "written: the physically consistent robot of --output. unconstrained: least squares without physical limits.\n"
    "fitted: RMS on the recordings that were fitted. validated: RMS on data that the fit has not seen.\n"
    "held out: RMS on seconds of the fitted recordings that were left out of the fit one by one.\n"
    "unfiltered: RMS of the unconstrained fit before the filter. spread: standard deviation of the measured effort.\n"
    "Samples at which a joint rests do not count."
)


@dataclass(frozen=True, eq=False)
class IdentificationResults:
    """All that is reported of an identification.

    essential: (P,) which parameters are essential; written: the physically consistent robot with its residuals, None if
    it was not computed; alternatives: simpler models that were tried; gains: None without --gains; friction: None if no
    friction model was tried.
    """

    fit: Fit
    essential: BoolArray
    determination: Determination
    written: WrittenRobot | None
    alternatives: tuple[Alternative, ...]
    gains: DriveGains | None = None
    friction: FrictionResults | None = None
    notes: tuple[str, ...] = ()

    @property
    def written_values(self) -> Array | None:
        """Values (P,) of the parameters of the written robot, None if it was not computed."""
        return None if self.written is None else self.written.consistent.values

    @property
    def validated_pair(self) -> tuple[FitQuality, FitQuality] | None:
        """Residuals on fitted data and on data for validation, of the written robot if there is one."""
        fit = self.fit
        fitted, validated = fit.training_quality, fit.validation_quality
        if self.written is not None:
            fitted, validated = self.written.training_quality, self.written.validation_quality
        return None if validated is None else (fitted, validated)

    @property
    def failed(self) -> list[bool]:
        """Whether the validation of each joint fails; all False without validation."""
        pair = self.validated_pair
        n = len(self.fit.model.dynamics.joint_names)
        return [False] * n if pair is None else failed_validations(*pair).tolist()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the fit, and of joints whose validation is much worse than the fit."""
        pair = self.validated_pair
        if pair is None or not any(self.failed):
            return self.fit.warnings
        growth = validation_growth(*pair)
        names = self.fit.model.dynamics.joint_names
        worse = [
            f"{name} {ratio:.1f} times"
            for name, ratio, is_failed in zip(names, growth, self.failed, strict=True)
            if is_failed
        ]
        warning = (
            f"on data that the fit has not seen the residuals are larger than on fitted data: {', '.join(worse)}. The "
            "robot has changed or carries another load (replay-check compares the residuals with a load), or the fit "
            "describes one recording only: use more recordings"
        )
        return (*self.fit.warnings, warning)


def print_results(results: IdentificationResults) -> None:
    """Print the results of an identification."""
    fit = results.fit
    model = fit.model
    base_count = model.robot_count
    print(
        f"{model.inertial_count} base parameters with {base_count - model.inertial_count} of friction and "
        f"{len(model.names) - base_count} of drives, {fit.method} least squares over {fit.training_quality.samples} "
        f"samples, condition number {fit.condition:.3g}"
    )
    for line in _verdict_lines(results):
        print(line)
    for note in (*merge_notes(fit.notes), *results.notes):
        print(f"note: {note}")
    for warning in results.warnings:
        print(f"warning: {warning}")
    for alternative in results.alternatives:
        print(_describe_alternative(alternative))
    if results.friction is not None:
        print_friction(results.friction, fit)
    _print_residuals(results)
    print(RESIDUAL_LEGEND)
    print_parameters(list(parameter_rows(fit, results.essential, results.written_values)))
    if results.gains is not None:
        _print_gains(results.gains)


def as_dict(results: IdentificationResults) -> dict[str, object]:
    """Convert results to plain data for JSON."""
    fit = results.fit
    model = fit.model
    parameters = [
        {
            "name": row.name,
            "sum": row.expression,
            "value": row.value,
            "deviation": row.deviation,
            "deviation_within_run": row.deviation_within_run,
            "description": row.description,
            "written": row.written,
            "essential": row.is_essential,
            "seen": row.is_seen,
        }
        for row in parameter_rows(fit, results.essential, results.written_values)
    ]
    determination = results.determination
    written = results.written
    pair = results.validated_pair
    return {
        "format": 1,
        "robot": model.dynamics.robot.name,
        "joints": list(model.dynamics.joint_names),
        "method": fit.method,
        "condition": fit.condition,
        "inertial": model.inertial_count,
        "verdict": determination.verdict,
        "prediction_errors": determination.prediction_errors.tolist(),
        "main_unknown_parameters": list(determination.main_parameters),
        "blocks": len(fit.blocks),
        "noise_inflation": fit.noise_inflation,
        "parameters": parameters,
        "trained": _quality_as_dict(fit.training_quality),
        "validated": _quality_as_dict(fit.validation_quality),
        "held_out_rms": fit.held_out_rms.tolist(),
        "consistent": None if written is None else _quality_as_dict(written.training_quality),
        "consistent_validated": None if written is None else _quality_as_dict(written.validation_quality),
        "distance_to_description": None if written is None else written.distance,
        "validation_growth": None if pair is None else np.nan_to_num(validation_growth(*pair)).tolist(),
        "validation_failed": results.failed,
        "alternatives": [
            {
                "option": alternative.option,
                "held_out_rms": alternative.held_out_rms.tolist(),
                "change": alternative.change,
                "suggested": alternative.is_better,
            }
            for alternative in results.alternatives
        ],
        "friction": friction_as_dict(results.friction, fit),
        "warnings": list(results.warnings),
        "notes": [
            *(f"{name}: {sentence}" for name, sentences in fit.notes.items() for sentence in sentences),
            *results.notes,
        ],
        "gains": None if results.gains is None else _gains_as_dicts(results.gains),
    }


def _verdict_lines(results: IdentificationResults) -> list[str]:
    """Sentences on how well the recordings determine the robot."""
    fit = results.fit
    determination = results.determination
    errors = determination.prediction_errors
    names = fit.model.dynamics.joint_names
    verdict = determination.verdict
    line = f"verdict: {'not' if verdict == 'not determined' else verdict} determined"
    line += f"; efforts of other motions are predicted with a standard deviation of {100 * errors.max():.0f} %"
    line += " of their RMS at most" if len(errors) > 1 else " of their RMS"
    lines = [line]
    poor = [
        f"{name} {100 * error:.0f} %"
        for name, error, joint_verdict in zip(names, errors, determination.joint_verdicts, strict=True)
        if joint_verdict != "well"
    ]
    if poor:
        lines.append(
            f"  uncertain: {', '.join(poor)}; mainly by {', '.join(determination.main_parameters)}. Record a longer "
            "motion of all joints with larger accelerations (robot-dynamics excite)"
        )
    unseen = [name for name, is_seen in zip(fit.model.names, fit.seen, strict=True) if not is_seen]
    if unseen:
        more = f" and {len(unseen) - MAX_NAMES} more" if len(unseen) > MAX_NAMES else ""
        lines.append(
            f"  {len(unseen)} of {len(fit.seen)} parameters are not seen and keep what the description says: "
            f"{', '.join(unseen[:MAX_NAMES])}{more}"
        )
    if results.written is not None:
        lines.append(
            f"  the written robot differs from the description by {results.written.distance:.2g} link scales in the "
            "RMS of its parameters"
        )
        negative = describe_negative_values(fit)
        if negative:
            lines.append(f"  below zero in the fit, and not in the written robot: {', '.join(negative)}")
    return lines


def _describe_alternative(alternative: Alternative) -> str:
    change = f"{100 * abs(alternative.change):.1f} % {'smaller' if alternative.change < 0 else 'larger'}"
    prefix = "suggestion" if alternative.is_better else "tried"
    return f"{prefix}: {alternative.option}: residuals of held-out data are {change}"


def _print_residuals(results: IdentificationResults) -> None:
    """Print the RMS residuals of each joint, those of the written robot first."""
    fit = results.fit
    written = results.written
    columns: list[tuple[str, Array | None]] = [
        ("written: validated", None if written is None else _rms(written.validation_quality)),
        ("written: fitted", None if written is None else _rms(written.training_quality)),
        ("unconstrained: validated", _rms(fit.validation_quality)),
        ("fitted", fit.training_quality.rms),
        ("held out", fit.held_out_rms),
        ("unfiltered", fit.training_quality.rms_unfiltered),
        ("spread", fit.training_quality.spread),
    ]
    rows: list[list[Cell]] = []
    for index, name in enumerate(fit.model.dynamics.joint_names):
        if fit.training_quality.moving[index] == 0:
            rows.append([name, *[None] * len(columns), "at rest"])
            continue
        cells: list[Cell] = [None if values is None else round_to_digits(values[index], 3) for _, values in columns]
        rows.append([name, *cells, "validation fails" if results.failed[index] else ""])
    print_table(["joint", *(title for title, _ in columns), ""], rows, "Measured minus fitted effort, RMS [N m or N]")


def _rms(quality: FitQuality | None) -> Array | None:
    return None if quality is None else quality.rms


def _print_gains(gains: DriveGains) -> None:
    rows: list[list[Cell]] = [
        [name, round_to_digits(gain, 5), round_to_digits(deviation, 2), "uncertain" if is_uncertain else ""]
        for name, gain, deviation, is_uncertain in zip(
            gains.drives.names, gains.drives.effort_gains, gains.standard_deviations, gains.uncertain, strict=True
        )
    ]
    print_table(["motor", "gain", "deviation", ""], rows, "Drive gains: motor efforts per measured value")
    print(
        "deviation: standard deviation, from the scatter between seconds of motion. uncertain: above "
        f"{100 * gains.uncertain_above:.0f} %: use a heavier payload, a longer motion, or larger accelerations."
    )


def _quality_as_dict(quality: FitQuality | None) -> dict[str, object] | None:
    if quality is None:
        return None
    return {key: np.asarray(value).tolist() for key, value in vars(quality).items()}


def _gains_as_dicts(gains: DriveGains) -> list[dict[str, object]]:
    return [
        {"name": name, "gain": float(gain), "deviation": float(deviation), "uncertain": bool(is_uncertain)}
        for name, gain, deviation, is_uncertain in zip(
            gains.drives.names, gains.drives.effort_gains, gains.standard_deviations, gains.uncertain, strict=True
        )
    ]
