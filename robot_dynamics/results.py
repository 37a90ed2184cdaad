"""What is answered: the dynamics of a state as arrays, and the refusal of what has no answer."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robot_dynamics.array_checks import broadcast_result, refuse_overflow
from robot_dynamics.errors import SingularModelError
from robot_dynamics.newton_euler.linear import MIN_INERTIA_RATIO
from robot_dynamics.newton_euler.screw import BASE_ROWS

__all__ = [
    "BASE_ROWS",
    "MIN_INERTIA_RATIO",
    "DynamicsResult",
    "Equilibrium",
    "JointMotion",
    "broadcast_result",
    "refuse_unbalanced",
]

EQUILIBRIUM_TOLERANCE = (
    1e-9  # what may be left of the forces of an equilibrium, as a part of weights, wrenches and springs
)


class JointMotion(NamedTuple):
    """Positions, velocities and accelerations (..., all joints) of all joints, in the order of all_joint_names.

    Where the pitch of a platform is ±90° to the last digits, velocities and accelerations of its yaw and roll are nan
    where they do not exist; `PlatformDynamics.twist` and `acceleration` have the motion.
    """

    positions: np.ndarray
    velocities: np.ndarray
    accelerations: np.ndarray


@dataclass(frozen=True, eq=False)
class DynamicsResult:
    """The dynamics of a state.

    accelerations, efforts: (..., n), one of them as given; motion: of all joints, those too that depend on
    others; base_acceleration: (..., 6), None where the base is fixed;
    reactions: (..., 1 + joints, 6) [N, N m], first what the ground exerts on the base, in frame 0, then what each of
    all joints exerts on the link it moves, in the link frame of that link, at its origin. The joint at which a loop is
    cut carries what the loop exerts. Where loops are held by more than they need, reactions are those of least norm.
    """

    accelerations: np.ndarray
    efforts: np.ndarray
    motion: JointMotion
    base_acceleration: np.ndarray | None
    reactions: np.ndarray


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """A robot at rest, its motors holding it.

    positions, efforts: (..., n), the positions of joints without motor as found; joint_positions: (..., all joints)
    those of all; reactions: (..., 1 + joints, 6) as in
    Answer; stable: (...) whether the joints without motor come back when they are moved a little, as far as gravity and
    springs tell: wrenches, which turn with their links, may excite what is called stable.
    """

    positions: np.ndarray
    joint_positions: np.ndarray
    efforts: np.ndarray
    reactions: np.ndarray
    stable: np.ndarray


def refuse_unbalanced(balance, names):
    """Raise SingularModelError where a Balance of the joints `names` has forces left."""
    left, scale = np.broadcast_arrays(np.atleast_2d(balance.residual), np.atleast_2d(balance.scale))
    if not (np.isfinite(left).all() and np.isfinite(scale).all()):
        refuse_overflow()
    share = (np.abs(left) / np.where(scale > 0, scale, 1.0)).reshape(-1, len(names))
    if not (share < EQUILIBRIUM_TOLERANCE).all():
        sample, joint = (int(number) for number in np.argwhere(share >= EQUILIBRIUM_TOLERANCE)[0])
        force = left.reshape(-1, len(names))[sample, joint]
        raise SingularModelError(
            f"no equilibrium was found from the positions of sample {sample}: {force:.3g} (N m "
            f"or N) are left over at joint {names[joint]!r}. Give other positions of the joints without motor to begin "
            "with, or stiffer springs"
        )
