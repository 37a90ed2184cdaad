"""Joints that depend linearly on others (mimic joints, gears): q_all = S q + offset."""

import numpy as np

from robot_dynamics.newton_euler import linear
from robot_dynamics.newton_euler.composite import inertia_matrix


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
    """(accelerations, pivots, diagonal): [V̇0; q̈] (..., 6 + m) of a moving base and the independent joints, or q̈
    (..., m) alone; and what tells whether the matrix that gave them was positive definite: its pivots, a list, beside
    its diagonal (..., k).

    q: (..., joints) of all joints; unknown: numbers of the independent joints whose acceleration is unknown;
    accelerations: (..., m), those that are known; forces: (..., m) on the independent ones, Sᵀ Γ, those that count
    where the acceleration is unknown; bias: H (..., joints), or with the six rows of a moving base in front where its
    acceleration is unknown.

    The rows of the unknown accelerations of Sᵀ A S q̈ = Sᵀ (Γ - H): Khalil, section 4 (A_c and H_c by Walker and Orin)
    with a constant G = S; and section 6, second row of the general form, where only some are unknown.
    """
    rows = bias.shape[-1]
    base = rows - S.shape[0]
    A = inertia_matrix(robot, q)[..., -rows:, -rows:]
    if S.shape[0] > S.shape[1]:
        P = projection(S, base)
        A, bias = P.T @ A @ P, bias @ P
    size = A.shape[-1]
    # from the tips to the base: so the zeros between branches stay zero in the factors
    sought = np.array([*(base + number for number in reversed(unknown)), *range(base)], dtype=int)
    known = np.ones(size, dtype=int)
    known[sought] = 0
    given = known * np.concatenate([np.zeros((*accelerations.shape[:-1], base), dtype=int), accelerations], axis=-1)
    pushes = np.concatenate([np.zeros((*forces.shape[:-1], base), dtype=int), forces], axis=-1)
    push = pushes - bias - (A @ given[..., None])[..., 0]
    A = A[..., sought[:, None], sought]
    factors = linear.factor(A)
    solved = linear.solve(factors, push[..., sought])
    place = {row: number for number, row in enumerate(sought)}
    found = [given[..., row] if row not in place else solved[..., place[row]] for row in range(size)]
    return np.stack(np.broadcast_arrays(*found), axis=-1), factors[1], np.diagonal(A, axis1=-2, axis2=-1)
