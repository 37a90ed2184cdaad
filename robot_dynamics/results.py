"""Results of the dynamic models as arrays, and the refusal of states that have no result."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np

from robot_dynamics.array_checks import refuse_overflow
from robot_dynamics.errors import SingularModelError
from robot_dynamics.notebook_display import notebook_html

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

    def _repr_html_(self) -> str | None:
        return notebook_html(self)


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

    _repr_html_ = notebook_html

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

    _repr_html_ = notebook_html

    positions: Array
    joint_positions: Array
    efforts: Array
    reactions: Array
    stable: BoolArray


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
