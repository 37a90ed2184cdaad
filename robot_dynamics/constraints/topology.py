"""Constraint topology of a robot: which joints are independent, and which depend on them by mimicry or by loops.

    q_all = S t + offset,   t the positions of the joints that mimic no other joint

Loops make some of the joints t dependent: J_d ṫ_d = -J_i q̇ with J from `loop_equations` (Khalil, sections 2.2 and 4).
The topology is found once for a robot. `state` evaluates it at positions that close the loops, and `closure_solver`
finds such positions.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from scipy.linalg import qr

from robot_dynamics.constraints.attitude_charts import attach_charts, find_attitude_joints
from robot_dynamics.constraints.closure_search import find_closed_positions
from robot_dynamics.constraints.least_squares import partition
from robot_dynamics.constraints.loop_equations import equations_per_loop, loop_equations
from robot_dynamics.constraints.mobility import find_dependent_columns

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray, IntArray, ScalarArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.constraints.least_squares import Partition
    from robot_dynamics.constraints.loop_equations import LoopEquations
    from robot_dynamics.model.robot import Robot


@dataclass(frozen=True, eq=False)
class ConstraintTopology:
    """Independent and dependent joints of a robot, and constants of its loops.

    Attributes
    ----------
    robot : Robot
    S : ndarray, shape (all joints, m)
        Rates of all joints for unit rates of the m joints that mimic no other joint.
    offset : ndarray, shape (all joints,)
        Positions of all joints where these m joints are at zero.
    non_mimic_joints : list of int
        Numbers of these m joints. They are the columns of S and of the loop Jacobian.
    independent_columns, dependent_columns : ndarray of int
        Columns of the independent joints and of the joints that the loops determine.
    reference_positions : ndarray, shape (m,)
        Positions that close the loops, far from singular ones. The initial positions without loops.
    determinant_rows : ndarray of int, shape (dependent,), or None
        Rows of J_d that are linearly independent at the reference positions.
    determinant_sign : int
        Sign of the determinant of these rows at the reference positions. It changes at singular positions only.
    attitudes : tuple of AttitudeJoints
        Of the platforms that have a chart.

    Notes
    -----
    Where the loops determine yaw and roll of a platform, J_d, Newton's steps and the determinant are expressed in the
    chart at its attitude. The determinant is then zero at singular positions only, and not where pitch is ±90°.
    """

    robot: Robot
    S: Array
    offset: Array
    non_mimic_joints: list[int]
    independent_columns: IntArray
    dependent_columns: IntArray
    reference_positions: Array
    determinant_rows: IntArray | None = None
    determinant_sign: int = 1
    attitudes: tuple[AttitudeJoints, ...] = ()

    @property
    def independent(self) -> list[int]:
        """Numbers of the independent joints."""
        return [self.non_mimic_joints[k] for k in self.independent_columns]

    @property
    def dependent(self) -> list[int]:
        """Numbers of the joints that the loops determine."""
        return [self.non_mimic_joints[k] for k in self.dependent_columns]

    def with_robot(self, robot: Robot, shifts: Array | float = 0) -> ConstraintTopology:
        """The same topology for the same robot with other frames or inertias, its positions shifted (all joints,)."""
        return replace(self, robot=robot, offset=self.offset + shifts)

    def with_determinant_sign(self) -> ConstraintTopology:
        """The same topology with `determinant_rows` and `determinant_sign` of its reference positions."""
        J = self.dependent_jacobian(self.reference_positions)
        rows = qr(J.T, mode="r", pivoting=True)[1][: len(self.dependent_columns)]
        return replace(self, determinant_rows=rows, determinant_sign=-1 if np.linalg.det(J[rows]) < 0 else 1)

    def with_independent(self, independent: Sequence[int]) -> ConstraintTopology:
        """The same loops with other independent joints.

        Parameters
        ----------
        independent : sequence of int
            Numbers of joints, as many as `independent` has, none of them a mimic joint. Joints that no loop moves
            must stay among them.

        Returns
        -------
        ConstraintTopology
            This object itself where the joints are the same.
        """
        columns = np.array([self.non_mimic_joints.index(number) for number in sorted(independent)], dtype=int)
        if np.array_equal(columns, self.independent_columns):
            return self
        dependent = np.setdiff1d(np.arange(len(self.non_mimic_joints)), columns)
        return replace(self, independent_columns=columns, dependent_columns=dependent).with_determinant_sign()

    def select_independent(self, q: Array) -> tuple[int, ...]:
        """Select independent joints by pivoting at q.

        The constraint Jacobian is factorized with column pivoting; its first columns are the dependent joints. Source:
        Wehage and Haug, Generalized coordinate partitioning, Journal of Mechanical Design 104 (1982), with a QR
        factorization in place of their Gaussian elimination.

        Parameters
        ----------
        q : ndarray, shape (all joints,)
            Positions that close the loops.

        Returns
        -------
        tuple of int
            Numbers of the independent joints, ascending.
        """
        equations = loop_equations(*attach_charts(self.robot, q, self.attitudes, self.offset))
        J = equations.jacobian @ self.S * self.column_units
        angles = [column for attitude in self.attitudes for column in attitude.columns]  # always dependent
        basis = np.linalg.qr(J[:, angles])[0]
        others = np.setdiff1d(np.arange(len(self.non_mimic_joints)), angles)
        order = qr(J[:, others] - basis @ (basis.T @ J[:, others]), mode="r", pivoting=True)[1]
        independent = others[order[len(self.dependent_columns) - len(angles) :]]
        return tuple(self.non_mimic_joints[k] for k in sorted(independent))

    def joint_positions(self, t: ScalarArray) -> ScalarArray:
        """Positions (..., all joints) from those (..., m) of the joints that mimic no other joint."""
        q: ScalarArray = t @ self.S.T + self.offset
        return q

    def loop_equations_at(self, t: ScalarArray) -> LoopEquations:
        """LoopEquations at t (..., m), their Jacobian in the charts of `dependent_attitudes`."""
        q = self.joint_positions(t)
        return loop_equations(*attach_charts(self.robot, q, self.dependent_attitudes, self.offset))

    def dependent_jacobian(self, t: Array) -> Array:
        """J_d (rows, dependent) at positions t (m,)."""
        J: Array = self.loop_equations_at(t).jacobian @ self.S[:, self.dependent_columns]
        return J

    def condition_number(self, t: Array) -> float:
        """Condition number of J_d at positions t (m,), infinite where J_d is not finite."""
        J = self.dependent_jacobian(t)
        return float(np.linalg.cond(J)) if np.isfinite(J).all() else np.inf

    @cached_property
    def dependent_attitudes(self) -> tuple[AttitudeJoints, ...]:
        """Those of `attitudes` of which the loops determine yaw and roll."""
        dependent = {*self.dependent_columns}
        return tuple(attitude for attitude in self.attitudes if {attitude.columns[0], attitude.columns[2]} <= dependent)

    @cached_property
    def jacobian_partition(self) -> Partition:
        """Blocks of J_d: the rows of each loop, and the columns of joints that belong to no other loop."""
        paths = [
            {*self.robot.path_to_base(loop.moved.link)} ^ {*self.robot.path_to_base(loop.closed_on.link)}
            for loop in self.robot.loops
        ]
        in_loops = np.array([self.S[sorted(path)][:, self.dependent_columns].any(axis=0) for path in paths])
        is_own = in_loops & (in_loops.sum(axis=0) == 1)
        rows = [slice(*ends) for ends in pairwise(np.cumsum([0, *equations_per_loop(self.robot)]))]
        return partition(rows, [np.flatnonzero(columns) for columns in is_own], len(self.dependent_columns))

    @cached_property
    def joint_units(self) -> Array:
        """(all joints,) change of each joint that counts as one radian [rad or m]."""
        length = self.robot.characteristic_length
        return np.array([length if joint.prismatic else 1.0 for joint in self.robot.joints])

    @cached_property
    def column_units(self) -> Array:
        """(m,) `joint_units` of the joints that mimic no other joint."""
        return self.joint_units[self.non_mimic_joints]

    @cached_property
    def loop_joints_moved(self) -> list[BoolArray]:
        """For each independent joint: which joints of loops (all joints,) are this joint or mimic it."""
        in_loops = np.isin(np.arange(len(self.S)), list(self.robot.joints_in_loops))
        return [in_loops & (self.S[:, k] != 0) for k in self.independent_columns]

    @cached_property
    def is_periodic(self) -> BoolArray:
        """(n,) whether a whole turn of an independent joint brings its loops back to the same positions."""
        is_revolute = [not joint.prismatic for joint in self.robot.joints]
        return np.array(
            [
                np.all(is_revolute, where=moved) and not np.any(self.S[moved, k] % 1)
                for k, moved in zip(self.independent_columns, self.loop_joints_moved, strict=True)
            ],
            dtype=bool,
        )

    @cached_property
    def independent_limits(self) -> Array:
        """(2, n) lower and upper limits of the independent joints."""
        limits = [self.robot.joints[number].limits for number in self.independent]
        return np.array([[limit.lower for limit in limits], [limit.upper for limit in limits]], dtype=float)


def build_topology(robot: Robot) -> ConstraintTopology:
    """Find the ConstraintTopology of a robot.

    Raises
    ------
    DescriptionError
        The loops cannot be closed, or do not fit the number of motors.
    """
    joints = len(robot.joints)
    non_mimic_joints = [number for number, (leader, _, _) in enumerate(robot.mimic_relations) if leader == number]
    column_of = {number: column for column, number in enumerate(non_mimic_joints)}
    S = np.zeros((joints, len(non_mimic_joints)))
    offset = np.zeros(joints)
    for number, (leader, multiplier, shift) in enumerate(robot.mimic_relations):
        S[number, column_of[leader]] = multiplier
        offset[number] = shift
    columns = np.arange(len(non_mimic_joints))
    if not robot.loops:
        initial = np.array([robot.joints[number].initial_position for number in non_mimic_joints])
        return ConstraintTopology(robot, S, offset, non_mimic_joints, columns, np.zeros(0, dtype=int), initial)
    with np.errstate(all="ignore"):  # loops that are half a turn open give nan, and are refused
        dependent, reference_positions = find_dependent_columns(
            robot, S, offset, non_mimic_joints, find_closed_positions
        )
    return ConstraintTopology(
        robot,
        S,
        offset,
        non_mimic_joints,
        np.setdiff1d(columns, dependent),
        dependent,
        reference_positions,
        attitudes=find_attitude_joints(robot, non_mimic_joints),
    ).with_determinant_sign()
