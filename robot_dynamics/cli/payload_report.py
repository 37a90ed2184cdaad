"""An identified payload as a table, as plain data, and as parameters of nodes."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING

from robot_dynamics.cli.recording_notes import merge_notes
from robot_dynamics.cli.text_table import print_table, round_to_digits
from robot_dynamics.identification.payload_identification import node_parameters
from robot_dynamics.model.inertia import INERTIA_ENTRIES, symmetric_entries

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.payload_fit import PayloadFit

NOT_DETERMINED = "not determined"
QUANTITIES = (
    "mass [kg]",
    *(f"centre {axis} [m]" for axis in "xyz"),
    *(f"inertia {entry} [kg m^2]" for entry in INERTIA_ENTRIES),
)


def _ordered(values: Array | BoolArray) -> list[float]:
    """Values (10,) of LINK_PARAMETERS in the order of QUANTITIES."""
    numbers = values.tolist()
    return [numbers[9], *numbers[6:9], *numbers[:6]]


def _values(fit: PayloadFit) -> list[float]:
    return [fit.inertia.mass, *fit.centre.tolist(), *map(float, symmetric_entries(fit.central_inertia))]


def parameters_file(link: str, fit: PayloadFit) -> str:
    """The YAML text of the parameters payload.* for all nodes, for --params-file."""
    lines = [
        f"# Payload on {link}: {_summary(fit)}.",
        "# First moments and inertia are about the origin of the link frame [kg m, kg m^2].",
        "/**:",
        "  ros__parameters:",
        "    payload:",
    ]
    for name, value in node_parameters(link, fit).items():
        lines.append(f"      {name.partition('.')[2]}: {_yaml_value(value)}")
    return "\n".join(lines) + "\n"


def _yaml_value(value: object) -> str:
    """A string or floating-point numbers; ROS takes numbers without a point for integers."""
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, list):
        return f"[{', '.join(map(_yaml_value, value))}]"
    text = f"{value:.6g}"
    mantissa, exponent, power = text.partition("e")
    return f"{mantissa if '.' in mantissa else f'{mantissa}.0'}{exponent}{power}"


def _summary(fit: PayloadFit) -> str:
    """Mass and centre with their deviations."""
    deviations = fit.deviations
    centre = ", ".join(
        f"{value:.3f} ± {deviation:.3f}" for value, deviation in zip(fit.centre, deviations[6:9], strict=True)
    )
    return f"{fit.inertia.mass:.4g} ± {deviations[9]:.2g} kg, centre {centre} m"


def print_payload(link: str, fit: PayloadFit, dynamics: Dynamics, effort_accuracy: float) -> None:
    """Print an identified payload."""
    print(f"payload on {link}: {_summary(fit)}")
    verdict = "determined" if fit.is_determined else NOT_DETERMINED
    print(
        f"verdict: {verdict}; the efforts that the payload needs in other motions are predicted with a standard "
        f"deviation of {100 * fit.prediction_error:.3g} %"
    )
    if not fit.is_determined:
        print("  record a longer motion, in which gravity acts on the payload from all sides")
    for note in merge_notes(fit.notes):
        print(f"note: {note}")
    for warning in fit.warnings:
        print(f"warning: {warning}")
    rows: list[list[Cell]] = []
    determined = _ordered(fit.determined)
    for name, value, deviation, is_determined in zip(
        QUANTITIES, _values(fit), _ordered(fit.deviations), determined, strict=True
    ):
        rows.append(
            [name, round_to_digits(value, 4), round_to_digits(deviation, 2), "" if is_determined else NOT_DETERMINED]
        )
    print_table(["quantity", "value", "deviation", ""], rows, f"Payload, in the frame {link}")
    print(
        "inertia: about the centre of mass. What is not determined has the value of a point mass.\n"
        f"deviation: standard deviation, from the scatter between {fit.blocks} seconds of motion and between joints;\n"
        f"of the mass also {100 * effort_accuracy:g} % for the scale of the measured efforts (--effort-accuracy)."
    )
    print_table(
        ["joint", "with payload", "without"],
        [
            [name, round_to_digits(float(after), 3), round_to_digits(float(before), 3)]
            for name, after, before in zip(dynamics.joint_names, fit.quality.rms, fit.empty_quality.rms, strict=True)
        ],
        "Measured minus predicted effort, RMS [N m or N]",
    )


def as_dict(link: str, fit: PayloadFit, dynamics: Dynamics) -> dict[str, object]:
    """Convert an identified payload to plain data for JSON."""
    deviations = fit.deviations.tolist()
    determined = fit.determined.tolist()
    return {
        "format": 1,
        "robot": dynamics.robot.name,
        "link": link,
        "determined": fit.is_determined,
        "prediction_error": fit.prediction_error if math.isfinite(fit.prediction_error) else None,
        "mass": {"value": float(fit.inertia.mass), "deviation": deviations[9], "determined": determined[9]},
        "centre": {"value": fit.centre.tolist(), "deviation": deviations[6:9], "determined": determined[6:9]},
        "central_inertia": {
            "value": [float(entry) for entry in symmetric_entries(fit.central_inertia)],
            "deviation": deviations[:6],
            "determined": determined[:6],
        },
        "unconstrained": fit.unconstrained.tolist(),
        "parameters": node_parameters(link, fit),
        "joints": list(dynamics.joint_names),
        "rms": fit.quality.rms.tolist(),
        "rms_without_payload": fit.empty_quality.rms.tolist(),
        "blocks": fit.blocks,
        "warnings": list(fit.warnings),
        "notes": [f"{name}: {sentence}" for name, sentences in fit.notes.items() for sentence in sentences],
    }
