"""Deflections of series elastic actuators, and the motion of the motors that gives the links a desired motion.

Spring and damper transmit the torque that the link needs:

    d δ̇ + k δ = τ,    τ = -(row of the spring in the inverse dynamics of the robot, spring and damper left out)

τ follows from the motion (y, ẏ, ÿ) of the links and, where the bodies between motors and springs have inertia, from
(δ, δ̇, δ̈) as well. The motor then moves as q_m = y - δ. The rest position q₀ of the spring is counted to the link: with
an unloaded spring motor and reference agree. Source: the inverse model of elastic joints of Khalil, section 6, for a
motion of the links.

The solution is the sum of two parts. Where τ is the polynomial p through its values at NODES around a time, one part is
the polynomial σ with d σ̇ + k σ = p, which is an exact solution. The other part, c exp(-k t / d), is the memory of the
damper: it keeps δ continuous where the reference is not smooth or is replaced. It is the only state, and is forgotten
after some multiples of d / k. Where d / k is less than NODE_SPACING this part is left out: efforts at some kHz cannot
follow it. Where τ depends on δ, its rate would differ from k / d; such dampers with d / k above MAX_TIME_CONSTANT are
refused.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.reference import ReferencePoint
from robot_dynamics.errors import RobotDynamicsError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.control.reference import Reference
    from robot_dynamics.control.series_elastic_actuators import SeriesElasticActuators

NODE_SPACING = 2e-3
"""Time [s] between two nodes. A jump of the derivative of τ is spread over all nodes."""
NODES = np.arange(-3, 4)
"""Nodes of the polynomial around a time, in NODE_SPACING."""
SOLUTION_STEP = 3 * NODE_SPACING
"""Time [s] for which a polynomial is used."""
MEMORY_TIME_CONSTANTS = 30.0
"""Multiples of d / k after which an initial deflection is forgotten."""
MAX_HISTORY_STEPS = 250
"""Steps through the past of a reference that begins in the midst of its motion."""
NEGLIGIBLE_DEFLECTION = 1e-12
"""Relative deflection that is neglected."""
MAX_ITERATIONS = 10
"""Iterations over the nodes where τ depends on the deflections."""
CONVERGENCE_TOLERANCE = 1e-8
"""Relative change of the deflections in an iteration at which it ends. The next one would change less."""
DIVERGENCE_THRESHOLD = 1e-2
"""Relative change in the last iteration from which there is no solution."""

CENTRE = len(NODES) // 2
NODE_TIMES = NODES * NODE_SPACING
POWERS = np.arange(len(NODES))


def _derivative_matrix(order: int) -> Array:
    """(nodes, powers) from the coefficients of a polynomial to its derivatives of an order at the nodes."""
    factors = np.array([np.prod(np.arange(power, power - order, -1), initial=1.0) for power in POWERS])
    powers = NODES[:, None] ** np.maximum(POWERS - order, 0.0)
    matrix: Array = np.where(order <= POWERS, powers, 0.0) * factors / NODE_SPACING**order
    return matrix


DERIVATIVES = np.stack([_derivative_matrix(order) for order in range(3)])
"""(3, nodes, powers) from coefficients to values, first and second derivatives at the nodes."""


class DeflectionSolver:
    """Deflections of springs while their links follow a reference.

    Parameters
    ----------
    actuators : SeriesElasticActuators
    place_links : callable
        From samples (nodes, 3, joints) of the reference of the links to program positions (nodes, m) with springs at
        rest.
    compute_loads : callable
        From such positions, the samples, and deflections with their derivatives (nodes, 3, springs), to -τ
        (nodes, springs).
    joint_count : int
        Number of joints of the reference.

    Attributes
    ----------
    motion : ndarray, shape (3, springs)
        Positions, velocities and accelerations of the springs, at the time of the last reference.
    """

    def __init__(
        self,
        actuators: SeriesElasticActuators,
        place_links: Callable[[Array], Array],
        compute_loads: Callable[[Array, Array, Array], Array],
        joint_count: int,
    ) -> None:
        spring_count = len(actuators.springs)
        self._actuators = actuators
        self._place_links = place_links
        self._compute_loads = compute_loads
        self._samples = np.zeros((len(NODES), 3, joint_count))
        self._node_deflections = np.zeros((len(NODES), 3, spring_count))
        self._loads = np.zeros((len(NODES), spring_count))
        time_constants = actuators.damping / actuators.stiffness
        self._coefficient_matrix = _coefficient_matrix(actuators.stiffness, time_constants)
        has_memory = actuators.is_decoupled & (time_constants > NODE_SPACING)
        self._time_constants = np.where(has_memory, time_constants, 0.0)
        self._time: float | None = None
        self._deflection = np.zeros(spring_count)
        self.motion = np.zeros((3, spring_count))

    def continue_from(self, before: DeflectionSolver) -> None:
        """Take over the deflections of the solver that was in use before, if it has the same springs."""
        if len(before._deflection) == len(self._deflection):
            self._time = before._time
            self._deflection[:] = before._deflection

    def compute_motor_reference(self, source: Reference, time: float, out: Array) -> None:
        """Write the reference of the motors (3, joints) at a time [s], for a reference `source` of the links.

        Raises RobotDynamicsError where there is no such motion.
        """
        self._advance_to(source, time)
        self._solve(source, time)
        self.motion[:] = self._node_deflections[CENTRE]
        self._time = time
        self._deflection[:] = self.motion[0]
        np.copyto(out, self._samples[CENTRE])
        out[:, self._actuators.motors] -= self.motion
        self.motion[0] += self._actuators.rest

    def _advance_to(self, source: Reference, time: float) -> None:
        """Solve the equation until less than SOLUTION_STEP before a time, where dampers have a memory."""
        reach = min(MEMORY_TIME_CONSTANTS * self._time_constants.max(), MAX_HISTORY_STEPS * SOLUTION_STEP)
        if not reach:
            self._time = None
            return
        if self._time is None or not time - reach <= self._time <= time:
            earliest = time - reach
            start = min(max(getattr(source, "start", earliest), earliest), time)
            self._time = None
            self._solve(source, start)
            self._time = start
            self._deflection[:] = -self._loads[CENTRE] / self._actuators.stiffness
        while time - self._time > SOLUTION_STEP:
            now = self._time + SOLUTION_STEP
            self._solve(source, now)
            self._time = now
            self._deflection[:] = self._node_deflections[CENTRE, 0]

    def _solve(self, source: Reference, time: float) -> None:
        """Compute deflections and their derivatives at the nodes around a time from the previous deflections.

        Raises RobotDynamicsError where the iteration, each time with the latest loads, does not converge.
        """
        self._sample_nodes(source, time)
        is_decoupled = self._actuators.is_decoupled
        positions = self._place_links(self._samples)
        node_deflections = self._node_deflections
        node_deflections[:] = 0.0
        for _ in range(1 if is_decoupled else MAX_ITERATIONS):
            previous = node_deflections[:, 0].copy()
            self._loads = self._compute_loads(positions, self._samples, node_deflections)
            coefficients = self._polynomial_coefficients(self._loads)
            node_deflections[:] = np.swapaxes(DERIVATIVES @ coefficients, 0, 1)
            node_deflections += self._memory_part(coefficients, time)
            change = np.abs(node_deflections[:, 0] - previous).max()
            largest = np.abs(node_deflections[:, 0]).max()
            if change <= CONVERGENCE_TOLERANCE * largest:
                return
        if not (is_decoupled or change <= DIVERGENCE_THRESHOLD * largest):
            stiffness = ", ".join(f"{k:g}" for k in self._actuators.stiffness)
            raise RobotDynamicsError(
                "the deflections of the elastic gears cannot be computed: the springs are too soft (stiffness "
                f"{stiffness}) for the bodies between them and the motors. Leave their motors out of the joints that "
                "get efforts, or use a mode without a reference"
            )

    def _polynomial_coefficients(self, loads: Array) -> Array:
        """Coefficients (powers, springs) of σ in powers of (t - time) / NODE_SPACING, for loads (nodes, springs)."""
        # differences from the centre make rates at rest exactly zero, because friction depends on their sign
        differences = (loads[CENTRE] - loads).T[..., None]
        coefficients: Array = (self._coefficient_matrix @ differences)[..., 0].T
        coefficients[0] -= loads[CENTRE] / self._actuators.stiffness
        return coefficients

    def _memory_part(self, coefficients: Array, time: float) -> Array | float:
        """Decaying part (nodes, 3, springs) of δ at the nodes around a time, and its derivatives."""
        if self._time is None:
            return 0.0
        elapsed = self._time - time
        time_constants = self._time_constants
        with np.errstate(all="ignore"):
            deviation = self._deflection - (elapsed / NODE_SPACING) ** POWERS @ coefficients
            remainder = deviation * np.exp(elapsed / time_constants)
            is_relevant = np.abs(remainder) > NEGLIGIBLE_DEFLECTION * np.abs(coefficients[0])
            remainder[~((time_constants > 0) & is_relevant)] = 0.0
            rates = np.where(remainder != 0.0, -1.0 / time_constants, 0.0)
        part: Array = remainder * np.exp(rates * NODE_TIMES[:, None, None]) * rates ** np.arange(3)[:, None]
        return part

    def _sample_nodes(self, source: Reference, time: float) -> None:
        """Write the samples of the reference at the nodes around a time."""
        if not isinstance(source, ReferencePoint):
            for node_time, sample in zip(NODE_TIMES, self._samples, strict=True):
                source.sample(time + node_time, sample)
            return
        centre = np.empty_like(self._samples[CENTRE])  # earlier points are unknown: extrapolate this one to both sides
        source.sample(time, centre)
        t = NODE_TIMES[:, None]
        self._samples[:, 0] = centre[0] + t * centre[1] + 0.5 * t**2 * centre[2]
        self._samples[:, 1] = centre[1] + t * centre[2]
        self._samples[:, 2] = centre[2]


def _coefficient_matrix(stiffness: Array, time_constants: Array) -> Array:
    """(springs, powers, nodes) from the differences of τ from its centre node to the coefficients of σ."""
    interpolation = np.linalg.inv(NODES[:, None] ** POWERS.astype(np.float64))
    derivative = np.diag(POWERS[1:], 1)
    equation = np.eye(len(POWERS)) + time_constants[:, None, None] / NODE_SPACING * derivative
    matrix: Array = np.linalg.inv(equation) @ interpolation / stiffness[:, None, None]
    return matrix
