"""What closes a loop: frame k and frame k+B coincide, and so do their velocities and accelerations.

    residual e(q) = 0,   J q̇ = 0,   J q̈ + J̇ q̇ = 0

Each loop gives six rows, [position; rotation] of frame k relative to frame k+B in the axes of the link where its two
chains part; a ball joint three, of the position. Positions are counted in units of the robot's characteristic_length,
so that metres and radians compare. How the link where the chains part moves has no part in it.

For a rotation by an angle φ about the unit vector u the residual is 2 tan(φ/2) u: its derivative is the angular
velocity where φ is small, and it has no other zero.

Source: Khalil, section 2.2.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.augmented import AngularMotion
from robot_dynamics.newton_euler.kinematics import joint_placement, link_placements
from robot_dynamics.newton_euler.screw import apply, cross, screw, stack_matrices, wrench_to_antecedent


class LoopEquations(NamedTuple):
    """residual (..., m); jacobian J (..., m, joints); drift J̇q̇ (..., m), zero where no velocities are given.

    J and the drift mean what they say where the residual is zero.
    """

    residual: np.ndarray
    jacobian: np.ndarray
    drift: np.ndarray


class _Arm(NamedTuple):
    """A chain from the link where two part to one end: the end's R (..., 3, 3) and P (..., 3); columns of the Jacobian
    of its twist (..., 6) by joint number; drift: its acceleration (..., 6) with no joint accelerated."""

    R: np.ndarray
    P: np.ndarray
    columns: dict
    drift: np.ndarray


def equations_per_loop(robot):
    """How many equations each loop has."""
    return [3 if loop.is_spherical else 6 for loop in robot.loops]


def loop_equations(robot, q, qd=None):
    """The LoopEquations of all loops, at joint positions q and velocities qd (..., joints)."""
    unit = robot.characteristic_length
    residuals, jacobians, drifts = [], [], []
    for loop in robot.loops:
        moved, closed_on = (set(robot.path_to_base(end.link)) for end in loop.ends)
        arms = [_arm(robot, sorted(way), end, q, qd)
                for way, end in ((moved - closed_on, loop.moved), (closed_on - moved, loop.closed_on))]  # fmt: skip
        rows = 3 if loop.is_spherical else 6
        scale = np.array([1 / unit] * 3 + [1] * 3)[:rows]
        residuals.append(_residual(*arms, loop.is_spherical) * scale)
        jacobians.append(_jacobian(*arms, len(robot.joints))[..., :rows, :] * scale[:, None])
        drifts.append((arms[0].drift - arms[1].drift)[..., :rows] * scale)
    # vectors as matrices of one column, to be stacked like them
    residual, drift = (stack_matrices([rows[..., None] for rows in parts])[..., 0] for parts in (residuals, drifts))
    return LoopEquations(residual, stack_matrices(jacobians), drift)


def loop_wrenches(robot, q, multipliers):
    """(link number, wrench (..., 6) on it, in its frame at its origin) of both ends of each loop.

    multipliers: (..., m), one with each row of J, so that Jᵀ multipliers are the joint forces that the loops exert.
    """
    placed, start = link_placements(robot, q), 0
    scale = np.array([1 / robot.characteristic_length] * 3 + [1] * 3)
    for loop, rows in zip(robot.loops, equations_per_loop(robot), strict=True):
        ways = [robot.path_to_base(end.link) for end in loop.ends]
        parts = next((number + 1 for number in ways[0] if number in ways[1]), 0)  # the link whose axes J is told in
        wrench = np.zeros((*multipliers.shape[:-1], 6))
        wrench[..., :rows] = multipliers[..., start : start + rows] * scale[:rows]
        start += rows
        for end, sign in zip(loop.ends, (1, -1), strict=True):
            R = np.swapaxes(placed[end.link][0], -1, -2) @ placed[parts][0]
            turned = screw(apply(R, sign * wrench[..., :3]), apply(R, sign * wrench[..., 3:]))
            yield end.link, wrench_to_antecedent(np.eye(3), end.placement[:3, 3], turned)


def _arm(robot, numbers, end, q, qd):
    """The _Arm of joints `numbers`, from the link where the chains part on."""
    R, P = np.eye(3, dtype=int), np.zeros(3, dtype=int)
    axes = {}  # of each joint: its axis and a point on it
    omega = turning = acceleration = np.zeros(3, dtype=int)
    for number in numbers:
        joint = robot.joints[number]
        R_j, P_j = joint_placement(joint, q[..., number : number + 1])
        offset = apply(R, P_j)
        R, P = R @ R_j, P + offset
        z = R[..., 2]
        axes[number] = z, P
        if qd is not None:
            rate = qd[..., number : number + 1]
            acceleration = acceleration + AngularMotion(omega, turning).times(offset)
            if joint.prismatic:
                acceleration = acceleration + 2 * cross(omega, z * rate)
            else:
                turning = turning + cross(omega, z * rate)
                omega = omega + z * rate
    offset = apply(R, end.placement[:3, 3])
    P = P + offset
    if qd is not None:
        acceleration = acceleration + AngularMotion(omega, turning).times(offset)
    columns = {
        number: screw(z, np.zeros_like(z)) if robot.joints[number].prismatic else screw(cross(z, P - point), z)
        for number, (z, point) in axes.items()
    }
    return _Arm(R @ end.placement[:3, :3], P, columns, screw(acceleration, turning))


def _residual(moved, closed_on, ball):
    """[P_k - P_k+B; 2 tan(φ/2) u] (..., 6), or the first three alone."""
    distance = moved.P - closed_on.P
    if ball:
        return distance
    R = moved.R @ np.swapaxes(closed_on.R, -1, -2)
    # R - Rᵀ = 2 sin φ û and 1 + tr R = 2 (1 + cos φ)
    share = 2 / (1 + R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2])
    turned = [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]]
    return screw(distance, np.stack([share * entry for entry in turned], axis=-1))


def _jacobian(moved, closed_on, joints):
    """J (..., 6, joints): of the twist of frame k less that of frame k+B."""
    columns = {**moved.columns, **{number: -column for number, column in closed_on.columns.items()}}
    zero = 0 * next(iter(columns.values()))
    stacked = np.broadcast_arrays(*(columns.get(number, zero) for number in range(joints)))
    return np.stack(stacked, axis=-1)
