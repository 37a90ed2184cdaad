"""Inverse dynamic model by augmented bodies (Renaud), for trees: the recursion with the fewest operations.

The augmented body j is link j and, for each revolute joint k whose antecedent it is, a point mass m*_k at O_k: the mass
of the subtree of this joint up to the next prismatic joints. Its moments are constant, so that masses multiply
accelerations once for each link and not once for each pair of links. The backward pass transmits only

    e_j = f_j - m*_j α_j,   α_j the acceleration of O_j with gravity subtracted

since the moments of the augmented body below contain the other part already. A prismatic joint would move its point
mass: the augmented body ends there, and the joint transmits the whole f_j.

With B_j = [ω̇_j] + [ω_j][ω_j] ([·] the matrix of the vector product) a point at r has the acceleration α_j + B_j r.

Source: Renaud, equations 0 to 10, for simple chains. Trees, the moving base and prismatic joints are treated as above.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.angular_motion import AngularMotion, components, vector_from_components
from robot_dynamics.newton_euler.kinematics import joint_placement
from robot_dynamics.newton_euler.screw import apply, apply_transposed, concatenate_vectors, cross, screw

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot


class AugmentedBodies(NamedTuple):
    """Augmented bodies by link number: m*; first moments u* (3,); second moments k* (3, 3) about O_j."""

    masses: list[float]
    first_moments: list[ScalarArray]
    second_moments: list[ScalarArray]


def augmented_bodies(robot: Robot) -> AugmentedBodies:
    """The constant AugmentedBodies of a robot."""
    masses = [link.inertia.mass for link in robot.links]
    first = [link.inertia.first_moments for link in robot.links]
    second = [link.inertia.second_moments for link in robot.links]
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        i = joint.antecedent
        mass = masses[j]
        P = joint.placement[:3, 3]
        if not joint.prismatic:
            masses[i] = masses[i] + mass
            first[i] = first[i] + mass * P  # u* = u + m* p
            square = P[0] * P[0] + P[1] * P[1] + P[2] * P[2]
            second[i] = second[i] + mass * (square * np.eye(3, dtype=int) - P[:, None] * P)  # k* = k - m* p̂ p̂
    return AugmentedBodies(masses, first, second)


def inverse_dynamics(
    robot: Robot,
    q: ScalarArray,
    qd: ScalarArray,
    qdd: ScalarArray,
    base_twist: ScalarArray,
    base_acceleration: ScalarArray,
    external_wrenches: Mapping[int, ScalarArray],
) -> tuple[ScalarArray, ScalarArray]:
    """Joint forces and the wrench on the base of a motion.

    Parameters
    ----------
    robot : Robot
    q, qd, qdd : ndarray, shape (..., n)
    base_twist, base_acceleration : ndarray, shape (..., 6)
        0V0 and 0V̇0, gravity subtracted, in frame 0.
    external_wrenches : mapping of int to ndarray
        jf_e (..., 6) by link number: what the link exerts on its environment, in frame j at its origin.

    Returns
    -------
    forces : ndarray, shape (..., n)
        Joint forces [N m or N], friction not counted.
    wrench : ndarray, shape (..., 6)
        Wrench that holds the base.
    """
    motions = link_motions(robot, q, qd, qdd, base_twist, base_acceleration)
    return _run_backward_pass(robot, augmented_bodies(robot), motions, qdd, external_wrenches)


class LinkMotion(AngularMotion):
    """Motion of a link, in frame j.

    Attributes
    ----------
    R, P : ndarray, shape (..., 3, 3) and (..., 3)
        iRj and iPj, for the base the identity and zero.
    alpha : ndarray, shape (..., 3)
        α_j, the acceleration of O_j with gravity subtracted.
    """

    def __init__(
        self,
        R: ScalarArray,
        P: ScalarArray,
        omega: ScalarArray,
        angular_acceleration: ScalarArray,
        alpha: ScalarArray,
    ) -> None:
        super().__init__(omega, angular_acceleration)
        self.R = R
        self.P = P
        self.alpha = alpha


def link_motions(
    robot: Robot,
    q: ScalarArray,
    qd: ScalarArray,
    qdd: ScalarArray,
    base_twist: ScalarArray,
    base_acceleration: ScalarArray,
) -> list[LinkMotion]:
    """LinkMotion of each link by link number (eq. 1 to 6); arguments as for `inverse_dynamics`."""
    base = LinkMotion(
        np.eye(3), np.zeros(3), base_twist[..., 3:], base_acceleration[..., 3:], base_acceleration[..., :3]
    )
    motions = [base]
    for j, joint in enumerate(robot.joints, start=1):
        position = q[..., j - 1 : j]
        motions.append(_successor_motion(joint, motions[joint.antecedent], position, qd[..., j - 1], qdd[..., j - 1]))
    return motions


def _successor_motion(
    joint: Joint, antecedent: LinkMotion, position: ScalarArray, rate: ScalarArray, acceleration: ScalarArray
) -> LinkMotion:
    """Motion of the link that a joint moves, from that of its antecedent (eq. 1 to 6)."""
    R, P = joint_placement(joint, position)
    omega = apply_transposed(R, antecedent.omega)  # eq. 1a
    angular_acceleration = apply_transposed(R, antecedent.angular_acceleration)  # eq. 3a
    alpha = apply_transposed(R, antecedent.alpha + antecedent.times(P))  # eq. 6a, 6b
    x, y, z = components(omega)
    a, b, c = components(angular_acceleration)
    if joint.prismatic:
        alpha = alpha + vector_from_components(2 * rate * y, -2 * rate * x, acceleration)  # eq. 5, 6c
    else:
        omega = vector_from_components(x, y, z + rate)  # eq. 1b
        angular_acceleration = vector_from_components(a + rate * y, b - rate * x, c + acceleration)  # eq. 3b
    return LinkMotion(R, P, omega, angular_acceleration, alpha)


def _run_backward_pass(
    robot: Robot,
    bodies: AugmentedBodies,
    motions: list[LinkMotion],
    qdd: ScalarArray,
    external_wrenches: Mapping[int, ScalarArray],
) -> tuple[ScalarArray, ScalarArray]:
    """Joint forces (..., n), and the wrench on the base (..., 6) (eq. 7 to 10)."""
    joint_forces: list[ScalarArray] = []
    forces: list[ScalarArray | None] = [None] * len(robot.links)
    moments: list[ScalarArray | None] = [None] * len(robot.links)
    for j in range(len(robot.links) - 1, 0, -1):
        motion = motions[j]
        joint = robot.joints[j - 1]
        force, moment = _link_wrench(bodies, motion, j, external_wrenches)
        force = _sum(force, forces[j])
        moment = _sum(moment, moments[j])
        if joint.prismatic:
            force = force + bodies.masses[j] * motion.alpha  # f_j, eq. 8
        component = (force if joint.prismatic else moment)[..., 2:3]
        joint_forces.append(component + joint.rotor_inertia * qdd[..., j - 1 : j])  # eq. 10
        i = joint.antecedent
        transmitted_force = apply(motion.R, force)  # eq. 7b
        transmitted_moment = apply(motion.R, moment) + cross(motion.P, transmitted_force)  # eq. 9b, last term of 9a
        forces[i] = transmitted_force if forces[i] is None else forces[i] + transmitted_force
        moments[i] = transmitted_moment if moments[i] is None else moments[i] + transmitted_moment
    force, moment = _link_wrench(bodies, motions[0], 0, external_wrenches)
    force = _sum(force, forces[0])
    moment = _sum(moment, moments[0])
    wrench = screw(force + bodies.masses[0] * motions[0].alpha, moment)
    return concatenate_vectors(joint_forces[::-1]), wrench


def _link_wrench(
    bodies: AugmentedBodies, motion: LinkMotion, j: int, external_wrenches: Mapping[int, ScalarArray]
) -> tuple[ScalarArray, ScalarArray]:
    """Part of e_j and of the moment (..., 3) that the augmented body j itself requires."""
    first = bodies.first_moments[j]
    force = motion.times(first)  # e_j, eq. 7a
    moment = rotational_moment(bodies.second_moments[j], motion) + cross(first, motion.alpha)  # eq. 9a
    if j in external_wrenches:
        force = force + external_wrenches[j][..., :3]
        moment = moment + external_wrenches[j][..., 3:]
    return force, moment


def _sum(vector: ScalarArray, transmitted: ScalarArray | None) -> ScalarArray:
    """vector + transmitted (..., 3); None is zero."""
    return vector if transmitted is None else vector + transmitted


def rotational_moment(K: ScalarArray, motion: AngularMotion) -> ScalarArray:
    """k a + ω × k ω (..., 3) for a symmetric k (3, 3), with the fewest products of its entries."""
    a, b, c = components(motion.angular_acceleration)
    B = motion.B
    x = K[0, 0] * a + (K[2, 2] - K[1, 1]) * motion.yz - K[0, 1] * B[2][0] + K[0, 2] * B[1][0]
    y = K[1, 1] * b + (K[0, 0] - K[2, 2]) * motion.xz + K[0, 1] * B[2][1] - K[1, 2] * B[0][1]
    z = K[2, 2] * c + (K[1, 1] - K[0, 0]) * motion.xy - K[0, 2] * B[1][2] + K[1, 2] * B[0][2]
    return vector_from_components(
        x + K[1, 2] * (motion.yy - motion.zz),
        y + K[0, 2] * (motion.zz - motion.xx),
        z + K[0, 1] * (motion.xx - motion.yy),
    )
