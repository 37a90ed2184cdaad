"""Numbers of the friction of a joint, and the combinations that no joint has."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.model.joint import Joint

NUMBERS = (float, int, np.integer)
"""Types of coefficients that are one number; others are symbols or arrays of samples."""

FRICTION_FIELDS = (
    "viscous_friction",
    "coulomb_friction",
    "viscous_asymmetry",
    "coulomb_asymmetry",
    "stribeck_friction",
    "stribeck_velocity",
    "load_friction",
)
"""Numbers of a Joint that describe its friction."""

FRICTION_COEFFICIENTS = tuple(field for field in FRICTION_FIELDS if field != "stribeck_velocity")
"""Those in which friction is linear."""


class FrictionConflict(NamedTuple):
    """Coefficients of friction that no joint has: the name of the one that is wrong, and a message."""

    field: str
    message: str


def find_friction_conflict(joint: Joint) -> FrictionConflict | None:
    """Return the contradiction between coefficients of friction of a joint, by which friction would drive it, or None.

    A coefficient that is negative by itself or not finite is refused by `check_joint`.
    """
    if not all(isinstance(getattr(joint, field), NUMBERS) for field in FRICTION_FIELDS):
        return None  # symbols and samples are not judged
    viscous, viscous_asymmetry = joint.viscous_friction, joint.viscous_asymmetry
    coulomb, coulomb_asymmetry, stribeck = joint.coulomb_friction, joint.coulomb_asymmetry, joint.stribeck_friction
    dry = coulomb + min(stribeck, 0.0)
    if abs(viscous_asymmetry) > viscous:
        message = f"viscous_asymmetry {viscous_asymmetry:g} is larger than viscous_friction {viscous:g}"
        return FrictionConflict("viscous_asymmetry", f"{message}: friction would drive the joint in one direction")
    if dry < 0:
        message = f"stribeck_friction {stribeck:g} and coulomb_friction {coulomb:g} have a negative sum"
        return FrictionConflict("stribeck_friction", f"{message}: friction would drive the joint at low velocity")
    if abs(coulomb_asymmetry) > dry:
        message = f"coulomb_asymmetry {coulomb_asymmetry:g} is larger than the dry friction {dry:g}"
        return FrictionConflict("coulomb_asymmetry", f"{message}: friction would drive the joint in one direction")
    if (stribeck or joint.stribeck_velocity) and not joint.stribeck_velocity > 0:
        message = f"stribeck_velocity {joint.stribeck_velocity:g} is not above zero"
        return FrictionConflict("stribeck_velocity", f"{message}: at this velocity half of stribeck_friction is left")
    return _find_load_friction_conflict(joint) if joint.load_friction else None


def _find_load_friction_conflict(joint: Joint) -> FrictionConflict | None:
    """Return why a joint cannot have its load friction, or None; Robot checks loops and mimic joints that follow it."""
    if not joint.load_friction < 1:
        message = f"load_friction {joint.load_friction:g} is not below 1"
        return FrictionConflict("load_friction", f"{message}: friction would hold any load that drives the joint")
    if joint.role != "actuated" or joint.spring is not None:
        reason = "has a spring" if joint.actuated and joint.mimic is None else f"is {joint.role}"
        message = f"it {reason}, and its load is then not the effort of a motor: leave load_friction out"
        return FrictionConflict("load_friction", message)
    return None


def has_value(coefficient: object) -> bool:
    """Whether a coefficient of a joint is not the number zero; symbols and arrays of samples count as not zero."""
    return not isinstance(coefficient, NUMBERS) or coefficient != 0
