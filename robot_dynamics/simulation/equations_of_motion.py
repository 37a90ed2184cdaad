"""Equations of motion of a simulated robot, as the derivative of one vector.

The vector is y = [chart of the pose (6,); x; rates (6 + n,)]. x are the positions of the independent joints, or of all
joints where the robot has loops. The chart begins where the step begins, so that rotations stay rotations.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.simulation.base_motion import chart_motion
from robot_dynamics.simulation.branch import TIGHT_CLOSURE_TOLERANCE, find_neighbours, interpolate
from robot_dynamics.simulation.constrained_motion import SINGULAR_QUALITY

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.attitude_integration import LocalAttitudeChart
    from robot_dynamics.simulation.constrained_motion import ConstrainedMotion
    from robot_dynamics.simulation.ground_contact import GroundContact
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.rate_constraints import RateConstraints
    from robot_dynamics.simulation.step_inputs import Conditions, StepInputs


class EquationsOfMotion:
    """The derivative of y for a Plant.

    Parameters
    ----------
    plant : Plant
    constraints : RateConstraints
    contact : GroundContact or None
    drive_time : float
        Time [s] in which a driven base comes 63 % nearer to its reference twist.

    Attributes
    ----------
    x, rates : slice
        The entries of y.
    """

    def __init__(
        self, plant: Plant, constraints: RateConstraints, contact: GroundContact | None, drive_time: float
    ) -> None:
        self._plant = plant
        self._constraints = constraints
        self._contact = contact
        self._drive_time = drive_time
        self._robot = plant.dynamics.robot
        position_count = plant.size if plant.loops is None else len(self._robot.joints)
        self.x = slice(6, 6 + position_count)
        self.rates = slice(6 + position_count, None)

    def joint_positions(self, y: Array, local_charts: Sequence[LocalAttitudeChart]) -> Array:
        """Positions as the programs take them."""
        loops = self._plant.loops
        return y[self.x] if loops is None else loops.attitudes.positions(y[self.x], local_charts)

    def with_independent_positions(self, q: Array, positions: Array) -> Array:
        """q as the programs take it, with the joints of Dynamics.joint_names at positions (n,)."""
        if self._plant.loops is None:
            return positions
        q = q.copy()
        q[[*self._plant.loops.default_independent]] = positions
        return q

    def derivative(self, time: float, y: Array, conditions: Conditions) -> Array:
        """dy/dt at a time [s]."""
        inputs = conditions.inputs
        rates = y[self.rates]
        q = self.joint_positions(y, conditions.local_charts)
        if inputs.motion is not None:
            positions, velocities, _ = inputs.motion(time)
            q = self.with_independent_positions(q, positions)
            rates = np.concatenate([rates[:6], velocities])
        slope = np.zeros(len(y))
        R, P = conditions.pose[:3, :3], conditions.pose[:3, 3]
        if self._robot.moving_base:
            R, P, slope[:6] = chart_motion(R, P, y[:6], rates[:6])

        def model(q: Array) -> tuple[Array, Array]:
            return self._velocities_and_accelerations(q, rates, time, R, P, inputs)

        loops = self._plant.loops
        if loops is None:
            slope[self.x], slope[self.rates] = model(q)
            return slope
        chart_rates, slope[self.rates] = self._evaluate_near_constraints(loops, model, q, conditions)
        slope[self.x] = loops.attitudes.variable_rates(y[self.x], q, chart_rates, conditions.local_charts)
        return slope

    def _evaluate_near_constraints(
        self,
        loops: ConstrainedMotion,
        model: Callable[[Array], tuple[Array, Array]],
        q: Array,
        conditions: Conditions,
    ) -> Sequence[Array]:
        """model(q) of a robot with loops, at integrated positions q (all joints,).

        Near a singular position the loops are closed first; at it the values are interpolated along the branch.
        """
        coordinates, direction = conditions.coordinates, conditions.direction
        if coordinates is None or direction is None:
            return model(q)
        if loops.quality(coordinates, q) > SINGULAR_QUALITY:
            return model(loops.close_loops(coordinates, q, TIGHT_CLOSURE_TOLERANCE)[0])
        return interpolate(model, find_neighbours(loops, coordinates, q, direction))

    def _velocities_and_accelerations(
        self, q: Array, rates: Array, time: float, R: Array, P: Array, inputs: StepInputs
    ) -> tuple[Array, Array]:
        """Velocities of q and ν̇ (6 + n,), with the base at the orientation R and position P in the world."""
        wrenches = inputs.wrenches
        if self._contact is not None:
            wrenches = self._contact.add_wrenches(q, rates, R, P, wrenches)
        velocities, accelerations = self._plant.unconstrained_accelerations(
            q, rates, self._robot.gravity @ R, inputs.efforts, wrenches
        )
        base_acceleration = None if inputs.drive is None else (inputs.drive - rates[:6]) / self._drive_time
        joint_accelerations = None if inputs.motion is None else inputs.motion(time)[2]
        return velocities, self._constraints.constrain_accelerations(
            q, rates, accelerations, base_acceleration, joint_accelerations
        )
