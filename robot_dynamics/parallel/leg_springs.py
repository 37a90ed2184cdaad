"""Unactuated joints beside the platform of a parallel robot: springs in its legs, and their equilibrium.

The state of the robot is that of the platform and the positions and velocities of these joints; the motors follow. In a
motion of the platform, their accelerations q̈_U follow from their rows of the dynamic model,

    A_UR q̈_R + A_UU q̈_U + H_U = 0,   q̈_R = q̈_R⁰ + L q̈_U,

with motors R that move by L when these joints move and the platform does not. This has no solution where springs stand
between motors and platform: A_UU + A_UR L is singular, and the springs determine the acceleration of the platform.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import SingularModelError
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.screw import apply

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.closure_solver import ClosureSolver
    from robot_dynamics.inputs import ExternalWrenches
    from robot_dynamics.joint_space.joint_dynamics import JointDynamics

SINGULAR_TOLERANCE = 1e-9  # smallest singular value of A_UU + A_UR L, relative to its terms
DISPLACEMENT = 1e-6  # of central differences [rad or m]
MAX_STEP = 0.3  # of Newton's method [rad or m]
MAX_ITERATIONS = 40
STEP_TOLERANCE = 1e-12  # a step after which the search ends [rad or m]
MAX_FINAL_STEP = 1e-8  # a last step above this has not converged [rad or m]


def solve_unactuated_accelerations(
    closure_solver: ClosureSolver,
    actuated_dynamics: JointDynamics,
    motion: tuple[Array, Array, Array],
    unactuated: Sequence[int],
    external_wrenches: ExternalWrenches | None,
) -> Array:
    """Return accelerations (..., all joints) of a motion with zero effort at the unactuated joints.

    The motors move so that the platform keeps its acceleration.

    Parameters
    ----------
    closure_solver : of the robot with platform coordinates as independent joints.
    actuated_dynamics : of the robot with a motor at each unactuated joint too.
    motion : q, qd, qdd, (..., all joints) each.
    unactuated : columns of the unactuated joints in `actuated_dynamics.joint_names`.
    external_wrenches : as for Dynamics.

    Raises
    ------
    SingularModelError
        Springs stand between the motors and the platform.
    """
    q, qd, qdd = motion
    numbers = [actuated_dynamics.robot.joint_numbers[name] for name in actuated_dynamics.joint_names]
    columns = [closure_solver.independent.index(numbers[column]) for column in unactuated]
    unit_motions = closure_solver.state_at_closed(q).G[..., columns]
    efforts = actuated_dynamics.inverse(q, qd[..., numbers], qdd[..., numbers], external_wrenches=external_wrenches)
    residual = efforts[..., unactuated]
    A = actuated_dynamics.inertia_matrix(q)
    L = unit_motions[..., numbers, :]
    A_rows = A[..., unactuated, :]
    scale = np.sqrt(np.diagonal(A, axis1=-2, axis2=-1)[..., unactuated])
    scale = np.where(scale > 0, scale, 1.0)
    unit = scale[..., :, None] * scale[..., None, :]
    smallest = np.linalg.svd(A_rows @ L / unit, compute_uv=False)[..., -1]
    if not np.all(smallest > SINGULAR_TOLERANCE * (np.abs(A_rows) @ np.abs(L) / unit).max(axis=(-2, -1))):
        names = ", ".join(actuated_dynamics.joint_names[column] for column in unactuated)
        raise SingularModelError(
            f"springs stand between the motors and the platform ({names}): at prescribed deflections they determine "
            "its acceleration, and the motors cannot. Give efforts to compute the acceleration, compute the "
            "equilibrium at this pose, or use the joints"
        )
    return qdd - apply(unit_motions, solve_each(A_rows @ L, residual))


def solve_unactuated_equilibrium(
    closure_solver: ClosureSolver,
    actuated_dynamics: JointDynamics,
    q: Array,
    unactuated: Sequence[int],
    external_wrenches: ExternalWrenches | None,
) -> Array:
    """Return positions (..., all joints) with the platform where q (..., all joints) has it, unactuated joints at rest.

    Newton's method starts from q. Arguments as of `solve_unactuated_accelerations`. Raises SingularModelError.
    """
    numbers = [actuated_dynamics.robot.joint_numbers[actuated_dynamics.joint_names[column]] for column in unactuated]
    rest = np.zeros(len(actuated_dynamics.joint_names))
    count = len(unactuated)

    def residual_forces(q: Array) -> Array:
        """Return the unbalanced forces (..., unactuated) at positions that close the legs."""
        return actuated_dynamics.inverse(q, rest, rest, external_wrenches=external_wrenches)[..., unactuated]

    residual = residual_forces(q)
    q = np.array(np.broadcast_to(q, (*residual.shape[:-1], q.shape[-1])))
    displacements = DISPLACEMENT * np.eye(q.shape[-1])[numbers].reshape(count, *(1,) * (q.ndim - 1), q.shape[-1])
    for _ in range(MAX_ITERATIONS):
        displaced = closure_solver.close_loops(
            np.concatenate([q + displacements, q - displacements]), name_sample=False
        )
        forces = residual_forces(displaced)
        stiffness = np.moveaxis(forces[:count] - forces[count:], 0, -1) / (2 * DISPLACEMENT)
        step = -(np.linalg.pinv(stiffness) @ residual[..., None])[..., 0]
        step = step / np.maximum(1.0, np.abs(step).max(axis=-1, keepdims=True) / MAX_STEP)
        q[..., numbers] += step
        q = closure_solver.close_loops(q, name_sample=False)
        residual = residual_forces(q)
        if np.all(np.abs(step) <= STEP_TOLERANCE):
            break
    if not np.all(np.abs(step) <= MAX_FINAL_STEP):
        names = ", ".join(actuated_dynamics.joint_names[column] for column in unactuated)
        raise SingularModelError(
            f"no equilibrium was found with the platform at this pose: {names} do not come to rest. Start from other "
            "positions of these joints, or use stiffer springs"
        )
    return q
