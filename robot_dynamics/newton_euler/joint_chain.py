"""Chains of joints: pose, Jacobian and bias acceleration of the frame at their end, relative to the link they start at.

All vectors are in the axes of that link: the base, for the kinematics of a frame, or the link where the two chains of a
loop part.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.angular_motion import angular_motion
from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.screw import apply, cross, screw

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot


class JointChain(NamedTuple):
    """Successive joints.

    R (..., 3, 3) and P (..., 3) of the last frame; axes: of each joint by number, its axis and a point on it, (..., 3)
    each; motion: angular velocity of the last frame, its derivative, and the acceleration (..., 3) of its origin,
    without joint accelerations.
    """

    R: ScalarArray
    P: ScalarArray
    axes: dict[int, tuple[ScalarArray, ScalarArray]]
    motion: tuple[ScalarArray, ScalarArray, ScalarArray]


class ChainEnd(NamedTuple):
    """A frame that is fixed to the last link of a chain.

    R (..., 3, 3) and P (..., 3) of the frame; columns (..., 6) of the Jacobian of its twist by joint number; drift: its
    classical acceleration (..., 6) without joint accelerations.
    """

    R: ScalarArray
    P: ScalarArray
    columns: dict[int, ScalarArray]
    drift: ScalarArray


def joint_chain(
    robot: Robot, numbers: Sequence[int], q: ScalarArray, qd: ScalarArray | None, omega: ScalarArray | None = None
) -> JointChain:
    """The JointChain of joints `numbers`, each of which moves the antecedent of the next one.

    Parameters
    ----------
    robot : Robot
    numbers : sequence of int
        Ascending.
    q : ndarray, shape (..., joints)
        Positions of all joints [rad or m].
    qd : ndarray, shape (..., joints), optional
        Velocities, which only `motion` depends on.
    omega : ndarray, shape (..., 3), optional
        Angular velocity of the link where the chain starts [rad/s], which moves without acceleration of its origin and
        angular acceleration. Default: zero.
    """
    R: ScalarArray = np.eye(3, dtype=int)
    P: ScalarArray = np.zeros(3, dtype=int)
    axes: dict[int, tuple[ScalarArray, ScalarArray]] = {}
    angular_acceleration: ScalarArray = np.zeros(3, dtype=int)
    acceleration: ScalarArray = angular_acceleration
    omega = angular_acceleration if omega is None else omega
    for number in numbers:
        joint = robot.joints[number]
        R_j, P_j = joint_placement(joint, q[..., number : number + 1])
        offset = apply(R, P_j)
        R = R @ R_j
        P = P + offset
        z = R[..., 2]
        axes[number] = z, P
        if qd is not None:
            rate = qd[..., number : number + 1]
            acceleration = acceleration + angular_motion(omega, angular_acceleration).times(offset)
            if joint.prismatic:
                acceleration = acceleration + 2 * cross(omega, z * rate)
            else:
                angular_acceleration = angular_acceleration + cross(omega, z * rate)
                omega = omega + z * rate
    return JointChain(R, P, axes, (omega, angular_acceleration, acceleration))


def chain_end(robot: Robot, chain: JointChain, placement: ScalarArray, has_velocities: bool) -> ChainEnd:
    """The ChainEnd of a JointChain at the frame with a placement (4, 4) in the last one."""
    omega, angular_acceleration, acceleration = chain.motion
    offset = apply(chain.R, placement[:3, 3])
    P = chain.P + offset
    if has_velocities:
        acceleration = acceleration + angular_motion(omega, angular_acceleration).times(offset)
    columns = {
        number: screw(z, np.zeros_like(z)) if robot.joints[number].prismatic else screw(cross(z, P - point), z)
        for number, (z, point) in chain.axes.items()
    }
    return ChainEnd(chain.R @ placement[:3, :3], P, columns, screw(acceleration, angular_acceleration))


def jacobian_from_columns(columns: Mapping[int, ScalarArray], joints: int) -> ScalarArray:
    """Jacobian (..., 6, joints) of columns (..., 6) by joint number; the others are zero."""
    if not columns:
        return np.zeros((6, joints), dtype=int)
    entries = np.stack(np.broadcast_arrays(*columns.values()), axis=-1)
    J = np.zeros((*entries.shape[:-1], joints), dtype=entries.dtype)
    J[..., list(columns)] = entries
    return J
