"""The one recursion behind every tree model: three sweeps, in which each joint has either its acceleration or its
force given, and the base either its acceleration or, where nothing holds it, the wrench zero.

    every acceleration given, base fixed      inverse model                        Khalil, section 3.2
    every force given, base fixed             direct model, O(n)                   Khalil, section 3.3.2, eq. 36-42
    some forces given (elastic joints)        inverse model with elastic joints    Khalil, section 6, eq. 72-82
    base without a wrench                     inverse and direct, moving base      Khalil, sections 7.2 and 7.3
"""

from typing import NamedTuple

import numpy as np

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


class Solution(NamedTuple):
    """What the recursion finds.

    accelerations: q̈ (..., n) [rad/s² or m/s²]; forces: (..., n) joint forces without friction [N m or N];
    base_acceleration: 0V̇0 (..., 6), gravity taken off; wrenches: jf_j (..., n + 1, 6), what the antecedent exerts on
    link j, in frame j at its origin, and in the first row what the ground exerts on the base; folded: what the
    backward sweep left; base_pivots: the six pivots of 0J*0 where it was solved for the base's acceleration, else none.
    All of folded.resistances and base_pivots must be positive for the accelerations to mean anything.
    """

    accelerations: np.ndarray
    forces: np.ndarray
    base_acceleration: np.ndarray
    wrenches: np.ndarray
    backward_pass: "BackwardPass"
    base_pivots: list


def solve(robot, sweep, accelerations, forces, base_acceleration=None):
    """Second (backward) and third (forward) sweep.

    sweep: what `sweep_forward` left. accelerations, forces: for each joint one of the two (..., 1), the other None;
    forces are those of the actuators less friction. base_acceleration: 0V̇0 (..., 6), gravity taken off, or None where
    no ground holds the base.
    """
    backward_pass = run_backward_pass(robot, sweep, accelerations, forces, base_is_free=base_acceleration is None)
    base_pivots = []
    if base_acceleration is None:
        factors = linear.factor(backward_pass.articulated_inertias[0])
        base_acceleration = linear.solve(factors, backward_pass.betas[0])  # 0V̇0 = (0J*0)⁻¹ 0β*0, section 7.3
        base_pivots = factors[1]
    motion = propagate_accelerations(robot, sweep, backward_pass, accelerations, forces, base_acceleration)
    return Solution(*motion, backward_pass, base_pivots)


class BackwardPass(NamedTuple):
    """What the backward sweep leaves for each link: jJ*j (..., 6, 6) and jβ*j (..., 6); and, for the joints whose force
    is given, U = jJ*j ja_j (..., 6) and H_j (..., 1), else None."""

    articulated_inertias: list
    betas: list
    inertia_columns: list
    apparent_inertias: list


def run_backward_pass(robot, sweep, accelerations, forces, base_is_free):
    """Fold every link onto its antecedent, j = n..1 (Khalil, eq. 36-40, 72-78 and 103-108)."""
    backward_pass = BackwardPass(
        [link.inertia.spatial for link in robot.links],  # jJ*j starts as jJj
        list(sweep.betas),  # and jβ*j as jβj
        [None] * len(robot.links),
        [None] * len(robot.links),
    )
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        i = joint.antecedent
        J, beta, gamma = backward_pass.articulated_inertias[j], backward_pass.betas[j], sweep.gammas[j]
        if forces[j - 1] is None:
            K = J
            alpha = apply(J, gamma + axis_screw(joint, accelerations[j - 1])) - beta
        else:
            U = J[..., axis_row(joint)]
            H = axis_component(joint, U) + joint.rotor_inertia  # eq. 36
            K = J - U[..., :, None] * (U / H)[..., None, :]  # eq. 37
            alpha = apply(K, gamma) + U * ((forces[j - 1] + axis_component(joint, beta)) / H) - beta  # eq. 38
            backward_pass.inertia_columns[j], backward_pass.apparent_inertias[j] = U, H
        if i > 0 or base_is_free:
            R, P = sweep.rotations[j], sweep.positions[j]
            backward_pass.betas[i] = backward_pass.betas[i] - wrench_to_antecedent(R, P, alpha)  # eq. 39
            backward_pass.articulated_inertias[i] = backward_pass.articulated_inertias[i] + inertia_to_antecedent(
                R, P, K
            )  # eq. 40
    return backward_pass


def propagate_accelerations(robot, sweep, backward_pass, accelerations, forces, base_acceleration):
    """From the acceleration of the base to those of all links, and to what was asked of each joint, j = 1..n.

    Returns the first four fields of Solution.
    """
    link_accelerations, wrenches = [base_acceleration], [None]
    found_accelerations, found_forces = [], []
    ground = apply(robot.links[0].inertia.spatial, base_acceleration) - sweep.betas[0]
    for j, joint in enumerate(robot.joints, start=1):
        R, P = sweep.rotations[j], sweep.positions[j]
        J, beta = backward_pass.articulated_inertias[j], backward_pass.betas[j]
        V_dot = twist_to_successor(R, P, link_accelerations[joint.antecedent]) + sweep.gammas[j]
        if forces[j - 1] is None:
            acceleration = accelerations[j - 1]
        else:
            U, H = backward_pass.inertia_columns[j], backward_pass.apparent_inertias[j]
            acceleration = (forces[j - 1] + axis_component(joint, beta) - dot(U, V_dot)) / H  # eq. 41
        V_dot = V_dot + axis_screw(joint, acceleration)
        wrench = apply(J, V_dot) - beta  # jf_j = jJ*j jV̇j - jβ*j, which is eq. 42 with eq. 41 put in
        found_accelerations.append(acceleration)
        found_forces.append(
            axis_component(joint, wrench) + joint.rotor_inertia * acceleration  # eq. 82
            if forces[j - 1] is None
            else forces[j - 1]
        )
        link_accelerations.append(V_dot)
        wrenches.append(wrench)
        if joint.antecedent == 0:
            ground = ground + wrench_to_antecedent(R, P, wrench)
    wrenches[0] = ground
    return (
        concatenate_vectors(found_accelerations),
        concatenate_vectors(found_forces),
        base_acceleration,
        stack_vectors(wrenches),
    )
