"""Loop equations: frames k and k+B coincide, and so do their velocities and accelerations.

    residual e(q) = 0,   J q̇ = 0,   J q̈ + J̇ q̇ = 0

Each loop has six rows, [position; rotation] of frame k relative to frame k+B in the axes of the link where its two
chains part; a loop cut at a spherical joint has three rows, of the position. Positions are divided by the robot's
characteristic_length, so that metres and radians compare. The motion of the link where the chains part has no effect.

For a rotation by an angle φ about the unit vector u the residual is 2 tan(φ/2) u: its derivative is the angular
velocity where φ is small, and it has no other zero.

Source: Khalil, section 2.2.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.joint_chain import chain_end, jacobian_from_columns, joint_chain
from robot_dynamics.newton_euler.kinematics import link_placements
from robot_dynamics.newton_euler.screw import apply, screw, stack_matrices, wrench_to_antecedent

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.loop import LoopEnd
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.newton_euler.joint_chain import ChainEnd, JointChain


RANK_TOLERANCE = 1e-6
"""Singular value of J, as a part of the largest one, below which it counts as zero."""
AXES_HINT = (
    "the axis of the joint at which a loop is cut is z of both its frames and points the same way: turn them by rpy"
)


class LoopEquations(NamedTuple):
    """Loop equations of a robot.

    Attributes
    ----------
    residual : ndarray, shape (..., rows)
    jacobian : ndarray, shape (..., rows, joints)
        J. Valid where the residual is zero, as is the drift.
    drift : ndarray, shape (..., rows)
        J̇q̇, zero without velocities.
    """

    residual: ScalarArray
    jacobian: ScalarArray
    drift: ScalarArray


def equations_per_loop(robot: Robot) -> list[int]:
    """Number of equations of each loop."""
    return [3 if loop.is_spherical else 6 for loop in robot.loops]


def loop_equations(robot: Robot, q: ScalarArray, qd: ScalarArray | None = None) -> LoopEquations:
    """LoopEquations of all loops.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (..., joints)
        Joint positions.
    qd : ndarray, shape (..., joints), optional
        Joint velocities, which only the drift depends on.
    """
    length = robot.characteristic_length
    residuals: list[ScalarArray] = []
    jacobians: list[ScalarArray] = []
    drifts: list[ScalarArray] = []
    chains: dict[tuple[int, ...], JointChain] = {}  # legs of one platform share that of the platform

    def chain(numbers: set[int], end: LoopEnd) -> ChainEnd:
        key = tuple(sorted(numbers))
        if key not in chains:
            chains[key] = joint_chain(robot, key, q, qd)
        return chain_end(robot, chains[key], end.placement, has_velocities=qd is not None)

    for loop in robot.loops:
        moved_path, closed_on_path = (set(robot.path_to_base(end.link)) for end in loop.ends)
        moved = chain(moved_path - closed_on_path, loop.moved)
        closed_on = chain(closed_on_path - moved_path, loop.closed_on)
        rows = 3 if loop.is_spherical else 6
        scale = np.array([1 / length] * 3 + [1] * 3)[:rows]
        residuals.append(_residual(moved, closed_on, loop.is_spherical) * scale)
        jacobians.append(_jacobian(moved, closed_on, len(robot.joints))[..., :rows, :] * scale[:, None])
        drifts.append((moved.drift - closed_on.drift)[..., :rows] * scale)
    return LoopEquations(_concatenate(residuals), stack_matrices(jacobians), _concatenate(drifts))


def _concatenate(vectors: Sequence[ScalarArray]) -> ScalarArray:
    """Concatenate vectors (..., rows) as matrices of one column."""
    return stack_matrices([vector[..., None] for vector in vectors])[..., 0]


def loop_wrenches(robot: Robot, q: Array, multipliers: Array) -> Iterator[tuple[int, Array]]:
    """Wrenches that the loops exert on the links at their ends.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (..., joints)
    multipliers : ndarray, shape (..., rows)
        One for each row of J: Jᵀ multipliers are the joint forces that the loops exert.

    Yields
    ------
    (int, ndarray)
        Link number, and the wrench (..., 6) on the link, in its frame at its origin.
    """
    placements = link_placements(robot, q)
    first_row = 0
    scale = np.array([1 / robot.characteristic_length] * 3 + [1] * 3)
    for loop, rows in zip(robot.loops, equations_per_loop(robot), strict=True):
        paths = [robot.path_to_base(end.link) for end in loop.ends]
        # J is expressed in the axes of the link where the chains part
        common_link = next((number + 1 for number in paths[0] if number in paths[1]), 0)
        wrench = np.zeros((*multipliers.shape[:-1], 6))
        wrench[..., :rows] = multipliers[..., first_row : first_row + rows] * scale[:rows]
        first_row += rows
        for end, sign in zip(loop.ends, (1, -1), strict=True):
            R = np.swapaxes(placements[end.link][0], -1, -2) @ placements[common_link][0]
            rotated = screw(apply(R, sign * wrench[..., :3]), apply(R, sign * wrench[..., 3:]))
            yield end.link, wrench_to_antecedent(np.eye(3), end.placement[:3, 3], rotated)


def _residual(moved: ChainEnd, closed_on: ChainEnd, is_spherical: bool) -> ScalarArray:
    """[P_k - P_k+B; 2 tan(φ/2) u] (..., 6), or the first three entries alone."""
    distance: ScalarArray = moved.P - closed_on.P
    if is_spherical:
        return distance
    R = moved.R @ np.swapaxes(closed_on.R, -1, -2)
    # R - Rᵀ = 2 sin φ û and 1 + tr R = 2 (1 + cos φ)
    factor = 2 / (1 + R[..., 0, 0] + R[..., 1, 1] + R[..., 2, 2])
    skew_entries = [R[..., 2, 1] - R[..., 1, 2], R[..., 0, 2] - R[..., 2, 0], R[..., 1, 0] - R[..., 0, 1]]
    return screw(distance, np.stack([factor * entry for entry in skew_entries], axis=-1))


def _jacobian(moved: ChainEnd, closed_on: ChainEnd, joints: int) -> ScalarArray:
    """J (..., 6, joints): of the twist of frame k relative to frame k+B."""
    columns = {**moved.columns, **{number: -column for number, column in closed_on.columns.items()}}
    return jacobian_from_columns(columns, joints)
