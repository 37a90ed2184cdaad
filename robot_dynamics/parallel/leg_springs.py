"""Joints without motor beside the platform of a parallel robot: the springs in its legs, and where these come to rest.

The state of the robot is that of the platform, and positions and velocities of these joints; the motors follow. In a
motion of the platform, their accelerations q̈_U follow from their rows of the dynamic model,

    A_UR q̈_R + A_UU q̈_U + H_U = 0,   q̈_R = q̈_R⁰ + L q̈_U,

with motors R that move by L when these joints do and the platform does not. That has no answer where springs stand
between motors and platform: A_UU + A_UR L is singular, and the springs decide how the platform accelerates.
"""

import numpy as np

from robot_dynamics.errors import SingularModelError
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.screw import apply

SINGULAR_TOLERANCE = 1e-9  # what is left of A_UU + A_UR L, as a part of these, where the motors have no say
DISPLACEMENT = 1e-6  # [rad or m] for differences
MAX_STEP = 0.3  # step of Newton's method [rad or m]
MAX_ITERATIONS = 40
STEP_TOLERANCE = 1e-12  # step after which nothing is left to gain [rad or m]
MAX_FINAL_STEP = 1e-8  # and one that is too long for the last


def solve_unactuated_accelerations(closure_solver, actuated_dynamics, motion, unactuated, external_wrenches):
    """Accelerations (..., all joints) of a motion (q, qd, qdd), (..., all joints) each, in which the joints without
    motor accelerate as they must, and the motors so that the platform accelerates as told.

    led: Configurations of the robot that its platform leads; motored: the Dynamics with a motor at these joints too;
    undriven: their places among its joint_names. Raises SingularModelError.
    """
    q, qd, qdd = motion
    numbers = [actuated_dynamics.robot.joint_numbers[name] for name in actuated_dynamics.joint_names]
    moves = closure_solver.state_at_closed(q).G[
        ..., [closure_solver.independent.index(numbers[place]) for place in unactuated]
    ]
    left = actuated_dynamics.inverse(q, qd[..., numbers], qdd[..., numbers], external_wrenches=external_wrenches)[
        ..., unactuated
    ]
    A, L = actuated_dynamics.inertia_matrix(q), moves[..., numbers, :]
    rows, own = A[..., unactuated, :], np.sqrt(np.diagonal(A, axis1=-2, axis2=-1)[..., unactuated])
    own = np.where(own > 0, own, 1.0)
    measure = own[..., :, None] * own[..., None, :]
    smallest = np.linalg.svd(rows @ L / measure, compute_uv=False)[..., -1]
    if not np.all(smallest > SINGULAR_TOLERANCE * (np.abs(rows) @ np.abs(L) / measure).max(axis=(-2, -1))):
        names = ", ".join(actuated_dynamics.joint_names[place] for place in unactuated)
        raise SingularModelError(
            f"springs stand between the motors and the platform ({names}): at given deflections they decide how it "
            "accelerates, and the motors cannot. Give efforts and ask for the acceleration, or ask for the equilibrium "
            "at this pose, or ask by joints"
        )
    return qdd - apply(moves, solve_each(rows @ L, left))


def solve_unactuated_equilibrium(closure_solver, actuated_dynamics, q, unactuated, external_wrenches):
    """Positions (..., all joints) with the platform where q (..., all joints) has it and the joints without motor in
    balance, sought by Newton's method from where q has them. Arguments as of `accelerated`. Raises SingularModelError.
    """
    numbers = [actuated_dynamics.robot.joint_numbers[actuated_dynamics.joint_names[place]] for place in unactuated]
    rest, count = np.zeros(len(actuated_dynamics.joint_names)), len(unactuated)

    def forces(q):
        """What is out of balance (..., undriven) at positions that close the legs."""
        return actuated_dynamics.inverse(q, rest, rest, external_wrenches=external_wrenches)[..., unactuated]

    left = forces(q)
    q = np.array(np.broadcast_to(q, (*left.shape[:-1], q.shape[-1])))
    moves = DISPLACEMENT * np.eye(q.shape[-1])[numbers].reshape(count, *(1,) * (q.ndim - 1), q.shape[-1])
    for _ in range(MAX_ITERATIONS):
        beside = forces(closure_solver.close_loops(np.concatenate([q + moves, q - moves]), name_sample=False))
        stiffness = np.moveaxis(beside[:count] - beside[count:], 0, -1) / (2 * DISPLACEMENT)
        step = -(np.linalg.pinv(stiffness) @ left[..., None])[..., 0]
        step = step / np.maximum(1.0, np.abs(step).max(axis=-1, keepdims=True) / MAX_STEP)
        q[..., numbers] += step
        q = closure_solver.close_loops(q, name_sample=False)
        left = forces(q)
        if np.all(np.abs(step) <= STEP_TOLERANCE):
            break
    if not np.all(np.abs(step) <= MAX_FINAL_STEP):
        names = ", ".join(actuated_dynamics.joint_names[place] for place in unactuated)
        raise SingularModelError(
            f"no equilibrium was found with the platform at this pose: {names} do not come to rest. Give other "
            "positions of them to begin with, or stiffer springs"
        )
    return q
