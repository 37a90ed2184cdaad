"""Joints as data: placement, drive, spring, friction and limits."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.joint_friction import FRICTION_COEFFICIENTS, find_friction_conflict, has_value

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray

NON_NEGATIVE = (
    "rotor_inertia",
    "viscous_friction",
    "coulomb_friction",
    "load_friction",
    "stiffness",
    "damping",
)
"""Numbers of a joint that are not negative."""

UNLIMITED = 1e9  # a limit from this value on counts as no limit [rad, m, rad/s, m/s, N m or N]
SUSPICIOUS_RANGE = 50.0  # [rad] from this range on limits look like degrees

JointRole: TypeAlias = Literal["actuated", "elastic", "passive", "mimic"]


@dataclass(frozen=True)
class Limits:
    """Limits of a joint; infinite where the description has none.

    Attributes
    ----------
    lower, upper : float
        Limits of the position [rad or m].
    velocity : float
        Maximum speed [rad/s or m/s].
    effort : float
        Maximum joint torque or force [N m or N].
    """

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf


@dataclass(frozen=True)
class LockedJoint:
    """A joint that a robot does not have any more, because it is locked.

    Attributes
    ----------
    name : str
        Name of the joint.
    position : float
        Position at which it is locked [rad or m].
    limits : Limits
        Limits of the joint.
    is_massless : bool
        Whether it was locked because it moves nothing with inertia.
    """

    name: str
    position: float
    limits: Limits
    is_massless: bool = False

    def find_objection(self) -> str | None:
        """Return a sentence about a position outside the limits, or about a missing inertia; None: there is none."""
        if self.is_massless:
            return f"joint {self.name!r} moves nothing with inertia: it is locked at {self.position:g}"
        if not self.limits.lower <= self.position <= self.limits.upper:
            limits = f"{self.limits.lower:g} to {self.limits.upper:g}"
            return f"joint {self.name!r} is locked at {self.position:g}, outside its limits {limits}"
        return None


@dataclass(frozen=True)
class Mimic:
    """Relation of a mimic joint: position = multiplier · (position of the joint named `joint`) + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Spring:
    """Spring of a joint: force = -stiffness · (position - rest) - damping · velocity.

    Parameters
    ----------
    stiffness : float
        k [N m/rad or N/m].
    rest : float
        Position without spring force q₀ [rad or m].
    damping : float
        Viscous damping [N m s/rad or N s/m].
    """

    stiffness: float
    rest: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint with one degree of freedom, and the placement of the frame of the link that it moves.

    Parameters
    ----------
    name : str
        Name of the joint.
    antecedent : int
        a(j), the number of the link that carries the joint.
    prismatic : bool
        σ: whether the joint slides along z_j; else it turns about z_j.
    placement : (4, 4) array
        iTj, frame j in the frame of the antecedent at zero joint position. The joint variable then turns frame j about
        z_j or moves it along z_j.
    rotor_inertia : float
        Ia, referred to the joint [kg m² or kg].
    viscous_friction : float
        Fv [N m s/rad or N s/m].
    coulomb_friction : float
        Fs [N m or N].
    viscous_asymmetry : float
        Fva [N m s/rad or N s/m], added to Fv where the joint moves in positive direction, subtracted in the other one.
    coulomb_asymmetry : float
        Fsa [N m or N], added to Fs in positive direction, subtracted in the other one.
    stribeck_friction : float
        Fst [N m or N], dry friction at low velocity in addition to Fs.
    stribeck_velocity : float
        vs [rad/s or m/s], the velocity at which half of Fst is left; positive where there is Fst.
    load_friction : float
        μ, the part of the load by which dry friction grows; at least 0 and below 1. The load is the effort of the joint
        without friction. Only actuated joints outside loops have it, without a spring and without mimic joints.
    limits : Limits
        Limits of position, speed and effort.
    mimic : Mimic, optional
        Relation to the joint that this one follows.
    actuated : bool
        μ: whether a motor drives the joint. An unactuated joint is elastic with a spring, else passive.
    spring : Spring, optional
        Spring of an elastic joint. A spring at an actuated joint acts in parallel with the motor.
    initial_position : float
        Position from which loops are closed first [rad or m]; it selects their assembly mode.
    brake : bool
        Whether natural frequencies count the joint as held although it is unactuated.

    Notes
    -----
    Source: Khalil, section 2. In traced models the numbers are symbols (dtype object).
    """

    name: str
    antecedent: int
    prismatic: bool
    placement: ScalarArray
    rotor_inertia: float = 0.0
    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    viscous_asymmetry: float = 0.0
    coulomb_asymmetry: float = 0.0
    stribeck_friction: float = 0.0
    stribeck_velocity: float = 0.0
    load_friction: float = 0.0
    limits: Limits = field(default_factory=Limits)
    mimic: Mimic | None = None
    actuated: bool = True
    spring: Spring | None = None
    initial_position: float = 0.0
    brake: bool = False

    @property
    def rotation(self) -> ScalarArray:
        """Rotation (3, 3), or one for each sample (..., 3, 3), of frame j in the antecedent at zero joint position."""
        return self.placement[:3, :3]

    @property
    def role(self) -> JointRole:
        """Role of the joint: mimic, actuated, passive, or elastic (unactuated with a spring)."""
        if self.mimic is not None:
            return "mimic"
        if self.actuated:
            return "actuated"
        return "passive" if self.spring is None else "elastic"

    @property
    def has_friction(self) -> bool:
        """Whether a coefficient of friction is not zero."""
        return any(has_value(getattr(self, field)) for field in FRICTION_COEFFICIENTS)

    def without_friction(self) -> Joint:
        """Return the same joint without friction."""
        return replace(
            self,
            viscous_friction=0.0,
            coulomb_friction=0.0,
            viscous_asymmetry=0.0,
            coulomb_asymmetry=0.0,
            stribeck_friction=0.0,
            stribeck_velocity=0.0,
            load_friction=0.0,
        )


def find_suspicious_limits(joint: Joint) -> list[str]:
    """Return sentences about limits of a joint that are probably wrong; empty where there are none."""
    lower, upper = joint.limits.lower, joint.limits.upper
    if lower > upper:
        return [f"joint {joint.name!r}: its lower limit {lower:g} is above the upper one, {upper:g}"]
    if not joint.prismatic and SUSPICIOUS_RANGE < upper - lower < 1000:
        return [f"joint {joint.name!r}: limits {lower:g} to {upper:g} are many turns. They are in radians, not degrees"]
    return []


def check_placement(owner: str, placement: ScalarArray) -> None:
    """Raise DescriptionError unless a placement is a homogeneous matrix (4, 4); symbols pass, they have no value."""
    matrix = np.asarray(placement)
    if matrix.shape != (4, 4):
        raise DescriptionError(f"{owner}: its placement has shape {matrix.shape}: a matrix (4, 4) is needed")
    if matrix.dtype == object:
        return
    R = matrix[:3, :3]
    if not np.isfinite(matrix).all():
        raise DescriptionError(f"{owner}: placement is not finite")
    if np.abs(R @ R.T - np.eye(3)).max() > 1e-6 or np.linalg.det(R) < 0 or (matrix[3] != (0, 0, 0, 1)).any():
        raise DescriptionError(f"{owner}: its placement is no matrix [rotation, position; 0, 0, 0, 1]")


def check_joint(number: int, joint: Joint) -> None:
    """Raise DescriptionError where a joint cannot move link `number`, or one of its numbers is impossible."""
    check_placement(f"joint {joint.name!r}", joint.placement)
    _check_limits(joint)
    if not 0 <= joint.antecedent < number:
        raise DescriptionError(
            f"joint {joint.name!r} moves link {number} but its antecedent is link {joint.antecedent}: "
            "a link comes after its antecedent"
        )
    if joint.mimic is not None and not joint.actuated:
        raise DescriptionError(
            f"joint {joint.name!r} is a mimic joint and cannot be unactuated: only the joint that it follows has a role"
        )
    for name, number_or_samples in _numbers_by_name(joint).items():
        value = np.asarray(number_or_samples)
        if value.dtype == object:  # symbols have no value yet
            continue
        if not np.isfinite(value).all():
            raise DescriptionError(f"joint {joint.name!r}: {name} is not finite")
        if value.ndim == 0 and value < 0 and name in NON_NEGATIVE:
            raise DescriptionError(f"joint {joint.name!r}: {name} {value:g} is negative, it would drive the joint")
    if conflict := find_friction_conflict(joint):
        raise DescriptionError(f"joint {joint.name!r}: {conflict.message}")


def _check_limits(joint: Joint) -> None:
    """Raise DescriptionError where a limit is NaN or has the wrong infinity."""
    limits = vars(joint.limits)
    if np.isnan([*limits.values()]).any() or np.inf == joint.limits.lower or -np.inf in list(limits.values())[1:]:
        text = ", ".join(f"{key} {value:g}" for key, value in limits.items())
        raise DescriptionError(f"joint {joint.name!r}: limits {text} mean nothing. No limit is -inf below, inf else")


def _numbers_by_name(joint: Joint) -> dict[str, float]:
    """Return the numbers of a joint that must be finite, with the names that messages use."""
    mimic = joint.mimic or Mimic("")
    spring = joint.spring or Spring(0.0)
    return {
        "rotor_inertia": joint.rotor_inertia,
        "viscous_friction": joint.viscous_friction,
        "coulomb_friction": joint.coulomb_friction,
        "viscous_asymmetry": joint.viscous_asymmetry,
        "coulomb_asymmetry": joint.coulomb_asymmetry,
        "stribeck_friction": joint.stribeck_friction,
        "stribeck_velocity": joint.stribeck_velocity,
        "load_friction": joint.load_friction,
        "multiplier": mimic.multiplier,
        "offset": mimic.offset,
        "stiffness": spring.stiffness,
        "rest position": spring.rest,
        "damping": spring.damping,
        "initial position": joint.initial_position,
    }
