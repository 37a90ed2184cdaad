"""The inverse dynamic model by augmented bodies (Renaud), for trees: the recursion with the fewest operations.

The augmented body j is link j and, for each turning joint k that hangs on it, the mass m*_k of all that this joint
carries, as a point at O_k. Its moments are constant, so that masses meet accelerations once for each link and not once
for each pair of links. In the backward sweep only

    e_j = f_j - m*_j α_j,   α_j the acceleration of O_j with gravity taken off

is handed down, since the moments of the augmented body below have the other part already. A sliding joint moves its
point of mass: it hands down the whole f_j, which is cheaper than moments that vary.

With B_j = [ω̇_j] + [ω_j][ω_j] ([·] the matrix of the vector product) a point at r has the acceleration α_j + B_j r.

Source: Renaud, equations 0 to 10, for simple chains; trees, the moving base and sliding joints as told here.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.kinematics import joint_placement
from robot_dynamics.newton_euler.screw import apply, apply_transposed, concatenate_vectors, cross, screw


class AugmentedBodies(NamedTuple):
    """Of each link's augmented body, by link number: m*; first moments u* (3,); second moments k* (3, 3) about O_j."""

    masses: list
    first_moments: list
    second_moments: list


def augmented_bodies(robot):
    """The AugmentedBodies of a robot, constant."""
    masses = [link.inertia.mass for link in robot.links]
    first = [link.inertia.first_moments for link in robot.links]
    second = [link.inertia.second_moments for link in robot.links]
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        i, mass, P = joint.antecedent, masses[j], joint.placement[:3, 3]
        if not joint.prismatic:
            masses[i] = masses[i] + mass
            first[i] = first[i] + mass * P  # u* = u + m* p
            square = P[0] * P[0] + P[1] * P[1] + P[2] * P[2]
            second[i] = second[i] + mass * (square * np.eye(3, dtype=int) - P[:, None] * P)  # k* = k - m* p̂ p̂
    return AugmentedBodies(masses, first, second)


def inverse_dynamics(robot, q, qd, qdd, base_twist, base_acceleration, external_wrenches):
    """Joint forces (..., n) [N m or N] of a motion, friction not counted, and the wrench that holds the base (..., 6).

    q, qd, qdd: (..., n); base_twist: 0V0 and base_acceleration: 0V̇0 (..., 6), gravity taken off, in frame 0;
    external_wrenches: {link number: jf_e (..., 6)}, what the link does to its environment, in frame j at its origin.
    """
    motions = link_motions(robot, q, qd, qdd, base_twist, base_acceleration)
    return _backward(robot, augmented_bodies(robot), motions, qdd, external_wrenches)


def link_motions(robot, q, qd, qdd, base_twist, base_acceleration):
    """The Motion of each link, a list by link number; arguments as for `inverse_dynamics` (eq. 1 to 6)."""
    motions = [LinkMotion(None, None, base_twist[..., 3:], base_acceleration[..., 3:], base_acceleration[..., :3])]
    for j, joint in enumerate(robot.joints, start=1):
        column = slice(j - 1, j)
        motions.append(_moved(joint, motions[joint.antecedent], q[..., column], qd[..., j - 1], qdd[..., j - 1]))
    return motions


class AngularMotion:
    """How a link turns.

    omega: ω_j, turning: its derivative a_j (..., 3), in the same axes; xx, xy, ... the products of components of ω_j;
    B: B_j.
    """

    def __init__(self, omega, angular_acceleration):
        self.omega, self.angular_acceleration = omega, angular_acceleration
        x, y, z = _entries(omega)
        a, b, c = _entries(angular_acceleration)
        self.xx, self.yy, self.zz, self.xy, self.xz, self.yz = x * x, y * y, z * z, x * y, x * z, y * z  # eq. 2
        self.B = [  # eq. 4
            [-(self.yy + self.zz), self.xy - c, self.xz + b],
            [self.xy + c, -(self.xx + self.zz), self.yz - a],
            [self.xz - b, self.yz + a, -(self.xx + self.yy)],
        ]

    def times(self, r):
        """B_j r, for a vector (..., 3)."""
        x, y, z = _entries(r)
        return _vector(*(row[0] * x + row[1] * y + row[2] * z for row in self.B))


class LinkMotion(AngularMotion):
    """How a link moves: turning, and besides R, P: iRj (..., 3, 3) and iPj (..., 3); alpha: α_j (..., 3), the
    acceleration of O_j with gravity taken off. All in frame j."""

    def __init__(self, R, P, omega, angular_acceleration, alpha):
        super().__init__(omega, angular_acceleration)
        self.R, self.P, self.alpha = R, P, alpha


def _moved(joint, carrier, position, rate, acceleration):
    """The Motion of the link that a joint moves, from that of its antecedent (eq. 1 to 6)."""
    R, P = joint_placement(joint, position)
    omega = apply_transposed(R, carrier.omega)  # eq. 1a
    angular_acceleration = apply_transposed(R, carrier.angular_acceleration)  # eq. 3a
    alpha = apply_transposed(R, carrier.alpha + carrier.times(P))  # eq. 6a, 6b
    x, y, z = _entries(omega)
    a, b, c = _entries(angular_acceleration)
    if joint.prismatic:
        alpha = alpha + _vector(2 * rate * y, -2 * rate * x, acceleration)  # eq. 5, 6c
    else:
        omega = _vector(x, y, z + rate)  # eq. 1b
        angular_acceleration = _vector(a + rate * y, b - rate * x, c + acceleration)  # eq. 3b
    return LinkMotion(R, P, omega, angular_acceleration, alpha)


def _backward(robot, bodies, motions, qdd, external_wrenches):
    """Joint forces, and the wrench on the base (eq. 7 to 10)."""
    forces = [None] * len(robot.joints)
    pushes, moments = [None] * len(robot.links), [None] * len(robot.links)
    for j in range(len(robot.links) - 1, -1, -1):
        motion, first = motions[j], bodies.first_moments[j]
        push = motion.times(first)  # e_j, eq. 7a
        moment = rotational_moment(bodies.second_moments[j], motion) + cross(first, motion.alpha)  # eq. 9a
        if j in external_wrenches:
            push, moment = push + external_wrenches[j][..., :3], moment + external_wrenches[j][..., 3:]
        push = push if pushes[j] is None else push + pushes[j]
        moment = moment if moments[j] is None else moment + moments[j]
        if j == 0:
            return concatenate_vectors(forces), screw(push + bodies.masses[0] * motion.alpha, moment)
        joint = robot.joints[j - 1]
        if joint.prismatic:
            push = push + bodies.masses[j] * motion.alpha  # f_j, eq. 8
        along = (push if joint.prismatic else moment)[..., 2:3]
        forces[j - 1] = along + joint.rotor_inertia * qdd[..., j - 1 : j]  # eq. 10
        i, force = joint.antecedent, apply(motion.R, push)  # eq. 7b
        turned = apply(motion.R, moment) + cross(motion.P, force)  # eq. 9b and the last term of 9a
        pushes[i] = force if pushes[i] is None else pushes[i] + force
        moments[i] = turned if moments[i] is None else moments[i] + turned


def rotational_moment(K, motion):
    """k a + ω × k ω (..., 3), for a symmetric k (3, 3), each entry of k used as few times as can be."""
    a, b, c = _entries(motion.angular_acceleration)
    B = motion.B
    x = K[0, 0] * a + (K[2, 2] - K[1, 1]) * motion.yz - K[0, 1] * B[2][0] + K[0, 2] * B[1][0]
    y = K[1, 1] * b + (K[0, 0] - K[2, 2]) * motion.xz + K[0, 1] * B[2][1] - K[1, 2] * B[0][1]
    z = K[2, 2] * c + (K[1, 1] - K[0, 0]) * motion.xy - K[0, 2] * B[1][2] + K[1, 2] * B[0][2]
    return _vector(
        x + K[1, 2] * (motion.yy - motion.zz),
        y + K[0, 2] * (motion.zz - motion.xx),
        z + K[0, 1] * (motion.xx - motion.yy),
    )


def _entries(vector):
    return vector[..., 0], vector[..., 1], vector[..., 2]


def _vector(*entries):
    return np.stack(np.broadcast_arrays(*entries), axis=-1)
