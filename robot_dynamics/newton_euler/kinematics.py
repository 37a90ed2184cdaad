"""Forward pass: placements and velocities of links, and the parts of accelerations and wrenches that depend on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.joint_placement import joint_placement
from robot_dynamics.newton_euler.screw import apply, apply_transposed, cross, screw, twist_to_successor

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Link, Robot


class ForwardPass(NamedTuple):
    """Results of the forward pass for links 0..n, as lists by link number.

    Attributes
    ----------
    rotations, positions : list of ndarray
        iRj (..., 3, 3) and iPj (..., 3), for the base the identity and zero.
    velocities : list of ndarray
        jVj (..., 6).
    gammas : list of ndarray
        jγj (..., 6), the acceleration that depends on velocities only, for the base zero.
    betas : list of ndarray
        jβj (..., 6), the wrench that external wrenches and velocities require, with the opposite sign.
    """

    rotations: list[ScalarArray]
    positions: list[ScalarArray]
    velocities: list[ScalarArray]
    gammas: list[ScalarArray]
    betas: list[ScalarArray]


def velocity_wrench(link: Link, V: ScalarArray) -> ScalarArray:
    """[ω × (ω × MS); ω × (J ω)] (..., 6): wrench that the twist V (..., 6) of a link requires (Khalil, section 3)."""
    omega = V[..., 3:]
    inertia = link.inertia
    return screw(
        cross(omega, cross(omega, inertia.first_moments)),
        cross(omega, omega @ inertia.second_moments),  # J is symmetric
    )


def run_forward_pass(
    robot: Robot,
    q: ScalarArray,
    qd: ScalarArray,
    base_twist: ScalarArray,
    external_wrenches: Mapping[int, ScalarArray],
) -> ForwardPass:
    """Forward recursive equations, j = 1..n.

    Parameters
    ----------
    robot : Robot
    q, qd : ndarray, shape (..., n)
        Joint positions [rad or m] and velocities.
    base_twist : ndarray, shape (..., 6)
        0V0, in frame 0.
    external_wrenches : mapping of int to ndarray
        jf_e (..., 6) by link number: what the link exerts on its environment, in frame j at its origin.

    Notes
    -----
    Source: Khalil, section 3.2 and first step of sections 3.3.2, 7.2 and 7.3.
    """
    forward_pass = ForwardPass(
        [np.eye(3)], [np.zeros(3)], [base_twist], [np.zeros(6)], [_beta(robot, 0, base_twist, external_wrenches)]
    )
    for j, joint in enumerate(robot.joints, start=1):
        R, P = joint_placement(joint, q[..., j - 1 : j])
        V_i = forward_pass.velocities[joint.antecedent]
        V = twist_to_successor(R, P, V_i)  # jTi iVi, to which q̇ ja is added below
        rate = qd[..., j - 1 : j]
        omega_i = V_i[..., 3:]
        centripetal = apply_transposed(R, cross(omega_i, cross(omega_i, P)))
        # jωi × q̇ z, where z = (0, 0, 1)
        gyroscopic = rate * np.stack([V[..., 4], -V[..., 3], np.zeros_like(V[..., 3])], axis=-1)
        if joint.prismatic:
            gamma = screw(centripetal + 2 * gyroscopic, np.zeros(3))
        else:
            gamma = screw(centripetal, gyroscopic)
        V = V + axis_screw(joint, rate)
        forward_pass.rotations.append(R)
        forward_pass.positions.append(P)
        forward_pass.velocities.append(V)
        forward_pass.gammas.append(gamma)
        forward_pass.betas.append(_beta(robot, j, V, external_wrenches))
    return forward_pass


def _beta(robot: Robot, j: int, V: ScalarArray, external_wrenches: Mapping[int, ScalarArray]) -> ScalarArray:
    """jβj = -jf_ej - [ω × (ω × MS); ω × (J ω)]."""
    beta = -velocity_wrench(robot.links[j], V)
    return beta - external_wrenches[j] if j in external_wrenches else beta


def axis_row(joint: Joint) -> int:
    """Index of the 1 in the unit twist ja_j: 2 for a prismatic joint, 5 for a revolute one."""
    return 2 if joint.prismatic else 5


def axis_component(joint: Joint, screws: ScalarArray) -> ScalarArray:
    """ja_jᵀ times screws (..., 6): their component (..., 1) along the joint axis."""
    row = axis_row(joint)
    return screws[..., row : row + 1]


def axis_screw(joint: Joint, value: ScalarArray) -> ScalarArray:
    """ja_j times a value (..., 1): a screw (..., 6) along the joint axis."""
    unit = np.zeros(6, int)
    unit[axis_row(joint)] = 1
    result: ScalarArray = unit * value
    return result


def link_placements(robot: Robot, q: ScalarArray) -> list[tuple[ScalarArray, ScalarArray]]:
    """0Rj (..., 3, 3) and 0Pj (..., 3) of every link frame in frame 0, by link number."""
    placements: list[tuple[ScalarArray, ScalarArray]] = [(np.eye(3), np.zeros(3))]
    for j, joint in enumerate(robot.joints, start=1):
        R, P = joint_placement(joint, q[..., j - 1 : j])
        R_i, P_i = placements[joint.antecedent]
        placements.append((R_i @ R, P_i + apply(R_i, P)))
    return placements
