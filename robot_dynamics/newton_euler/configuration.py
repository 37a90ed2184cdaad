"""How all joints of a robot move with the independent ones, where its loops are closed, and what forces amount to.

With J from `loop_equations`, J_d of the joints that the loops place and J_i of the independent ones:

    J_d ṫ_d = -J_i q̇,   J_d ẗ_d = -J_i q̈ - J̇q̇,   Γ = Γ_i - J_iᵀ J_d⁻ᵀ Γ_d

(Khalil, sections 2.2 and 4; and section 5 where legs are closed on a platform). Each takes one solution; the matrix G
of q̇_all = G q̇ takes as many as there are independent joints, and then serves them all but J̇q̇.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.newton_euler import attitude
from robot_dynamics.newton_euler.least_squares import bordered, least_norm, least_squares
from robot_dynamics.newton_euler.loops import loop_equations, loop_wrenches
from robot_dynamics.newton_euler.screw import apply, apply_transposed


@dataclass(frozen=True, eq=False)
class Configuration:
    """Positions q (..., all joints) that close the loops of a Coupling.

    jacobian: (..., rows, m) of the joints that follow no other one; factors: the Bordered form of its columns of the
    joints that the loops place. Both None without loops. formed: whether rates and forces pass by G.
    """

    coupling: object
    q: np.ndarray
    jacobian: np.ndarray | None
    factors: object
    formed: bool

    @property
    def robot(self):
        """The Robot as the recursions take it, with positions `local`."""
        return self.coupling.robot

    @property
    def local(self):
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

    def forces(self, efforts):
        """Forces (..., all joints) as `gathered` takes them, from those at the joints."""
        return efforts

    def completed(self, given, turning=None):
        """(..., all joints) rates, or accelerations with `turning`: those `given` (..., all joints), and what the loops
        make the joints do besides that they place."""
        given = given[..., self.coupling.free]
        missing = apply(self.jacobian, given)
        missing = missing if turning is None else missing + turning
        found = given + apply(self.leading, least_squares(self.factors, -missing[..., None])[..., 0])
        return found @ self.coupling.S.T

    def rates(self, values, turning=None):
        """(..., all joints) velocities, from those of the independent joints (..., n); or accelerations from theirs,
        where `turning` tells J̇q̇."""
        if self.formed:
            led = apply(self.G, values)
            return led if turning is None else led + self._led(-turning[..., None])[..., 0]
        missing = apply(self.jacobian[..., self.coupling.chosen], values)
        missing = missing if turning is None else missing + turning
        return apply(self._independent, values) + self._led(-missing[..., None])[..., 0]

    def gathered(self, forces):
        """What forces (..., all joints) amount to on the independent joints (..., n)."""
        if self.formed:
            return apply_transposed(self.G, forces)
        led = apply_transposed(self._independent, forces)
        return led - apply_transposed(self.jacobian[..., self.coupling.chosen], self._multipliers(forces))

    def turning(self, qd):
        """J̇q̇ (..., rows) at velocities qd (..., all joints), None without loops."""
        return None if self.factors is None else loop_equations(self.robot, self.local, qd).drift

    def drift(self, qd):
        """Accelerations (..., all joints) at velocities qd (..., all joints), the independent ones unaccelerated."""
        return self.rates(np.zeros(len(self.coupling.chosen), dtype=int), self.turning(qd))

    @cached_property
    def G(self):
        """(..., all joints, n), from rates of the independent joints to those of all; (all joints, n) without loops."""
        if self.factors is None:
            return self._independent
        with np.errstate(all="ignore"):  # who asks refuses singular positions
            return self._independent + self._led(-self.jacobian[..., self.coupling.chosen])

    def loop_wrenches(self, demands):
        """(link number, wrench (..., 6) on it, in its frame at its origin) of both ends of each loop.

        demands: (..., all joints), of which the loops exert what is asked of the joints that they place. Where loops
        have more equations than that takes, wrenches are those of least norm, with torques told by the characteristic
        length: others of the same motion would only strain the links.
        """
        return loop_wrenches(self.coupling.robot, self.q, self._multipliers(demands))

    @property
    def _independent(self):
        """(all joints, n): how joints that follow others do."""
        return self.coupling.S[:, self.coupling.chosen]

    @property
    def leading(self):
        """(..., m, dependent): rates of the joints that follow no other one, for unit rates of those that the loops
        place."""
        return np.eye(len(self.coupling.free), dtype=int)[:, self.coupling.placed]

    def _led(self, right_side):
        """(..., all joints, k): what the loops have all joints do, J_d ṫ_d = right_side (..., rows, k)."""
        return self.coupling.S @ self.leading @ least_squares(self.factors, right_side)

    def _multipliers(self, forces):
        """(..., rows), of which the loops exert what forces (..., all joints) ask of the joints that they place."""
        asked = apply_transposed(self.coupling.S @ self.leading, forces)
        return least_norm(self.factors, asked[..., None])[..., 0]


@dataclass(frozen=True, eq=False)
class ChartedConfiguration(Configuration):
    """A Configuration with rates and forces in the charts of `attitude`, at all platforms that have one.

    Of joints in a chart, what `rates` gives and `gathered` takes belongs to the chart, and so do the rates of those
    that are independent. Where the loops place yaw, and roll is independent, what they place is yaw all the same: the
    chart has no such axis.
    """

    robot: object = None
    local: np.ndarray | None = None

    @classmethod
    def of(cls, coupling, q, partition, formed=True):
        """The ChartedConfiguration of a Coupling at positions q (..., all joints) that close its loops."""
        robot, local = attitude.charted(coupling.robot, q, coupling.attitudes, coupling.offset)
        found = cls(coupling, q, loop_equations(robot, local).jacobian @ coupling.S, None, formed, robot, local)
        object.__setattr__(found, "factors", bordered(found.jacobian @ found.leading, partition))
        return found

    def joint_velocities(self, rates):
        return attitude.joint_velocities(self.q, rates, *self._charts)

    def joint_accelerations(self, rates, accelerations):
        velocities = self.joint_velocities(rates)
        return attitude.joint_accelerations(self.q, velocities, accelerations, *self._charts)

    def forces(self, efforts):
        return attitude.chart_forces(self.q, efforts, *self._charts)

    @property
    def attitudes(self):
        return self.coupling.attitudes

    @property
    def _charts(self):
        return self.coupling.attitudes, self.coupling.offset

    @cached_property
    def leading(self):
        coupling = self.coupling
        found = np.eye(len(coupling.free), dtype=int)[:, coupling.placed]
        for one in coupling.attitudes:
            yaw, _, roll = one.places
            if yaw in coupling.placed and roll not in coupling.placed:
                sine, cosine = attitude.sine_cosine(self.q, one, coupling.offset)
                found = np.array(np.broadcast_to(found, (*sine.shape, *found.shape[-2:])), dtype=float)
                column = coupling.placed.tolist().index(yaw)
                found[..., yaw, column], found[..., roll, column] = cosine, -sine
        return found
