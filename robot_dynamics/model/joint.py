"""A joint as data: where it stands, what moves it, what it may do."""

from dataclasses import dataclass, field

import numpy as np

from robot_dynamics.errors import DescriptionError

UNLIMITED = 1e9  # a limit from here on is none [rad, m, rad/s, m/s, N m or N]
SUSPICIOUS_RANGE = 50.0  # [rad] between limits that look like degrees


@dataclass(frozen=True)
class Limits:
    """What a joint may do: positions [rad or m], velocity [rad/s or m/s], effort [N m or N]; infinite if not said."""

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: position = multiplier · position of `joint` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Spring:
    """What an elastic joint is held by: force = -stiffness · (position - rest) - damping · velocity.

    stiffness: k [N m/rad or N/m]; rest: q₀ [rad or m]; damping [N m s/rad or N s/m].
    """

    stiffness: float
    rest: float = 0.0
    damping: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint with one degree of freedom, and how it places the frame of its link.

    antecedent: a(j), the number of the link that carries it. prismatic: σ. placement: iTj (4, 4) of frame j in the
    frame of the antecedent where the joint variable is zero; the variable then turns frame j about z_j or moves it
    along z_j. rotor_inertia: Ia, seen at the joint [kg m² or kg]; viscous_friction: Fv [N m s/rad or N s/m];
    coulomb_friction: Fs [N m or N]. actuated: μ, whether a motor drives it; one without motor is elastic where it has a
    spring, else passive. A spring beside a motor bears its part of the load. initial_position [rad or m]: where loops
    are closed first; it chooses between their assembly modes. brake: whether natural frequencies count the joint as
    held though no motor drives it.
    """

    name: str
    antecedent: int
    prismatic: bool
    placement: np.ndarray
    rotor_inertia: float = 0.0
    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    limits: Limits = field(default_factory=Limits)
    mimic: Mimic | None = None
    actuated: bool = True
    spring: Spring | None = None
    initial_position: float = 0.0
    brake: bool = False

    @property
    def rotation(self):
        """(3, 3), or one for each sample (..., 3, 3), of frame j in the antecedent where the joint variable is zero."""
        return self.placement[:3, :3]

    @property
    def role(self):
        """actuated, elastic or passive; a joint that follows another one: mimic."""
        if self.mimic is not None:
            return "mimic"
        return "actuated" if self.actuated else "passive" if self.spring is None else "elastic"


def find_suspicious_limits(joint):
    lower, upper = joint.limits.lower, joint.limits.upper
    if lower > upper:
        return [f"joint {joint.name!r}: its lower limit {lower:g} is above the upper one, {upper:g}"]
    if not joint.prismatic and SUSPICIOUS_RANGE < upper - lower < 1000:
        return [f"joint {joint.name!r}: limits {lower:g} to {upper:g} are many turns. They are in radians, not degrees"]
    return []


def check_placement(owner, placement):
    """Refuse what is no homogeneous matrix of a rotation and a translation; symbols have no value yet."""
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


def check_joint(number, joint):
    """Refuse a joint that moves link `number` but could not."""
    check_placement(f"joint {joint.name!r}", joint.placement)
    limits = vars(joint.limits)
    if np.isnan([*limits.values()]).any() or np.inf == joint.limits.lower or -np.inf in list(limits.values())[1:]:
        told = ", ".join(f"{key} {value:g}" for key, value in limits.items())
        raise DescriptionError(f"joint {joint.name!r}: limits {told} mean nothing. No limit is -inf below, inf else")
    if not 0 <= joint.antecedent < number:
        raise DescriptionError(
            f"joint {joint.name!r} moves link {number} but hangs on link {joint.antecedent}: "
            "a link comes after its antecedent"
        )
    if joint.mimic is not None and not joint.actuated:
        raise DescriptionError(f"joint {joint.name!r} follows another one: whether it has a motor is said of that one")
    mimic, spring = joint.mimic or Mimic(""), joint.spring or Spring(0.0)
    numbers = {
        "rotor_inertia": joint.rotor_inertia,
        "viscous_friction": joint.viscous_friction,
        "coulomb_friction": joint.coulomb_friction,
        "multiplier": mimic.multiplier,
        "offset": mimic.offset,
        "stiffness": spring.stiffness,
        "rest position": spring.rest,
        "damping": spring.damping,
        "initial position": joint.initial_position,
    }
    for name, value in numbers.items():
        value = np.asarray(value)
        if value.dtype == object:  # symbols have no value yet
            continue
        if not np.isfinite(value).all():
            raise DescriptionError(f"joint {joint.name!r}: {name} is not finite")
        if value.ndim == 0 and value < 0 and name.endswith(("inertia", "friction", "stiffness", "damping")):
            raise DescriptionError(f"joint {joint.name!r}: {name} {value:g} is negative, it would drive the joint")
