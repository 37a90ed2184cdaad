"""Mobility: which joints of a robot with loops are dependent.

The mobility is the number of joints in loops minus the rank of the loop equations. The rank is found numerically at
closed positions: planar loops have redundant equations, others by their geometry. Passive joints of loops are
dependent. Where these are fewer than the rank, elastic joints are dependent too; actuated joints never.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

import numpy as np
from scipy.linalg import qr

from robot_dynamics.constraints.attitude_charts import attach_charts, attitudes_within, find_attitude_joints
from robot_dynamics.constraints.loop_equations import AXES_HINT, RANK_TOLERANCE, equations_per_loop, loop_equations
from robot_dynamics.errors import DescriptionError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.model.robot import Robot

PositionSearch: TypeAlias = Callable[..., list[Any]]
"""Finds positions t (m,) that close the loops."""

MAX_GOOD_CONDITION = 1e3
"""Condition number of J_d below which no better positions are sought."""
MAX_NAMES = 40
"""Joints that one error message names."""


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
        names = _join_names([joint.name for joint in joints])
        remedy = f"Of these joints {mobility} that move independently must be actuated or elastic, the others passive"
        if not mobility:
            remedy = f"These loops cannot move: a joint is missing, or an axis is wrong; {AXES_HINT}"
        raise DescriptionError(
            f"robot {self.robot.name!r}: the joints of its loops ({names}) have mobility {mobility} and {motors} "
            f"motors: {reason}. {remedy}"
        )


def find_dependent_columns(
    robot: Robot, S: Array, offset: Array, non_mimic_joints: list[int], find_positions: PositionSearch
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
    find_positions : callable
        `closure_search.find_closed_positions`.

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
    joints = [robot.joints[number] for number in non_mimic_joints]
    positions = find_positions(
        robot,
        S,
        offset,
        np.array([joint.initial_position for joint in joints]),
        columns,
        loop_joints.passive_columns,
        np.where([joint.prismatic for joint in joints], robot.characteristic_length, 1.0),
        attitudes,
    )
    ranks = [_full_rank(loop_joints.jacobian(t, attitudes)) for t in positions]
    rank = max(ranks)
    passive_attitudes = attitudes_within(attitudes, loop_joints.passive_columns)
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
        if condition < MAX_GOOD_CONDITION:
            break
    if not candidates:
        assert first_error is not None
        raise first_error
    condition, t, dependent = min(candidates, key=lambda candidate: candidate[0])
    if condition > 1 / RANK_TOLERANCE:
        loop_joints.refuse(rank, "they do not determine the unactuated joints")
    return dependent, t


def _full_rank(J: Array) -> int:
    """Rank of a matrix, singular values compared with the largest one."""
    singular_values = np.linalg.svd(J, compute_uv=False)
    return int(np.sum(singular_values > RANK_TOLERANCE * singular_values.max(initial=0.0)))


def _rank(J: Array, scale: float) -> int:
    """Rank of a matrix, singular values compared with `scale`."""
    return int(np.linalg.matrix_rank(J, tol=RANK_TOLERANCE * scale))


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
    names = [joint.name for joint in joints if joint.role in ("actuated", "elastic")]
    return _join_names(names) if names else "no joint"


def _join_names(names: Sequence[str]) -> str:
    """Names for a message, the first MAX_NAMES of them."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return ", ".join(map(repr, names[:MAX_NAMES])) + more


def _controlled_motions(loop_joints: _LoopJoints, J: Array, rank: int) -> str:
    """Number of independent motions that actuated and elastic joints control, for messages; J: (rows, m)."""
    joints = [loop_joints.robot.joints[number] for number in loop_joints.non_mimic_joints]
    mobility = len(loop_joints.columns) - rank
    passive = [k for k in loop_joints.columns if joints[k].role not in ("actuated", "elastic")]
    uncontrolled = len(passive) - _rank(J[:, passive], float(np.linalg.norm(J, 2)))
    return f"(they control {mobility - uncontrolled} of {mobility} motions: the rank of their Jacobian)"
