"""Mobility: which joints of a robot with loops are dependent.

The mobility is the number of joints in loops minus the rank of the loop equations. The rank is found numerically at
closed positions: planar loops have redundant equations, others by their geometry. Passive joints of loops are
dependent. Where these are fewer than the rank, elastic joints are dependent too; actuated joints never.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from scipy.linalg import qr

from robot_dynamics.constraints.attitude_charts import attach_charts, displace, find_attitude_joints
from robot_dynamics.constraints.loop_equations import equations_per_loop, loop_equations
from robot_dynamics.constraints.newton_iteration import CLOSURE_TOLERANCE, MAX_STEP, iterate_newton
from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.newton_euler.screw import apply

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.model.robot import Robot

RANK_TOLERANCE = 1e-6
"""Singular value, as a part of the largest one, below which it counts as zero."""
NEARLY_CLOSED_RESIDUAL = 1e-3
"""Residual below which inexact dimensions may keep a loop open."""
MAX_GOOD_CONDITION = 1e3
"""Condition number of J_d below which no better positions are sought."""
MAX_ATTEMPTS = 60
"""Start positions from which closing the loops is tried."""
EXTRA_POSITIONS = 4
"""Closed positions, besides the first, at which the rank is computed."""
AXES_HINT = (
    "the axis of the joint at which a loop is cut is z of both its frames and points the same way: turn them by rpy"
)


@dataclass(frozen=True, eq=False)
class _LoopJoints:
    """Joints of a robot with loops.

    Joint positions are S t + offset, t (m,) those of `non_mimic_joints`. columns: columns of the joints in loops.
    """

    robot: Robot
    S: Array
    offset: Array
    non_mimic_joints: list[int]
    attitudes: tuple[AttitudeJoints, ...]
    columns: list[int]

    @property
    def passive_columns(self) -> list[int]:
        """Columns of the unactuated joints in loops, elastic ones too."""
        return [k for k in self.columns if not self.robot.joints[self.non_mimic_joints[k]].actuated]

    def jacobian(self, t: Array, attitudes: Sequence[AttitudeJoints]) -> Array:
        """Loop Jacobian (rows, m) at t (m,), in the charts of attitudes."""
        q = self.S @ t + self.offset
        J: Array = loop_equations(*attach_charts(self.robot, q, attitudes, self.offset)).jacobian @ self.S
        return J

    def refuse(self, rank: int, reason: str) -> NoReturn:
        """Raise the DescriptionError of actuators that do not fit the loops."""
        joints = [self.robot.joints[self.non_mimic_joints[k]] for k in self.columns]
        motors = sum(joint.actuated for joint in joints)
        mobility = len(joints) - rank
        names = ", ".join(repr(joint.name) for joint in joints)
        remedy = f"Of these joints {mobility} that move independently must be actuated or elastic, the others passive"
        if not mobility:
            remedy = f"These loops cannot move: a joint is missing, or an axis is wrong; {AXES_HINT}"
        raise DescriptionError(
            f"robot {self.robot.name!r}: the joints of its loops ({names}) have mobility {mobility} and {motors} "
            f"motors: {reason}. {remedy}"
        )


def find_dependent_columns(
    robot: Robot, S: Array, offset: Array, non_mimic_joints: list[int]
) -> tuple[IntArray, Array]:
    """Find the dependent joints of a robot with loops.

    Parameters
    ----------
    robot : Robot
    S : ndarray, shape (joints, m)
    offset : ndarray, shape (joints,)
        Joint positions are S t + offset.
    non_mimic_joints : list of int
        Numbers of the joints t, which mimic no other joint.

    Returns
    -------
    dependent_columns : ndarray of int
        Columns of S of the dependent joints, those of one loop only first.
    t : ndarray, shape (m,)
        Positions that close the loops, far from singular ones.

    Raises
    ------
    DescriptionError
        The loops cannot be closed, or the number of actuated and elastic joints is not the mobility, or these joints
        depend on each other.
    """
    columns = [k for k in range(S.shape[1]) if any(row in robot.joints_in_loops for row in np.flatnonzero(S[:, k]))]
    attitudes = find_attitude_joints(robot, non_mimic_joints)
    loop_joints = _LoopJoints(robot, S, offset, non_mimic_joints, attitudes, columns)
    positions = _find_closed_positions(loop_joints)
    ranks = [_rank(J, float(np.linalg.norm(J, 2))) for J in (loop_joints.jacobian(t, attitudes) for t in positions)]
    rank = max(ranks)
    passive_attitudes = _within(attitudes, loop_joints.passive_columns)
    candidates: list[tuple[float, Array, IntArray]] = []
    first_error = None
    for t, rank_here in zip(positions, ranks, strict=True):
        if rank_here < rank:
            continue
        J = loop_joints.jacobian(t, passive_attitudes)
        try:
            dependent = _choose_dependent(loop_joints, J, rank)
        except DescriptionError as error:  # possibly at these positions only
            first_error = first_error or error
            continue
        condition = float(np.linalg.cond(J[:, dependent])) if len(dependent) else 1.0
        candidates.append((condition, t, dependent))
    if not candidates:
        assert first_error is not None
        raise first_error
    best = min(candidates, key=lambda candidate: candidate[0])
    condition, t, dependent = next((candidate for candidate in candidates if candidate[0] < MAX_GOOD_CONDITION), best)
    if condition > 1 / RANK_TOLERANCE:
        loop_joints.refuse(rank, "they do not determine the unactuated joints")
    return dependent, t


def _rank(J: Array, scale: float) -> int:
    """Rank of a matrix, singular values compared with `scale`."""
    return int(np.linalg.matrix_rank(J, tol=RANK_TOLERANCE * scale))


def _find_closed_positions(loop_joints: _LoopJoints) -> list[Array]:
    """Positions t (m,) at which the loops are closed, the first one from the initial positions if these lead there."""
    robot = loop_joints.robot
    joints = [robot.joints[number] for number in loop_joints.non_mimic_joints]
    units = np.where([joint.prismatic for joint in joints], robot.characteristic_length, 1.0)
    initial = np.array([joint.initial_position for joint in joints])
    columns = loop_joints.columns
    rng = np.random.default_rng(0)
    positions: list[Array] = []
    nearest: Array | None = None
    for attempt in range(MAX_ATTEMPTS):
        start = initial.copy()
        moving = loop_joints.passive_columns if attempt % 2 == 0 else columns
        if attempt > 1:  # near closed positions if there are any, else anywhere
            spread = 0.3 if positions else 2.0
            center = positions[0] if positions else initial
            start[columns] = center[columns] + units[columns] * rng.uniform(-spread, spread, len(columns))
        max_step = MAX_STEP * units[moving]
        (t,), (residual,) = close_by_moving(
            robot, loop_joints.S, loop_joints.offset, start[None], moving, max_step, loop_joints.attitudes
        )
        if np.abs(residual).max() <= CLOSURE_TOLERANCE:
            positions.append(t)
        elif nearest is None or np.abs(residual).max() < np.abs(nearest).max():
            nearest = residual
        if len(positions) > EXTRA_POSITIONS:
            break
    if not positions:
        assert nearest is not None
        _refuse_open(robot, nearest)
    return positions


def close_by_moving(
    robot: Robot,
    S: Array,
    offset: Array,
    t: Array,
    moving: Sequence[int] | IntArray,
    max_step: Array,
    attitudes: Sequence[AttitudeJoints] = (),
) -> tuple[Array, Array]:
    """Close the loops as far as possible by steps of least length of some joints, the others locked.

    Parameters
    ----------
    robot : Robot
    S : ndarray, shape (joints, m)
    offset : ndarray, shape (joints,)
    t : ndarray, shape (N, m)
        Start positions.
    moving : sequence of int
        Columns of the joints that move.
    max_step : ndarray, shape (moving,)
        Longest step of each of them.
    attitudes : sequence of AttitudeJoints
        Of the robot.

    Returns
    -------
    t : ndarray, shape (N, m)
    residual : ndarray, shape (N, rows)
    """
    t, (residual, _) = iterate_newton(
        _least_norm_step(robot, S, offset, moving, _within(attitudes, moving)),
        t,
        moving,
        max_step,
        advance=_advance_columns(moving, _within(attitudes, moving)),
    )
    return t, residual


def _least_norm_step(
    robot: Robot, S: Array, offset: Array, moving: Sequence[int] | IntArray, attitudes: Sequence[AttitudeJoints]
) -> Callable[[Array], tuple[Array, Array]]:
    """Evaluates the residual (..., rows) and the step (..., moving) of least length at positions t (..., m)."""

    def evaluate(t: Array) -> tuple[Array, Array]:
        equations = loop_equations(*attach_charts(robot, t @ S.T + offset, attitudes, offset))
        J = np.nan_to_num((equations.jacobian @ S)[..., moving], posinf=0, neginf=0)
        pseudo_inverse = np.linalg.pinv(J, rcond=RANK_TOLERANCE)
        return equations.residual, -apply(pseudo_inverse, equations.residual)

    return evaluate


def _advance_columns(
    moving: Sequence[int] | IntArray, attitudes: Sequence[AttitudeJoints]
) -> Callable[[Array, Array], Array]:
    """Adds a step (..., moving) to positions (..., m), in the charts of attitudes."""

    def advance(t: Array, step: Array) -> Array:
        full_step = np.zeros_like(t)
        full_step[..., moving] = step
        end = displace(t, full_step, attitudes)
        locked = np.setdiff1d(np.arange(t.shape[-1]), moving)
        end[..., locked] = t[..., locked]
        return end

    return advance


def _within(attitudes: Sequence[AttitudeJoints], columns: Collection[int] | IntArray) -> tuple[AttitudeJoints, ...]:
    """Those attitudes whose yaw and roll are among these columns."""
    return tuple(attitude for attitude in attitudes if {attitude.columns[0], attitude.columns[2]} <= {*columns})


def _choose_dependent(loop_joints: _LoopJoints, J: Array, rank: int) -> IntArray:
    """Columns of the dependent joints: passive ones of loops, then elastic ones, in the order of elimination.

    J: (rows, m). Raises DescriptionError where the other joints do not determine them.
    """
    joints = [loop_joints.robot.joints[number] for number in loop_joints.non_mimic_joints]
    unactuated = loop_joints.passive_columns
    dependent = [k for k in unactuated if joints[k].spring is None]
    elastic = [k for k in unactuated if joints[k].spring is not None]
    scale = float(np.linalg.norm(J, 2))
    if _rank(J[:, dependent], scale) < len(dependent):
        loop_joints.refuse(
            rank,
            f"with {_controlling_names(loop_joints)} locked, passive joints can still move "
            f"{_controlled_motions(loop_joints, J, rank)}",
        )
    if len(dependent) < rank and elastic:
        basis = np.linalg.qr(J[:, dependent])[0] if dependent else np.zeros((len(J), 0))
        normal = J[:, elastic] - basis @ (basis.T @ J[:, elastic])
        triangle, order = qr(normal, mode="r", pivoting=True)
        is_regular = np.abs(np.diag(triangle)) > RANK_TOLERANCE * scale
        dependent += [elastic[k] for k in order[: len(is_regular)][is_regular]]
    if len(dependent) < rank:
        loop_joints.refuse(
            rank,
            f"{_controlling_names(loop_joints)} cannot move independently {_controlled_motions(loop_joints, J, rank)}",
        )
    # joints of one loop first: the factorization eliminates them first
    rows_of_loops = np.split(J != 0, np.cumsum(equations_per_loop(loop_joints.robot))[:-1])
    return np.array(sorted(dependent, key=lambda k: (sum(rows[:, k].any() for rows in rows_of_loops), k)), dtype=int)


def _controlling_names(loop_joints: _LoopJoints) -> str:
    """Names of the actuated and elastic joints in loops."""
    joints = [loop_joints.robot.joints[loop_joints.non_mimic_joints[k]] for k in loop_joints.columns]
    names = [repr(joint.name) for joint in joints if joint.role in ("actuated", "elastic")]
    return ", ".join(names) if names else "no joint"


def _controlled_motions(loop_joints: _LoopJoints, J: Array, rank: int) -> str:
    """Number of independent motions that actuated and elastic joints control, for messages; J: (rows, m)."""
    joints = [loop_joints.robot.joints[number] for number in loop_joints.non_mimic_joints]
    mobility = len(loop_joints.columns) - rank
    passive = [k for k in loop_joints.columns if joints[k].role not in ("actuated", "elastic")]
    uncontrolled = len(passive) - _rank(J[:, passive], float(np.linalg.norm(J, 2)))
    return f"(they control {mobility - uncontrolled} of {mobility} motions: the rank of their Jacobian)"


def _refuse_open(robot: Robot, residual: Array) -> NoReturn:
    """Raise the DescriptionError of loops that stay open, with their least residual (rows,)."""
    name, distance, angle = find_widest_loop(robot, residual)
    cut_loops = {robot.loops[number].name for number in cut_joints(robot)}
    hint = "give initial_position to their joints near where they are closed, and check lengths and placements"
    if angle > distance / robot.characteristic_length and name in cut_loops:
        hint = f"{AXES_HINT}, and give initial_position to their joints near where they are closed"
    if np.abs(residual).max() < NEARLY_CLOSED_RESIDUAL:
        hint = "axes that are meant to be parallel must be so to the last digit: write pi/2 for 1.5708, or snap them"
    raise DescriptionError(
        f"robot {robot.name!r}: its loops cannot be closed: the ends of loop {name!r} stay {distance:.3g} m and "
        f"{angle:.3g} rad apart; {hint}"
    )


def find_widest_loop(robot: Robot, residual: Array) -> tuple[str, float, float]:
    """Name of the loop with the largest residual, and the distance [m] and angle [rad] between its ends.

    residual: (rows,), not finite for ends that are half a turn apart.
    """
    residual = np.nan_to_num(residual, nan=np.inf, posinf=np.inf, neginf=-np.inf)
    length = robot.characteristic_length
    first_row = 0
    loops: list[tuple[float, str, float, float]] = []
    for loop, rows in zip(robot.loops, equations_per_loop(robot), strict=True):
        part = residual[first_row : first_row + rows]
        first_row += rows
        distance = float(length * np.linalg.norm(part[:3]))
        angle = float(2 * np.arctan(np.linalg.norm(part[3:]) / 2))
        loops.append((float(np.abs(part).max()), loop.name, distance, angle))
    return max(loops)[1:]
