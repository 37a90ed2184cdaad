"""Inverse dynamic model by augmented bodies (Renaud), for trees: the recursion with the fewest operations.

The augmented bodies have constant parts of other bodies: a revolute link is left without mass, but for point masses at
joint origins that `augmented_bodies` chooses. With Renaud's m*_j, the mass of the subtree of a joint, the backward pass
then transmits only

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

from robot_dynamics.newton_euler.angular_motion import (
    angular_motion,
    angular_motion_from_axis,
    components,
    permuted_angular_motion,
    vector_from_components,
)
from robot_dynamics.newton_euler.augmented_bodies import augmented_bodies, has_constant_orientation, is_not_zero
from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.screw import apply, apply_transposed, concatenate_vectors, cross, screw

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.newton_euler.angular_motion import AngularMotion
    from robot_dynamics.newton_euler.augmented_bodies import AugmentedBodies


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
    rotates = any(is_not_zero(entry) for motion in motions for row in motion.angular.B for entry in row)
    return _run_backward_pass(robot, augmented_bodies(robot, rotates), motions, qdd, external_wrenches)


class LinkMotion(NamedTuple):
    """Motion of a link, in frame j.

    Attributes
    ----------
    R, P : ndarray, shape (..., 3, 3) and (..., 3)
        iRj and iPj, for the base the identity and zero.
    angular : AngularMotion
    alpha : ndarray, shape (..., 3)
        α_j, the acceleration of O_j with gravity subtracted.
    """

    R: ScalarArray
    P: ScalarArray
    angular: AngularMotion
    alpha: ScalarArray


def link_motions(
    robot: Robot,
    q: ScalarArray,
    qd: ScalarArray,
    qdd: ScalarArray,
    base_twist: ScalarArray,
    base_acceleration: ScalarArray,
    for_all_parameters: bool = False,
) -> list[LinkMotion]:
    """LinkMotion of each link by link number (eq. 1 to 6); arguments as for `inverse_dynamics`.

    for_all_parameters: whether the effects of all inertial parameters are computed, not only of those of the robot.
    """
    angular = angular_motion(base_twist[..., 3:], base_acceleration[..., 3:])
    base = LinkMotion(np.eye(3), np.zeros(3), angular, base_acceleration[..., :3])
    motions = [base]
    for j, joint in enumerate(robot.joints, start=1):
        position = q[..., j - 1 : j]
        reads_difference = for_all_parameters or is_not_zero(robot.links[j].inertia.second_moments[0, 2])
        motions.append(
            _successor_motion(
                joint, motions[joint.antecedent], position, qd[..., j - 1], qdd[..., j - 1], reads_difference
            )
        )
    return motions


def _successor_motion(
    joint: Joint,
    antecedent: LinkMotion,
    position: ScalarArray,
    rate: ScalarArray,
    acceleration: ScalarArray,
    reads_difference: bool,
) -> LinkMotion:
    """Motion of the link that a joint moves, from that of its antecedent (eq. 1 to 6).

    reads_difference: see `angular_motion_from_axis`.
    """
    R, P = joint_placement(joint, position)
    alpha = apply_transposed(R, antecedent.alpha + antecedent.angular.times(P))  # eq. 6a, 6b
    if not joint.prismatic:
        angular = _turned_motion(joint, R, antecedent.angular, rate, acceleration, reads_difference)
        return LinkMotion(R, P, angular, alpha)
    if _permutes_axes(joint):
        angular = permuted_angular_motion(R, antecedent.angular)
    else:
        vectors = antecedent.angular.omega, antecedent.angular.angular_acceleration
        angular = angular_motion(*(apply_transposed(R, vector) for vector in vectors))
    x, y, _ = components(angular.omega)
    alpha = alpha + vector_from_components(2 * rate * y, -2 * rate * x, acceleration)  # eq. 5, 6c
    return LinkMotion(R, P, angular, alpha)


def _turned_motion(
    joint: Joint,
    R: ScalarArray,
    antecedent: AngularMotion,
    rate: ScalarArray,
    acceleration: ScalarArray,
    reads_difference: bool,
) -> AngularMotion:
    """AngularMotion of the link that a revolute joint turns, from that of its antecedent (eq. 1 to 3)."""
    x, y, z = components(apply_transposed(R, antecedent.omega))  # eq. 1a
    omega = vector_from_components(x, y, z + rate)  # eq. 1b
    if _permutes_axes(joint):
        axis = joint.rotation[..., 2]
        spin = apply_transposed(joint.rotation, antecedent.angular_acceleration)[..., 2] + acceleration
        return angular_motion_from_axis(omega, apply_transposed(R, antecedent.times(axis)), spin, reads_difference)
    a, b, c = components(apply_transposed(R, antecedent.angular_acceleration))  # eq. 3a
    return angular_motion(omega, vector_from_components(a + rate * y, b - rate * x, c + acceleration))  # eq. 3b


def _permutes_axes(joint: Joint) -> bool:
    """Whether the axes of a joint's frame at position zero are those of its antecedent, in any order and direction."""
    return has_constant_orientation(joint) and bool(np.isin(joint.rotation.astype(float), (-1.0, 0.0, 1.0)).all())


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
            force = force + bodies.inertias[j].mass * motion.alpha  # f_j, eq. 8
        component = (force if joint.prismatic else moment)[..., 2:3]
        joint_forces.append(component + joint.rotor_inertia * qdd[..., j - 1 : j])  # eq. 10
        i = joint.antecedent
        transmitted_force = apply(motion.R, force)  # eq. 7b
        if bodies.point_masses[j] != 0:
            acceleration = motions[i].alpha + motions[i].angular.times(motion.P)  # of O_j, in frame i
            transmitted_force = transmitted_force + bodies.point_masses[j] * acceleration
        transmitted_moment = apply(motion.R, moment) + cross(motion.P, transmitted_force)  # eq. 9b, last term of 9a
        forces[i] = transmitted_force if forces[i] is None else forces[i] + transmitted_force
        moments[i] = transmitted_moment if moments[i] is None else moments[i] + transmitted_moment
    force, moment = _link_wrench(bodies, motions[0], 0, external_wrenches)
    force = _sum(force, forces[0])
    moment = _sum(moment, moments[0])
    wrench = screw(force + bodies.inertias[0].mass * motions[0].alpha, moment)
    return concatenate_vectors(joint_forces[::-1]), wrench


def _link_wrench(
    bodies: AugmentedBodies, motion: LinkMotion, j: int, external_wrenches: Mapping[int, ScalarArray]
) -> tuple[ScalarArray, ScalarArray]:
    """Part of e_j and of the moment (..., 3) that the augmented body j itself requires."""
    first = bodies.inertias[j].first_moments
    second = bodies.inertias[j].second_moments
    moment = (
        flat_moment(second, first, motion.angular) if bodies.is_flat[j] else rotational_moment(second, motion.angular)
    )
    force = motion.angular.times(first)  # e_j, eq. 7a
    moment = moment + cross(first, motion.alpha)  # eq. 9a
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
    yy_zz, zz_xx, xx_yy = motion.differences
    return vector_from_components(x + K[1, 2] * yy_zz, y + K[0, 2] * zz_xx, z + K[0, 1] * xx_yy)


def flat_moment(K: ScalarArray, first: ScalarArray, motion: AngularMotion) -> ScalarArray:
    """k a + ω × k ω (..., 3) for a symmetric k (3, 3) with k_xx + k_yy = k_zz.

    No part of k a is then computed apart: the sums are those of the entries of B.
    """
    B = motion.B
    yy_zz, zz_xx, xx_yy = motion.differences
    reads_both = (is_not_zero(first[0]) or is_not_zero(K[0, 2])) and (is_not_zero(first[1]) or is_not_zero(K[1, 2]))
    x = K[0, 0] * B[2][1] - K[0, 1] * B[2][0] + K[0, 2] * B[1][0] + K[1, 2] * yy_zz
    y = K[0, 1] * B[2][1] - K[1, 1] * B[2][0] - K[1, 2] * B[0][1] + K[0, 2] * zz_xx
    if reads_both or not (is_not_zero(K[0, 0]) and is_not_zero(K[1, 1])):
        spin = K[1, 1] * B[1][0] - K[0, 0] * B[0][1]
    else:
        spin = (K[0, 0] + K[1, 1]) * motion.angular_acceleration[..., 2] + (K[1, 1] - K[0, 0]) * motion.xy
    z = spin - K[0, 2] * B[1][2] + K[1, 2] * B[0][2] + K[0, 1] * xx_yy
    return vector_from_components(x, y, z)
