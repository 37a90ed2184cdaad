"""Constrained state: how all joints move with the independent ones at positions that close the loops.

With J from `loop_equations`, J_d of the joints that the loops determine and J_i of the independent ones:

    q̇_all = G q̇,   q̈_all = G q̈ + drift,   Γ = Gᵀ Γ_all
    J_d ṫ_d = -J_i q̇,   J_d ẗ_d = -J_i q̈ - J̇q̇,   Γ = Γ_i - J_iᵀ J_d⁻ᵀ Γ_d

(Khalil, sections 2.2 and 4; section 5 where legs are closed on a platform). Without loops G = S and the drift is zero.
Each rate, acceleration or projection takes one solution with J_d. The matrix G takes as many solutions as there are
independent joints; rates and projections then need no other one.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.constraints import attitude_charts
from robot_dynamics.constraints.least_squares import factor_bordered, least_norm, least_squares
from robot_dynamics.constraints.loop_equations import loop_equations, loop_wrenches
from robot_dynamics.newton_euler.screw import apply, apply_transposed

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.constraints.attitude_charts import AttitudeJoints
    from robot_dynamics.constraints.least_squares import BorderedFactors
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.model.robot import Robot


@dataclass(frozen=True, eq=False)
class LoopJacobian:
    """Loop Jacobian at one q.

    matrix: J (..., rows, m) of the joints that mimic no other joint; dependent_basis: (..., m, dependent), rates of
    these joints for unit rates of the dependent ones; factors: of J dependent_basis.
    """

    matrix: ScalarArray
    dependent_basis: ScalarArray
    factors: BorderedFactors


@dataclass(frozen=True, eq=False)
class ConstrainedState:
    """Rates, accelerations and forces of all joints at positions that close the loops.

    Attributes
    ----------
    topology : ConstraintTopology
    q : ndarray, shape (..., all joints)
    loops : LoopJacobian or None
        None without loops.
    uses_G : bool
        Whether rates and forces are computed with the matrix G. This costs less where there are few independent
        joints, where G is needed anyway, and with numbers instead of symbols.
    """

    topology: ConstraintTopology
    q: ScalarArray
    loops: LoopJacobian | None
    uses_G: bool

    @property
    def robot(self) -> Robot:
        """The Robot as the recursions take it, at positions `chart_q`."""
        return self.topology.robot

    @property
    def chart_q(self) -> ScalarArray:
        """Positions (..., all joints) that belong to `robot`."""
        return self.q

    @property
    def attitudes(self) -> tuple[AttitudeJoints, ...]:
        """Attitude joints of the platforms that move in their charts."""
        return ()

    def joint_velocities(self, rates: Array) -> Array:
        """Velocities (..., all joints) of the joints, from the rates (..., all joints) of `expand_rates`."""
        return rates

    def joint_accelerations(self, rates: Array, accelerations: Array) -> Array:
        """Accelerations (..., all joints) of the joints, from rates and accelerations of `expand_rates`."""
        return accelerations

    def chart_forces(self, efforts: Array) -> Array:
        """Forces (..., all joints) as `projected` takes them, from those at the joints."""
        return efforts

    def complete_rates(self, rates: Array, constraint_drift: Array | None = None) -> Array:
        """Rates of all joints that satisfy the constraints, from rates of all joints that do not.

        The dependent joints move besides as the loops require.

        Parameters
        ----------
        rates : ndarray, shape (..., all joints)
            Rates, or accelerations where `constraint_drift` is J̇q̇ (..., rows).

        Returns
        -------
        ndarray, shape (..., all joints)
        """
        loops = self._loops
        rates = rates[..., self.topology.non_mimic_joints]
        missing = apply(loops.matrix, rates)
        missing = missing if constraint_drift is None else missing + constraint_drift
        dependent_rates = least_squares(loops.factors, -missing[..., None])[..., 0]
        complete: Array = (rates + apply(loops.dependent_basis, dependent_rates)) @ self.topology.S.T
        return complete

    def expand_rates(self, values: ScalarArray, constraint_drift: ScalarArray | None = None) -> ScalarArray:
        """Velocities of all joints from those of the independent joints, or accelerations from accelerations.

        Parameters
        ----------
        values : ndarray, shape (..., n)
            Velocities, or accelerations where `constraint_drift` is J̇q̇ (..., rows).

        Returns
        -------
        ndarray, shape (..., all joints)
        """
        if self.uses_G:
            rates = apply(self.G, values)
            return rates if constraint_drift is None else rates + self.close_rates(-constraint_drift[..., None])[..., 0]
        missing = apply(self._independent_jacobian, values)
        missing = missing if constraint_drift is None else missing + constraint_drift
        return apply(self._independent_basis, values) + self.close_rates(-missing[..., None])[..., 0]

    def projected(self, forces: ScalarArray) -> ScalarArray:
        """Gᵀ Γ_all: forces (..., all joints) projected onto the independent joints (..., n)."""
        if self.uses_G:
            return apply_transposed(self.G, forces)
        projected = apply_transposed(self._independent_basis, forces)
        return projected - apply_transposed(self._independent_jacobian, self.multipliers(forces))

    def constraint_drift(self, qd: ScalarArray) -> ScalarArray | None:
        """J̇q̇ (..., rows) at velocities qd (..., all joints), None without loops."""
        return None if self.loops is None else loop_equations(self.robot, self.chart_q, qd).drift

    def drift(self, qd: ScalarArray) -> ScalarArray:
        """Accelerations (..., all joints) at velocities qd (..., all joints) with the independent ones zero."""
        return self.expand_rates(np.zeros(len(self.topology.independent_columns), dtype=int), self.constraint_drift(qd))

    @cached_property
    def G(self) -> ScalarArray:
        """(..., all joints, n): rates of all joints for unit rates of the independent ones; no batch without loops."""
        if self.loops is None:
            return self._independent_basis
        with np.errstate(all="ignore"):  # the caller refuses singular positions
            return self._independent_basis + self.close_rates(-self._independent_jacobian)

    def loop_wrenches(self, tree_efforts: Array) -> Iterator[tuple[int, Array]]:
        """Wrenches that the loops exert on the links at their ends.

        Parameters
        ----------
        tree_efforts : ndarray, shape (..., all joints)
            Efforts that the open tree requires for its motion. The loops exert those of the dependent joints.

        Yields
        ------
        (int, ndarray)
            Link number, and the wrench (..., 6) on the link, in its frame at its origin.

        Notes
        -----
        Redundant loops have wrenches of least norm, with torques divided by the characteristic length. Other wrenches
        of the same motion would only strain the links.
        """
        return loop_wrenches(self.topology.robot, self.q, self.multipliers(tree_efforts))

    @property
    def _loops(self) -> LoopJacobian:
        assert self.loops is not None, "a robot without loops has no loop Jacobian"
        return self.loops

    @property
    def _independent_basis(self) -> Array:
        """(all joints, n): rates of all joints for unit rates of the independent ones, the dependent ones at rest."""
        return self.topology.S[:, self.topology.independent_columns]

    @property
    def _independent_jacobian(self) -> ScalarArray:
        """J_i (..., rows, n)."""
        return self._loops.matrix[..., self.topology.independent_columns]

    def close_rates(self, right_side: ScalarArray) -> ScalarArray:
        """(..., all joints, k): rates of all joints with J_d ṫ_d = right_side (..., rows, k)."""
        return self.topology.S @ self._loops.dependent_basis @ least_squares(self._loops.factors, right_side)

    def multipliers(self, forces: ScalarArray) -> ScalarArray:
        """(..., rows) multipliers with which the loops exert the forces (..., all joints) at the dependent joints."""
        dependent_forces = apply_transposed(self.topology.S @ self._loops.dependent_basis, forces)
        return least_norm(self._loops.factors, dependent_forces[..., None])[..., 0]


@dataclass(frozen=True, eq=False)
class ChartedConstrainedState(ConstrainedState):
    """A ConstrainedState with rates and forces in the charts of all platforms that have one.

    Rates and forces of attitude joints are those of the chart, and so are the rates of independent attitude joints.
    Where the loops determine yaw and roll is independent, the dependent rate is that of yaw: the chart has no such
    axis.

    charted_robot, charted_positions: `robot` and `chart_q`.
    """

    charted_robot: Robot
    charted_positions: ScalarArray

    @property
    def robot(self) -> Robot:
        return self.charted_robot

    @property
    def chart_q(self) -> ScalarArray:
        return self.charted_positions

    @property
    def attitudes(self) -> tuple[AttitudeJoints, ...]:
        return self.topology.attitudes

    def joint_velocities(self, rates: Array) -> Array:
        return attitude_charts.joint_velocities(self.q, rates, *self._charts)

    def joint_accelerations(self, rates: Array, accelerations: Array) -> Array:
        velocities = self.joint_velocities(rates)
        return attitude_charts.joint_accelerations(self.q, velocities, accelerations, *self._charts)

    def chart_forces(self, efforts: Array) -> Array:
        return attitude_charts.chart_forces(self.q, efforts, *self._charts)

    @property
    def _charts(self) -> tuple[tuple[AttitudeJoints, ...], Array]:
        return self.topology.attitudes, self.topology.offset


def state_at(topology: ConstraintTopology, q: ScalarArray, uses_G: bool = True) -> ConstrainedState:
    """The ConstrainedState at positions q (..., all joints) that close the loops.

    `uses_G` is an attribute of ConstrainedState.
    """
    if not len(topology.dependent_columns):
        return ConstrainedState(topology, q, None, uses_G=True)
    J = loop_equations(topology.robot, q).jacobian @ topology.S
    factors = factor_bordered(J[..., topology.dependent_columns], topology.jacobian_partition)
    basis = np.eye(len(topology.non_mimic_joints), dtype=int)[:, topology.dependent_columns]
    return ConstrainedState(topology, q, LoopJacobian(J, basis, factors), uses_G)


def charted_state_at(topology: ConstraintTopology, q: ScalarArray, uses_G: bool = True) -> ConstrainedState:
    """As `state_at`, with rates and forces in the charts of the platforms' attitudes: also where pitch is ±90°."""
    if not topology.attitudes:
        return state_at(topology, q, uses_G)
    robot, chart_q = attitude_charts.attach_charts(topology.robot, q, topology.attitudes, topology.offset)
    J = loop_equations(robot, chart_q).jacobian @ topology.S
    basis = _charted_dependent_basis(topology, q)
    factors = factor_bordered(J @ basis, topology.jacobian_partition)
    return ChartedConstrainedState(topology, q, LoopJacobian(J, basis, factors), uses_G, robot, chart_q)


def _charted_dependent_basis(topology: ConstraintTopology, q: ScalarArray) -> ScalarArray:
    """LoopJacobian.dependent_basis in the charts at positions q (..., all joints)."""
    basis = np.eye(len(topology.non_mimic_joints), dtype=int)[:, topology.dependent_columns]
    for attitude in topology.attitudes:
        yaw, _, roll = attitude.columns
        if yaw in topology.dependent_columns and roll not in topology.dependent_columns:
            sine, cosine = attitude_charts.pitch_sine_cosine(q, attitude, topology.offset)
            basis = np.array(np.broadcast_to(basis, (*sine.shape, *basis.shape[-2:])), dtype=float)
            column = topology.dependent_columns.tolist().index(yaw)
            basis[..., yaw, column] = cosine
            basis[..., roll, column] = -sine
    return basis


def projection_matrix(G: ScalarArray, base_rows: int) -> ScalarArray:
    """Projection of generalized forces from all joints onto the independent ones, the rows of a moving base kept.

    Parameters
    ----------
    G : ndarray, shape (..., joints, n)
    base_rows : int
        6 with a moving base, else 0.

    Returns
    -------
    ndarray, shape (..., base_rows + joints, base_rows + n)
        Its transpose projects; without base rows it is G.
    """
    if not base_rows:
        return G
    matrix = np.zeros((*G.shape[:-2], base_rows + G.shape[-2], base_rows + G.shape[-1]), dtype=G.dtype)
    matrix[..., :base_rows, :base_rows] = np.eye(base_rows, dtype=int)
    matrix[..., base_rows:, base_rows:] = G
    return matrix
