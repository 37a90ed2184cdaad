"""Joints that depend linearly on others (mimic joints, gears): q_all = S q + offset."""

import numpy as np

from robot_dynamics.newton_euler import linear
from robot_dynamics.newton_euler.walker_orin import inertia_matrix


def coupling(robot):
    """(S, offset, independent): (joints, m) and (joints,), and the numbers of the m joints that depend on no other."""
    joints = len(robot.joints)
    independent = [number for number, (leader, _, _) in enumerate(robot.leaders) if leader == number]
    column = {number: place for place, number in enumerate(independent)}
    S, offset = np.zeros((joints, len(independent))), np.zeros(joints)
    for number, (leader, multiplier, shift) in enumerate(robot.leaders):
        S[number, column[leader]] = multiplier
        offset[number] = shift
    return S, offset, independent


def projection(S, base_rows):
    """From rows of all joints to rows of the independent ones, the rows of a moving base in front kept."""
    matrix = np.eye(base_rows + S.shape[0], base_rows + S.shape[1])
    matrix[base_rows:, base_rows:] = S
    return matrix


def coupled_accelerations(robot, S, q, unknown, accelerations, forces, bias):
    """(q̈ (..., m), pivots, diagonal): the accelerations of the independent joints, and what tells whether the matrix
    that gave them was positive definite: its pivots, a list, beside its diagonal (..., k).

    q: (..., joints) of all joints; unknown: numbers of the independent joints whose acceleration is unknown;
    accelerations: (..., m), those that are known; forces: (..., m) on the independent ones, Sᵀ Γ, those that count
    where the acceleration is unknown; bias: H (..., joints), or with the six rows of a moving base in front where its
    acceleration is unknown.

    The rows of the unknown accelerations of Sᵀ A S q̈ = Sᵀ (Γ - H): Khalil, section 4 (A_c and H_c by Walker and Orin)
    with a constant G = S; and section 6, second row of the general form, where only some are unknown.
    """
    rows = bias.shape[-1]
    base = rows - S.shape[0]
    P = projection(S, base)
    A = P.T @ inertia_matrix(robot, q)[..., -rows:, -rows:] @ P
    sought = np.array([*range(base), *(base + number for number in unknown)], dtype=int)
    found = np.zeros((*np.broadcast_shapes(bias.shape[:-1], forces.shape[:-1], accelerations.shape[:-1]), P.shape[1]))
    found[..., base:] = accelerations
    found[..., sought] = 0
    push = -bias @ P - (A @ found[..., None])[..., 0]
    push[..., base:] += forces
    A = A[..., sought[:, None], sought]
    factors = linear.factor(A)
    found[..., sought] = linear.solve(factors, push[..., sought])
    return found[..., base:], factors[1], np.diagonal(A, axis1=-2, axis2=-1)
