"""Results of the dynamic models as arrays, and the refusal of states that have no result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from robot_dynamics.array_checks import refuse_overflow
from robot_dynamics.errors import SingularModelError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

EQUILIBRIUM_TOLERANCE = 1e-9
"""Residual forces allowed in an equilibrium, as a fraction of the weights, wrenches and spring forces."""


class JointMotion(NamedTuple):
    """Motion of all joints, dependent joints included, in the order of ``Dynamics.all_joint_names``.

    Attributes
    ----------
    positions : (..., all joints)
        [rad or m]
    velocities : (..., all joints)
        [rad/s or m/s]
    accelerations : (..., all joints)
        [rad/s² or m/s²]

    Notes
    -----
    Where the pitch of a platform is ±90° to the last digits, the velocities and accelerations of its yaw and roll do
    not exist and are nan. `PlatformDynamics.twist` and `PlatformDynamics.acceleration` give the motion there.
    """

    positions: Array
    velocities: Array
    accelerations: Array


@dataclass(frozen=True, eq=False)
class DynamicsResult:
    """Efforts, accelerations and reactions of a robot in one state or in a batch of states.

    Attributes
    ----------
    accelerations : (..., n)
        Accelerations of the independent joints [rad/s² or m/s²].
    efforts : (..., n)
        Efforts of the actuators [N m or N]; zero at unactuated joints.
    motion : JointMotion
        Motion of all joints, dependent joints included.
    base_acceleration : (..., 6) or None
        Linear and angular acceleration of the origin of frame 0 [m/s², rad/s²], in frame 0, true (gravity is not
        subtracted) and classical. None where the base is fixed.
    reactions : (..., 1 + all joints, 6)
        Wrenches [N, N m]. The first is the wrench of the ground on the base, in frame 0. Each of the others is the
        wrench that a joint exerts on the link that it moves, in the link frame of that link, at its origin.

    Notes
    -----
    The joint at which a loop is cut carries the wrench of the loop. Where a loop has more constraints than it needs,
    the reactions are those of least norm.
    """

    accelerations: Array
    efforts: Array
    motion: JointMotion
    base_acceleration: Array | None
    reactions: Array


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A robot at rest that its actuators hold.

    Attributes
    ----------
    positions : (..., n)
        Positions of the independent joints [rad or m], those of unactuated joints in equilibrium.
    joint_positions : (..., all joints)
        Positions of all joints.
    efforts : (..., n)
        Holding efforts [N m or N]; zero at unactuated joints.
    reactions : (..., 1 + all joints, 6)
        Wrenches [N, N m], as in `DynamicsResult`.
    stable : (...)
        Whether the unactuated joints return after a small displacement. Gravity and springs are considered. External
        wrenches turn with their links and can excite an equilibrium that counts as stable here.
    """

    positions: Array
    joint_positions: Array
    efforts: Array
    reactions: Array
    stable: BoolArray


@dataclass(frozen=True, eq=False)
class InverseDerivatives:
    """Derivatives of the efforts of a motion: of `Dynamics.inverse`.

    m = n independent joints, or 6 + n with a moving base, whose rows and columns come first, as in
    `Dynamics.inertia_matrix`.

    Attributes
    ----------
    positions : (..., m, m)
        ∂τ/∂q. Column k is the derivative along the motion of all joints that joint k causes with the loops closed.
        Columns of the base: a displacement ξ = [translation; rotation] in frame 0, which makes its pose T exp(ξ).
    velocities : (..., m, m)
        ∂τ/∂q̇; of the base by its twist.
    accelerations : (..., m, m)
        ∂τ/∂q̈: the mass matrix where all joints are actuated and no friction depends on load.

    Notes
    -----
    Rows of the base: the wrench [N, N m] that holds it, where its acceleration is given in `Base`. The rows and the
    columns of accelerations that are part of the result are zero: of unactuated joints, and of a free base.
    """

    positions: Array
    velocities: Array
    accelerations: Array


@dataclass(frozen=True, eq=False)
class DirectDerivatives:
    """Derivatives of the accelerations that efforts cause: of `Dynamics.direct`.

    Rows and columns as in `InverseDerivatives`.

    Attributes
    ----------
    positions : (..., m, m)
        ∂q̈/∂q. The first rows are the acceleration of a free base, true and classical, in frame 0.
    velocities : (..., m, m)
        ∂q̈/∂q̇; of the base by its twist.
    efforts : (..., m, n)
        ∂q̈/∂τ: columns of the inverse of the mass matrix where no friction depends on load. The column of an unactuated
        joint is the effect of a force along it.
    base_acceleration : (..., m, 6) or None
        Where the acceleration of the base is given in `Base`: derivatives by it. The rows of the base in the other
        attributes are then zero.
    """

    positions: Array
    velocities: Array
    efforts: Array
    base_acceleration: Array | None = None


@dataclass(frozen=True, eq=False)
class Linearization:
    """The equation of motion near one state, as a linear system dẋ = A dx + B du.

    Attributes
    ----------
    A : (..., 2 m, 2 m)
        x: m positions, then m velocities. m = n independent joints, or 6 + n with a moving base, which comes first.
    B : (..., 2 m, k)
        u: efforts of the k actuated joints.
    state_names : tuple of str
        Names of the entries of x.
    input_names : tuple of str
        Names of the actuated joints.

    Notes
    -----
    The position of a moving base in x is its displacement ξ from the pose T of the state, [translation; rotation] in
    frame 0: the pose is T exp(ξ). Its velocity is its twist in its own frame.
    """

    A: Array
    B: Array
    state_names: tuple[str, ...]
    input_names: tuple[str, ...]


class ForceResidual(Protocol):
    """Residual forces (..., k) of k joints, and the forces to compare them with."""

    @property
    def residual(self) -> Array: ...

    @property
    def scale(self) -> Array: ...


def refuse_unbalanced(balance: ForceResidual, names: Sequence[str]) -> None:
    """Raise SingularModelError where forces at the joints `names` are not in equilibrium."""
    residual, scale = np.broadcast_arrays(np.atleast_2d(balance.residual), np.atleast_2d(balance.scale))
    if not (np.isfinite(residual).all() and np.isfinite(scale).all()):
        refuse_overflow()
    ratio = (np.abs(residual) / np.where(scale > 0, scale, 1.0)).reshape(-1, len(names))
    if not (ratio < EQUILIBRIUM_TOLERANCE).all():
        sample, joint = (int(index) for index in np.argwhere(ratio >= EQUILIBRIUM_TOLERANCE)[0])
        force = residual.reshape(-1, len(names))[sample, joint]
        raise SingularModelError(
            f"no equilibrium was found from the positions of sample {sample}: a force of {force:.3g} (N m or N) "
            f"remains at joint {names[joint]!r}. Start from other positions of the unactuated joints, or use stiffer "
            "springs"
        )
