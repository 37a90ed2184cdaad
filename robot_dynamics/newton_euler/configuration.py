"""How all joints of a robot move with the independent ones, where its loops are closed, and what forces amount to.

With J from `loop_equations`, J_d of the joints that the loops place and J_i of the independent ones:

    J_d ṫ_d = -J_i q̇,   J_d ẗ_d = -J_i q̈ - J̇q̇,   Γ = Γ_i - J_iᵀ J_d⁻ᵀ Γ_d

(Khalil, sections 2.2 and 4; and section 5 where legs are closed on a platform). Each takes one solution; the matrix G
of q̇_all = G q̇ takes as many as there are independent joints, and then serves them all but J̇q̇.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.newton_euler.least_squares import least_norm, least_squares
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
        return None if self.factors is None else loop_equations(self.coupling.robot, self.q, qd).drift

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

    def _led(self, right_side):
        """(..., all joints, k): what the loops have all joints do, J_d ṫ_d = right_side (..., rows, k)."""
        return self.coupling.S[:, self.coupling.placed] @ least_squares(self.factors, right_side)

    def _multipliers(self, forces):
        """(..., rows), of which the loops exert what forces (..., all joints) ask of the joints that they place."""
        asked = apply_transposed(self.coupling.S[:, self.coupling.placed], forces)
        return least_norm(self.factors, asked[..., None])[..., 0]
