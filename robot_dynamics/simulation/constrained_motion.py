"""Independent coordinates of closed loops during a simulation.

The positions of all joints are integrated together. After each part of a step the dependent ones are put back on the
constraints by Newton's method, which begins at the integrated positions. A mechanism therefore stays on its branch
where two assembly modes meet. The independent coordinates are selected by pivoting, and selected again where the loops
no longer determine the other joints well. A mechanism therefore passes a dead point of its motor. Source: Wehage and
Haug, Generalized coordinate partitioning for dimension reduction in analysis of constrained dynamic systems, Journal of
Mechanical Design 104 (1982).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple, NoReturn

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.constraints import attitude_charts
from robot_dynamics.constraints.branch_tracker import BranchTracker
from robot_dynamics.constraints.closure_search import find_widest_loop
from robot_dynamics.constraints.constrained_state import charted_state_at
from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.constraints.newton_iteration import NEWTON_TOLERANCE
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.errors import SingularModelError
from robot_dynamics.simulation.attitude_integration import AttitudeIntegration
from robot_dynamics.simulation.step_limits import DEGRADATION_RATIO, MAX_TRAVEL, NEAR_SINGULAR_QUALITY
from robot_dynamics.simulation.step_parts import limit_travel

if TYPE_CHECKING:
    from robot_dynamics.constraints.constrained_state import ConstrainedState
    from robot_dynamics.constraints.topology import ConstraintTopology
    from robot_dynamics.dynamics import Dynamics

SINGULAR_QUALITY = 1e-6
"""Quality of coordinates below which values are interpolated along the branch."""
IMPROVEMENT_RATIO = 2.0
"""Ratio of qualities from which another set of coordinates replaces the present one."""
MAX_TRAVEL_NEAR_SINGULAR = 0.02
"""Longest travel of a joint in a part of a step near a singular position [rad or characteristic lengths]."""

ClosureStep = Callable[[Array], tuple[Array, ...]]
"""The program `closure`: one step of Newton's method at positions (m,) of the non-mimic joints."""


class LoopCoordinates(NamedTuple):
    """The joints of a robot with loops that are the independent coordinates.

    Attributes
    ----------
    independent : tuple of int
        Numbers of the joints whose velocities are integrated.
    best_quality : float
        Best quality since these joints were selected.
    quality : float
        How well the loops determine the other joints at the present positions: the least squared sine between a column
        of the constraint Jacobian and those before it; 0 where the other joints are not determined.
    """

    independent: tuple[int, ...]
    best_quality: float
    quality: float


class ConstrainedMotion:
    """Closed loops of a robot whose independent coordinates change during a simulation.

    Parameters
    ----------
    dynamics : Dynamics
        Of a robot with loops.

    Attributes
    ----------
    default_independent : tuple of int
        Numbers of the joints of Dynamics.joint_names.
    joint_units : ndarray, shape (all joints,)
        Displacement of each joint that counts as much as one radian [rad or m].
    attitudes : AttitudeIntegration
        Conversions between angles of platforms and the charts of their attitudes.
    """

    def __init__(self, dynamics: Dynamics) -> None:
        self._dynamics = dynamics
        self._topology = build_topology(dynamics.robot)
        self._partitions: dict[tuple[int, ...], tuple[ConstraintTopology, ClosureStep]] = {}
        self.default_independent = tuple(self._topology.independent)
        self.joint_units: Array = self._topology.joint_units
        self.attitudes = AttitudeIntegration(self._topology)
        self._joints_in_loops = sorted(dynamics.robot.joints_in_loops)

    def default_coordinates(self, q: Array) -> LoopCoordinates:
        """Coordinates of Dynamics.joint_names at positions q (all joints,) that close the loops."""
        quality = self._partition_quality(self.default_independent, q)
        return LoopCoordinates(self.default_independent, quality, quality)

    def choose_coordinates(self, coordinates: LoopCoordinates, q: Array) -> LoopCoordinates:
        """Coordinates for positions q (all joints,): other joints where the present ones have become much worse."""
        independent, best_quality, quality = coordinates
        if quality >= DEGRADATION_RATIO * best_quality:
            return LoopCoordinates(independent, max(best_quality, quality), quality)
        candidate = self._topology.select_independent(q)
        candidate_quality = self._partition_quality(candidate, q)
        if candidate_quality > IMPROVEMENT_RATIO * quality:
            return LoopCoordinates(candidate, candidate_quality, candidate_quality)
        return LoopCoordinates(independent, quality, quality)

    def close_loops(
        self, coordinates: LoopCoordinates, q: Array, tolerance: float = NEWTON_TOLERANCE
    ) -> tuple[Array, float]:
        """Put positions on the constraints; the independent joints keep theirs.

        Parameters
        ----------
        coordinates : LoopCoordinates
        q : ndarray, shape (all joints,)
            Positions predicted by the integration.
        tolerance : float
            Residual at which Newton's method ends.

        Returns
        -------
        q : ndarray, shape (all joints,)
        quality : float

        Raises
        ------
        SingularModelError
            The loops do not close near q.
        """
        partition, step = self._partition(coordinates.independent)
        result = BranchTracker(partition, step).project_onto_constraints(self.non_mimic_positions(q)[None], tolerance)
        if not result.is_closed[0]:
            self.raise_singular(q, "do not close near the integrated positions")
        return self.all_positions(result.t[0]), float(result.quality[0])

    def quality(self, coordinates: LoopCoordinates, q: Array) -> float:
        """Quality of the coordinates at positions q (all joints,) near the constraints."""
        return self._partition_quality(coordinates.independent, q)

    def constrained_state(self, coordinates: LoopCoordinates, q: Array) -> ConstrainedState:
        """The constrained state at positions q (all joints,), with the independent joints of the coordinates."""
        partition, _ = self._partition(coordinates.independent)
        return charted_state_at(partition, q)

    def limit_substep(
        self, length: float, step: float, coordinates: LoopCoordinates, q: Array, velocities: Array
    ) -> float:
        """Length of a part of a step [s], halved until no joint of the loops travels too far in it.

        velocities: (all joints,) at positions q (all joints,).
        """
        travel = MAX_TRAVEL_NEAR_SINGULAR if coordinates.quality < NEAR_SINGULAR_QUALITY else MAX_TRAVEL
        speed = self.loop_speed(self.attitudes.chart_rates(q, velocities))
        limited: float = limit_travel(length, speed, travel, step)
        return limited

    def loop_speed(self, rates: Array) -> float:
        """Largest of the rates (all joints,) of joints in loops [rad/s or characteristic lengths/s]."""
        speed: float = np.abs(rates / self.joint_units)[self._joints_in_loops].max()
        return speed

    def correction(self, q: Array, closed: Array) -> float:
        """Largest displacement of a joint from positions q to `closed` [rad or characteristic lengths]."""
        units = self.joint_units[self._topology.non_mimic_joints]
        largest: float = np.abs(self.displacement(q, closed) / units).max()
        return largest

    def displace(self, q: Array, displacement: Array) -> Array:
        """Positions (all joints,) after a displacement (m,) of the non-mimic joints, in platform charts at q."""
        t = attitude_charts.displace(self.non_mimic_positions(q), displacement, self._topology.attitudes)
        return self.all_positions(t)

    def displacement(self, begin: Array, end: Array) -> Array:
        """Displacement (m,) of the non-mimic joints between positions (all joints,), in the charts at the end."""
        t_begin, t_end = self.non_mimic_positions(begin), self.non_mimic_positions(end)
        return attitude_charts.displacement(t_begin, t_end, self._topology.attitudes)

    def non_mimic_positions(self, q: Array) -> Array:
        """Positions (m,) of the joints that are no mimic joints."""
        return np.ascontiguousarray(q[self._topology.non_mimic_joints])

    def all_positions(self, t: Array) -> Array:
        """Positions (all joints,) for positions t (m,) of the joints that are no mimic joints."""
        q: Array = self._topology.S @ t + self._topology.offset
        return q

    def raise_singular(self, q: Array, reason: str) -> NoReturn:
        """Raise SingularModelError for positions q (all joints,), with the loop that is open widest."""
        robot = self._dynamics.robot
        loop, _, _ = find_widest_loop(robot, loop_equations(robot, q).residual)
        names = self._dynamics.all_joint_names
        positions = ", ".join(f"{name} {value:.6g}" for name, value in zip(names, q, strict=True))
        raise SingularModelError(f"loop {loop!r} is singular: the loops {reason} (at {positions})")

    def topology_of(self, independent: tuple[int, ...]) -> ConstraintTopology:
        """The topology with other independent joints (numbers)."""
        return self._partition(independent)[0]

    def _partition(self, independent: tuple[int, ...]) -> tuple[ConstraintTopology, ClosureStep]:
        """Topology and Newton step of a set of independent joints."""
        if independent not in self._partitions:
            partition = self._topology.with_independent(independent)
            program = self._dynamics.compile("closure", independent=independent)
            self._partitions[independent] = partition, program.evaluate
        return self._partitions[independent]

    def _partition_quality(self, independent: tuple[int, ...], q: Array) -> float:
        _, step = self._partition(independent)
        _, _, pivots, lengths, _ = step(self.non_mimic_positions(q))
        return float((pivots / lengths).min())
