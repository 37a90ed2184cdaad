"""How all joints of a robot move with the independent ones, where its loops are closed, and what forces amount to.

With J from `loop_equations`, J_d of the joints that the loops place and J_i of the independent ones:

    J_d ṫ_d = -J_i q̇,   J_d ẗ_d = -J_i q̈ - J̇q̇,   Γ = Γ_i - J_iᵀ J_d⁻ᵀ Γ_d

(Khalil, sections 2.2 and 4; and section 5 where legs are closed on a platform). Each takes one solution; the matrix G
of q̇_all = G q̇ takes as many as there are independent joints, and then serves them all but J̇q̇.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.constraints import attitude_charts
from robot_dynamics.constraints.least_squares import factor_bordered, least_norm, least_squares
from robot_dynamics.constraints.loop_equations import loop_equations, loop_wrenches
from robot_dynamics.newton_euler.screw import apply, apply_transposed


@dataclass(frozen=True, eq=False)
class ConstrainedState:
    """Positions q (..., all joints) that close the loops of a Coupling.

    jacobian: (..., rows, m) of the joints that follow no other one; factors: the Bordered form of its columns of the
    joints that the loops place. Both None without loops. formed: whether rates and forces pass by G.
    """

    topology: object
    q: np.ndarray
    jacobian: np.ndarray | None
    factors: object
    uses_G: bool

    @property
    def robot(self):
        """The Robot as the recursions take it, with positions `local`."""
        return self.topology.robot

    @property
    def chart_q(self):
        """Positions (..., all joints) that go with `robot`."""
        return self.q

    @property
    def attitudes(self):
        """The Attitudes of platforms that move in their charts."""
        return ()

    def joint_velocities(self, rates):
        """Velocities (..., all joints) of the joints, from what `rates` gives."""
        return rates

    def joint_accelerations(self, rates, accelerations):
        """Accelerations (..., all joints) of the joints, from what `rates` gives for velocities and accelerations."""
        return accelerations

    def chart_forces(self, efforts):
        """Forces (..., all joints) as `gathered` takes them, from those at the joints."""
        return efforts

    def complete_rates(self, given, constraint_drift=None):
        """(..., all joints) rates, or accelerations with `turning`: those `given` (..., all joints), and what the loops
        make the joints do besides that they place."""
        given = given[..., self.topology.non_mimic_joints]
        missing = apply(self.jacobian, given)
        missing = missing if constraint_drift is None else missing + constraint_drift
        found = given + apply(self.dependent_basis, least_squares(self.factors, -missing[..., None])[..., 0])
        return found @ self.topology.S.T

    def expand_rates(self, values, constraint_drift=None):
        """(..., all joints) velocities, from those of the independent joints (..., n); or accelerations from theirs,
        where `turning` tells J̇q̇."""
        if self.uses_G:
            led = apply(self.G, values)
            return led if constraint_drift is None else led + self._led(-constraint_drift[..., None])[..., 0]
        missing = apply(self.jacobian[..., self.topology.independent_columns], values)
        missing = missing if constraint_drift is None else missing + constraint_drift
        return apply(self._independent, values) + self._led(-missing[..., None])[..., 0]

    def projected(self, forces):
        """What forces (..., all joints) amount to on the independent joints (..., n)."""
        if self.uses_G:
            return apply_transposed(self.G, forces)
        led = apply_transposed(self._independent, forces)
        return led - apply_transposed(self.jacobian[..., self.topology.independent_columns], self._multipliers(forces))

    def constraint_drift(self, qd):
        """J̇q̇ (..., rows) at velocities qd (..., all joints), None without loops."""
        return None if self.factors is None else loop_equations(self.robot, self.chart_q, qd).drift

    def drift(self, qd):
        """Accelerations (..., all joints) at velocities qd (..., all joints), the independent ones unaccelerated."""
        return self.expand_rates(np.zeros(len(self.topology.independent_columns), dtype=int), self.constraint_drift(qd))

    @cached_property
    def G(self):
        """(..., all joints, n), from rates of the independent joints to those of all; (all joints, n) without loops."""
        if self.factors is None:
            return self._independent
        with np.errstate(all="ignore"):  # who asks refuses singular positions
            return self._independent + self._led(-self.jacobian[..., self.topology.independent_columns])

    def loop_wrenches(self, tree_efforts):
        """(link number, wrench (..., 6) on it, in its frame at its origin) of both ends of each loop.

        demands: (..., all joints), of which the loops exert what is asked of the joints that they place. Where loops
        have more equations than that takes, wrenches are those of least norm, with torques told by the characteristic
        length: others of the same motion would only strain the links.
        """
        return loop_wrenches(self.topology.robot, self.q, self._multipliers(tree_efforts))

    @property
    def _independent(self):
        """(all joints, n): how joints that follow others do."""
        return self.topology.S[:, self.topology.independent_columns]

    @property
    def dependent_basis(self):
        """(..., m, dependent): rates of the joints that follow no other one, for unit rates of those that the loops
        place."""
        return np.eye(len(self.topology.non_mimic_joints), dtype=int)[:, self.topology.dependent_columns]

    def _led(self, right_side):
        """(..., all joints, k): what the loops have all joints do, J_d ṫ_d = right_side (..., rows, k)."""
        return self.topology.S @ self.dependent_basis @ least_squares(self.factors, right_side)

    def _multipliers(self, forces):
        """(..., rows), of which the loops exert what forces (..., all joints) ask of the joints that they place."""
        asked = apply_transposed(self.topology.S @ self.dependent_basis, forces)
        return least_norm(self.factors, asked[..., None])[..., 0]


@dataclass(frozen=True, eq=False)
class ChartedConstrainedState(ConstrainedState):
    """A Configuration with rates and forces in the charts of `attitude`, at all platforms that have one.

    Of joints in a chart, what `rates` gives and `gathered` takes belongs to the chart, and so do the rates of those
    that are independent. Where the loops place yaw, and roll is independent, what they place is yaw all the same: the
    chart has no such axis.
    """

    robot: object = None
    chart_q: np.ndarray | None = None

    @classmethod
    def of(cls, coupling, q, partition, uses_G=True):
        """The ChartedConfiguration of a Coupling at positions q (..., all joints) that close its loops."""
        robot, local = attitude_charts.attach_charts(coupling.robot, q, coupling.attitudes, coupling.offset)
        found = cls(coupling, q, loop_equations(robot, local).jacobian @ coupling.S, None, uses_G, robot, local)
        object.__setattr__(found, "factors", factor_bordered(found.jacobian @ found.dependent_basis, partition))
        return found

    def joint_velocities(self, rates):
        return attitude_charts.joint_velocities(self.q, rates, *self._charts)

    def joint_accelerations(self, rates, accelerations):
        velocities = self.joint_velocities(rates)
        return attitude_charts.joint_accelerations(self.q, velocities, accelerations, *self._charts)

    def chart_forces(self, efforts):
        return attitude_charts.chart_forces(self.q, efforts, *self._charts)

    @property
    def attitudes(self):
        return self.topology.attitudes

    @property
    def _charts(self):
        return self.topology.attitudes, self.topology.offset

    @cached_property
    def dependent_basis(self):
        coupling = self.topology
        found = np.eye(len(coupling.non_mimic_joints), dtype=int)[:, coupling.dependent_columns]
        for one in coupling.attitudes:
            yaw, _, roll = one.columns
            if yaw in coupling.dependent_columns and roll not in coupling.dependent_columns:
                sine, cosine = attitude_charts.pitch_sine_cosine(self.q, one, coupling.offset)
                found = np.array(np.broadcast_to(found, (*sine.shape, *found.shape[-2:])), dtype=float)
                column = coupling.dependent_columns.tolist().index(yaw)
                found[..., yaw, column], found[..., roll, column] = cosine, -sine
        return found
