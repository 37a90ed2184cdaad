"""What `identify` reports of friction beside viscous and Coulomb friction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot_dynamics.cli.text_table import print_table, round_to_digits

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.cli.text_table import Cell
    from robot_dynamics.identification.fitting import Fit
    from robot_dynamics.identification.friction_choice import FrictionChoice

FRICTION_LEGEND = (
    "viscous-coulomb: with viscous and Coulomb friction only. chosen: with the models of the second column.\n"
    "held out: RMS on seconds that were left out of the fit, by which the models are chosen.\n"
    "validated: RMS of the unconstrained fits on data for validation, by which nothing is chosen."
)


@dataclass(frozen=True, eq=False)
class FrictionResults:
    """Friction models of the joints with what they change.

    models: that were tried; required: whether all joints got them; plain: fit with viscous and Coulomb friction.
    """

    models: tuple[str, ...]
    required: bool
    choice: FrictionChoice
    plain: Fit

    def joint_models(self, joint: int) -> str:
        """Models of a joint, as the option --friction names them."""
        return ",".join(self.choice.models(joint))


def print_friction(results: FrictionResults, fit: Fit) -> None:
    """Print which models were chosen, and residuals with and without them; fit: with the chosen models."""
    if not results.choice.terms:
        tried = ", ".join(results.models)
        if results.required:
            print(f"friction: viscous and Coulomb friction; no joint can have {tried}")
        else:
            print(f"friction: viscous and Coulomb friction; held-out data show no other (tried: {tried})")
        return
    plain = results.plain
    choice = results.choice
    columns: list[tuple[str, Array]] = [
        ("held out: viscous-coulomb", choice.plain_rms),
        ("chosen", choice.chosen_rms),
    ]
    if plain.validation_quality is not None and fit.validation_quality is not None:
        columns += [
            ("validated: viscous-coulomb", plain.validation_quality.rms),
            ("chosen", fit.validation_quality.rms),
        ]
    rows: list[list[Cell]] = [
        [name, results.joint_models(joint) or "-", *(round_to_digits(values[joint], 3) for _, values in columns)]
        for joint, name in enumerate(fit.model.dynamics.joint_names)
    ]
    how = "of all joints" if results.required else "chosen by held-out data"
    print_table(["joint", "friction", *(title for title, _ in columns)], rows, f"Friction {how}, RMS [N m or N]")
    print(FRICTION_LEGEND)


def friction_as_dict(results: FrictionResults | None, fit: Fit) -> dict[str, object] | None:
    """Convert the results to plain data for JSON."""
    if results is None:
        return None
    validated = results.plain.validation_quality
    return {
        "tried": list(results.models),
        "required": results.required,
        "models": [list(results.choice.models(joint)) for joint in range(len(fit.model.dynamics.joint_names))],
        "held_out_rms_viscous_coulomb": results.choice.plain_rms.tolist(),
        "held_out_rms": results.choice.chosen_rms.tolist(),
        "validated_rms_viscous_coulomb": None if validated is None else validated.rms.tolist(),
    }
