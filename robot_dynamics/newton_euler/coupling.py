"""Joints that depend linearly on others (mimic joints, gears): q_all = S q + offset."""

import numpy as np

from robot_dynamics.newton_euler import linear
from robot_dynamics.newton_euler.walker_orin import inertia_matrix


def coupling(robot):
    """(S, offset, independent): (joints, m) and (joints,), and the numbers of the m joints that depend on no other."""
    joints = len(robot.joints)
    independent = [number for number, (leader, _, _) in enumerate(robot.leaders) if leader == number]
    S, offset = np.zeros((joints, len(independent))), np.zeros(joints)
    for number, (leader, multiplier, shift) in enumerate(robot.leaders):
        S[number, independent.index(leader)] = multiplier
        offset[number] = shift
    return S, offset, independent


def coupled_accelerations(robot, S, q, forces, bias):
    """(q̈ (..., m), pivots, diagonal): the accelerations of the independent joints, and what tells whether the matrix
    that gave them was positive definite: its pivots, a list, beside its diagonal (..., k).

    q: (..., joints) of all joints; forces: (..., m) on the independent ones, Sᵀ Γ; bias: H (..., joints), or with the
    six rows of a moving base in front where its acceleration is unknown.

    The direct model by projection, Sᵀ A S q̈ = Sᵀ (Γ - H): Khalil, section 4 (A_c and H_c by Walker and Orin) with a
    constant G = S.
    """
    base = bias.shape[-1] - S.shape[0]
    projection = np.eye(base + S.shape[0], base + S.shape[1])
    projection[base:, base:] = S
    rows = projection.shape[0]
    A = projection.T @ inertia_matrix(robot, q)[..., -rows:, -rows:] @ projection
    push = -bias @ projection
    push[..., base:] += forces
    factors = linear.factor(A)
    return linear.solve(factors, push)[..., base:], factors[1], np.diagonal(A, axis1=-2, axis2=-1)
