"""What is answered: the dynamics of a state as arrays, and the refusal of what has no answer."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import InvalidInputError, SingularModelError

BASE_ROWS = tuple(f"base.{kind}.{axis}" for kind in ("linear", "angular") for axis in "xyz")
MIN_INERTIA_RATIO = 1e-14  # an inertia below this part of the largest one beside it is rounding
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


def broadcast_result(array, batch, axes=1):
    """A new array with the whole batch shape in front of the last axes. Refuses what is not finite."""
    complete = np.array(np.broadcast_to(array, (*batch, *array.shape[array.ndim - axes :])))
    if not np.isfinite(complete).all():
        sample = tuple(int(index) for index in np.argwhere(~np.isfinite(complete))[0][: len(batch)])
        _overflow(f" at sample {', '.join(map(str, sample))}" if sample else "")
    return complete


def _overflow(where=""):
    raise InvalidInputError(
        f"the answer{where} is no finite number: something that is asked, or the robot, is too large"
    )


def refuse_singular(pivot, scale, name):
    if np.isnan(pivot).any():
        _overflow()
    if not np.all(pivot > MIN_INERTIA_RATIO * np.abs(scale)):
        raise SingularModelError(
            f"nothing with inertia resists {name} (inertia {np.min(pivot):.3g}). "
            "Give the links that it moves a mass and an inertia, or the joint a rotor inertia"
        )


def refuse_unbalanced(balance, names):
    """Raise SingularModelError where a Balance of the joints `names` has forces left."""
    left, scale = np.broadcast_arrays(np.atleast_2d(balance.residual), np.atleast_2d(balance.scale))
    if not (np.isfinite(left).all() and np.isfinite(scale).all()):
        _overflow()
    share = (np.abs(left) / np.where(scale > 0, scale, 1.0)).reshape(-1, len(names))
    if not (share < EQUILIBRIUM_TOLERANCE).all():
        sample, joint = (int(number) for number in np.argwhere(share >= EQUILIBRIUM_TOLERANCE)[0])
        force = left.reshape(-1, len(names))[sample, joint]
        raise SingularModelError(
            f"no equilibrium was found from the positions of sample {sample}: {force:.3g} (N m "
            f"or N) are left over at joint {names[joint]!r}. Give other positions of the joints without motor to begin "
            "with, or stiffer springs"
        )
