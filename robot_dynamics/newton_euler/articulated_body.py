"""Articulated-body recursion with prescribed accelerations or forces, for every model of a tree.

Three passes, in which each joint has either its acceleration or its force prescribed, and the base either its
acceleration or, where it moves freely, the wrench zero.

    every acceleration prescribed, base fixed      inverse model                        Khalil, section 3.2
    every force prescribed, base fixed             direct model, O(n)                   Khalil, section 3.3.2, eq. 36-42
    some forces prescribed (elastic joints)        inverse model with elastic joints    Khalil, section 6, eq. 72-82
    base without a wrench                          inverse and direct, moving base      Khalil, sections 7.2 and 7.3
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.newton_euler import linear
from robot_dynamics.newton_euler.kinematics import axis_component, axis_row, axis_screw
from robot_dynamics.newton_euler.screw import (
    apply,
    concatenate_vectors,
    dot,
    inertia_to_antecedent,
    stack_vectors,
    twist_to_successor,
    wrench_to_antecedent,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.newton_euler.kinematics import ForwardPass


class BackwardPass(NamedTuple):
    """Results of the backward pass for links 0..n, as lists by link number.

    Attributes
    ----------
    articulated_inertias : list of ndarray
        jJ*j (..., 6, 6).
    betas : list of ndarray
        Bias wrenches jβ*j (..., 6).
    inertia_columns : list of ndarray or None
        U = jJ*j ja_j (..., 6) of joints with prescribed force, else None.
    apparent_inertias : list of ndarray or None
        H_j (..., 1) of joints with prescribed force, else None.
    """

    articulated_inertias: list[ScalarArray]
    betas: list[ScalarArray]
    inertia_columns: list[ScalarArray | None]
    apparent_inertias: list[ScalarArray | None]


class Solution(NamedTuple):
    """Result of `solve`.

    Attributes
    ----------
    accelerations : ndarray, shape (..., n)
        q̈ [rad/s² or m/s²].
    forces : ndarray, shape (..., n)
        Joint forces [N m or N], friction not counted.
    base_acceleration : ndarray, shape (..., 6)
        0V̇0, gravity subtracted.
    wrenches : ndarray, shape (..., n + 1, 6)
        jf_j, the wrench that the antecedent exerts on link j, in frame j at its origin; in the first row the wrench
        that the ground exerts on the base.
    backward_pass : BackwardPass
    base_pivots : list of ndarray
        The six pivots of 0J*0 where the acceleration of the base was solved, else none.

    Notes
    -----
    Accelerations are valid only where all `backward_pass.apparent_inertias` and `base_pivots` are positive.
    """

    accelerations: ScalarArray
    forces: ScalarArray
    base_acceleration: ScalarArray
    wrenches: ScalarArray
    backward_pass: BackwardPass
    base_pivots: list[ScalarArray]


def solve(
    robot: Robot,
    forward_pass: ForwardPass,
    accelerations: Sequence[ScalarArray | None],
    forces: Sequence[ScalarArray | None],
    base_acceleration: ScalarArray | None = None,
) -> Solution:
    """Backward and second forward pass.

    Parameters
    ----------
    robot : Robot
    forward_pass : ForwardPass
    accelerations, forces : sequence of ndarray or None
        For each joint one of the two (..., 1), the other None. Forces are those of the actuators, without friction.
    base_acceleration : ndarray, shape (..., 6), optional
        0V̇0, gravity subtracted. None where the base moves freely.
    """
    base_is_free = base_acceleration is None
    backward_pass = run_backward_pass(robot, forward_pass, accelerations, forces, base_is_free)
    base_pivots: list[ScalarArray] = []
    if base_acceleration is None:
        factors = linear.factor(backward_pass.articulated_inertias[0])
        base_acceleration = linear.solve(factors, backward_pass.betas[0])  # 0V̇0 = (0J*0)⁻¹ 0β*0, section 7.3
        base_pivots = factors[1]
    motion = propagate_accelerations(robot, forward_pass, backward_pass, accelerations, forces, base_acceleration)
    return Solution(*motion, backward_pass, base_pivots)


def run_backward_pass(
    robot: Robot,
    forward_pass: ForwardPass,
    accelerations: Sequence[ScalarArray | None],
    forces: Sequence[ScalarArray | None],
    base_is_free: bool,
) -> BackwardPass:
    """Add the articulated inertia of every link to that of its antecedent, j = n..1.

    Source: Khalil, eq. 36-40, 72-78 and 103-108.
    """
    backward_pass = BackwardPass(
        [link.inertia.spatial for link in robot.links],  # jJ*j starts as jJj
        list(forward_pass.betas),  # and jβ*j as jβj
        [None] * len(robot.links),
        [None] * len(robot.links),
    )
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        i = joint.antecedent
        J = backward_pass.articulated_inertias[j]
        beta = backward_pass.betas[j]
        gamma = forward_pass.gammas[j]
        force = forces[j - 1]
        if force is None:
            K = J
            alpha = apply(J, gamma + axis_screw(joint, _prescribed(accelerations, j))) - beta
        else:
            U = J[..., axis_row(joint)]
            H = axis_component(joint, U) + joint.rotor_inertia  # eq. 36
            K = J - U[..., :, None] * (U / H)[..., None, :]  # eq. 37
            alpha = apply(K, gamma) + U * ((force + axis_component(joint, beta)) / H) - beta  # eq. 38
            backward_pass.inertia_columns[j] = U
            backward_pass.apparent_inertias[j] = H
        if i > 0 or base_is_free:
            R = forward_pass.rotations[j]
            P = forward_pass.positions[j]
            wrench = wrench_to_antecedent(R, P, alpha)
            backward_pass.betas[i] = backward_pass.betas[i] - wrench  # eq. 39
            inertia = inertia_to_antecedent(R, P, K)
            backward_pass.articulated_inertias[i] = backward_pass.articulated_inertias[i] + inertia  # eq. 40
    return backward_pass


def propagate_accelerations(
    robot: Robot,
    forward_pass: ForwardPass,
    backward_pass: BackwardPass,
    accelerations: Sequence[ScalarArray | None],
    forces: Sequence[ScalarArray | None],
    base_acceleration: ScalarArray,
) -> tuple[ScalarArray, ScalarArray, ScalarArray, ScalarArray]:
    """Second forward pass: accelerations, joint forces and wrenches from the acceleration of the base, j = 1..n.

    Returns the first four fields of Solution.
    """
    link_accelerations = [base_acceleration]
    wrenches: list[ScalarArray] = []
    joint_accelerations: list[ScalarArray] = []
    joint_forces: list[ScalarArray] = []
    ground: ScalarArray = apply(robot.links[0].inertia.spatial, base_acceleration) - forward_pass.betas[0]
    for j, joint in enumerate(robot.joints, start=1):
        R = forward_pass.rotations[j]
        P = forward_pass.positions[j]
        J = backward_pass.articulated_inertias[j]
        beta = backward_pass.betas[j]
        U = backward_pass.inertia_columns[j]
        H = backward_pass.apparent_inertias[j]
        force = forces[j - 1]
        V_dot = twist_to_successor(R, P, link_accelerations[joint.antecedent]) + forward_pass.gammas[j]
        if force is None or U is None or H is None:
            acceleration = _prescribed(accelerations, j)
        else:
            acceleration = (force + axis_component(joint, beta) - dot(U, V_dot)) / H  # eq. 41
        V_dot = V_dot + axis_screw(joint, acceleration)
        wrench = apply(J, V_dot) - beta  # jf_j = jJ*j jV̇j - jβ*j, which is eq. 42 with eq. 41 inserted
        if force is None:
            force = axis_component(joint, wrench) + joint.rotor_inertia * acceleration  # eq. 82
        joint_accelerations.append(acceleration)
        joint_forces.append(force)
        link_accelerations.append(V_dot)
        wrenches.append(wrench)
        if joint.antecedent == 0:
            ground = ground + wrench_to_antecedent(R, P, wrench)
    return (
        concatenate_vectors(joint_accelerations),
        concatenate_vectors(joint_forces),
        base_acceleration,
        stack_vectors([ground, *wrenches]),
    )


def _prescribed(accelerations: Sequence[ScalarArray | None], j: int) -> ScalarArray:
    """Prescribed acceleration (..., 1) of joint j."""
    acceleration = accelerations[j - 1]
    assert acceleration is not None, f"joint {j} has neither an acceleration nor a force"
    return acceleration
