"""The option --friction of `identify`: which friction of the joints is fitted."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.errors import RecordingError

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics

AUTOMATIC = "auto"
PLAIN = "viscous-coulomb"
DESCRIBED = "described"


class FrictionRequest(NamedTuple):
    """Models of friction to fit, among those of `friction_terms.PARAMETER_OF_MODEL`.

    required: whether all joints get them, else they are chosen by held-out data; as_described: whether the friction of
    the description is fitted as it is.
    """

    models: tuple[str, ...]
    required: bool
    as_described: bool


def add_friction_argument(parser: ArgumentParser) -> None:
    """Add the option --friction."""
    parser.add_argument(
        "--friction",
        metavar="MODELS",
        help="friction beside viscous and Coulomb friction: 'auto' chooses for each joint by the residuals of held-out "
        "data; 'viscous-coulomb': none; 'asymmetric', 'stribeck', 'load', or several with commas: these, for all "
        "joints; 'described': what the description has (default: auto; with --gains: described)",
    )


def parse_friction(arguments: Namespace) -> FrictionRequest:
    """Parse --friction. Raises RecordingError if it names no model, or cannot be used with --gains."""
    from robot_dynamics.identification.friction_terms import PARAMETER_OF_MODEL

    value = arguments.friction or (DESCRIBED if arguments.gains else AUTOMATIC)
    if arguments.gains and value != DESCRIBED:
        raise RecordingError(
            "--friction: with --gains the friction of the description is fitted. Write the drives with "
            "--output-drives, then identify again with --drives and --friction, without --gains"
        )
    if value == DESCRIBED:
        return FrictionRequest((), required=False, as_described=True)
    if value == PLAIN:
        return FrictionRequest((), required=False, as_described=False)
    if value == AUTOMATIC:
        return FrictionRequest(tuple(PARAMETER_OF_MODEL), required=False, as_described=False)
    models = tuple(value.split(","))
    unknown = [model for model in models if model not in PARAMETER_OF_MODEL]
    if unknown:
        names = ", ".join((AUTOMATIC, PLAIN, DESCRIBED))
        raise RecordingError(
            f"--friction {value}: {unknown[0]!r} is no model; use {names}, or some of {','.join(PARAMETER_OF_MODEL)}"
        )
    return FrictionRequest(models, required=True, as_described=False)


def dynamics_to_identify(dynamics: Dynamics, request: FrictionRequest) -> Dynamics:
    """Dynamics of the description, with viscous and Coulomb friction only unless its friction is fitted as it is."""
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.identification.friction_terms import has_further_friction, without_further_friction

    if request.as_described or not has_further_friction(dynamics.robot):
        return dynamics
    return Dynamics(without_further_friction(dynamics.robot))
