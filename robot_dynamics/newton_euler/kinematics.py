"""The first forward sweep: placements, velocities, and what of accelerations and wrenches no unknown enters."""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.screw import apply, apply_transposed, cross, screw, twist_to_successor


class ForwardPass(NamedTuple):
    """What the forward sweep leaves for each link 0..n, lists indexed by link number.

    rotations, positions: iRj (..., 3, 3) and iPj (..., 3), link 0 has none; velocities: jVj (..., 6);
    gammas: jγj (..., 6), the acceleration that neither q̈_j nor the antecedent's acceleration causes;
    betas: jβj (..., 6), what external wrenches and velocities demand of the link's own wrench.
    """

    rotations: list
    positions: list
    velocities: list
    gammas: list
    betas: list


def joint_placement(joint, position):
    """iRj (..., 3, 3) and iPj (..., 3) of a joint's frame in its antecedent's, for joint positions (..., 1).

    iTj(q) = iTj(0) Rot(z, q) for a revolute joint, iTj(0) Trans(z, q) for a prismatic one.
    """
    R, P = joint.rotation, joint.placement[:3, 3]
    if joint.prismatic:
        return R, P + position * R[..., 2]
    cosine, sine = np.cos(position), np.sin(position)
    x = cosine * R[..., 0] + sine * R[..., 1]
    y = cosine * R[..., 1] - sine * R[..., 0]
    return np.stack(np.broadcast_arrays(x, y, R[..., 2]), axis=-1), P


def velocity_wrench(link, V):
    """[ω × (ω × MS); ω × (J ω)] of a link: the wrench that its velocity alone demands (Khalil, section 3)."""
    omega = V[..., 3:]
    inertia = link.inertia
    return screw(
        cross(omega, cross(omega, inertia.first_moments)),
        cross(omega, omega @ inertia.second_moments),  # J is symmetric
    )


def run_forward_pass(robot, q, qd, base_twist, external_wrenches):
    """Forward recursive equations, j = 1..n.

    q, qd: (..., n) joint positions [rad or m] and velocities. base_twist: 0V0 (..., 6), in frame 0.
    external_wrenches: {link number: jf_e (..., 6)}, what the link does to its environment, in frame j at its origin.

    Source: Khalil, section 3.2 and first step of sections 3.3.2, 7.2 and 7.3.
    """
    sweep = ForwardPass([None], [None], [base_twist], [None], [_beta(robot, 0, base_twist, external_wrenches)])
    for j, joint in enumerate(robot.joints, start=1):
        R, P = joint_placement(joint, q[..., j - 1 : j])
        V_i = sweep.velocities[joint.antecedent]
        V = twist_to_successor(R, P, V_i)  # jTi iVi, to which q̇ ja is added below
        rate = qd[..., j - 1 : j]
        omega_i = V_i[..., 3:]
        centripetal = apply_transposed(R, cross(omega_i, cross(omega_i, P)))
        # jωi × q̇ z, where z = (0, 0, 1)
        turning = rate * np.stack([V[..., 4], -V[..., 3], np.zeros_like(V[..., 3])], axis=-1)
        if joint.prismatic:
            gamma = screw(centripetal + 2 * turning, np.zeros(3))
        else:
            gamma = screw(centripetal, turning)
        V = V + axis_screw(joint, rate)
        sweep.rotations.append(R)
        sweep.positions.append(P)
        sweep.velocities.append(V)
        sweep.gammas.append(gamma)
        sweep.betas.append(_beta(robot, j, V, external_wrenches))
    return sweep


def _beta(robot, j, V, external_wrenches):
    """jβj = -jf_ej - [ω × (ω × MS); ω × (J ω)]."""
    beta = -velocity_wrench(robot.links[j], V)
    return beta - external_wrenches[j] if j in external_wrenches else beta


def axis_row(joint):
    """Where the 1 stands in the unit twist ja_j of a joint: 2 if it moves along z_j, 5 if it turns about it."""
    return 2 if joint.prismatic else 5


def axis_component(joint, screws):
    """ja_jᵀ times screws (..., 6): their component (..., 1) along the axis of the joint."""
    row = axis_row(joint)
    return screws[..., row : row + 1]


def axis_screw(joint, value):
    """ja_j times a value (..., 1): a screw (..., 6) along the axis of the joint."""
    unit = np.zeros(6, int)
    unit[axis_row(joint)] = 1
    return unit * value


def link_placements(robot, q):
    """0Rj (..., 3, 3) and 0Pj (..., 3) of every link frame in frame 0, a list of pairs indexed by link number."""
    placements = [(np.eye(3), np.zeros(3))]
    for j, joint in enumerate(robot.joints, start=1):
        R, P = joint_placement(joint, q[..., j - 1 : j])
        R_i, P_i = placements[joint.antecedent]
        placements.append((R_i @ R, P_i + apply(R_i, P)))
    return placements
