"""Integration of the equations of motion over one step, in as many parts as their error requires."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.errors import SimulationError
from robot_dynamics.simulation.branch import close_on_branch
from robot_dynamics.simulation.runge_kutta import increment
from robot_dynamics.simulation.step_inputs import Conditions
from robot_dynamics.simulation.step_limits import MIN_RATE_SCALE, NEAR_SINGULAR_QUALITY, TOLERANCE

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.attitude_integration import LocalAttitudeChart
    from robot_dynamics.simulation.constrained_motion import ConstrainedMotion, LoopCoordinates
    from robot_dynamics.simulation.equations_of_motion import EquationsOfMotion
    from robot_dynamics.simulation.ground_contact import GroundContact
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.simulation_state import SimulationState
    from robot_dynamics.simulation.step_inputs import StepInputs

logger = logging.getLogger(__name__)

CHART_ORIGIN = np.zeros(6)
MAX_SUBSTEPS = 256
"""Number of parts into which a step may be divided."""
ROUNDING_SHARE = 1e-9
"""Share of a step that is rounding."""
MAX_CONTACT_SUBSTEPS = 65536
"""Number of parts into which a step may be divided where a point meets the ground."""
WARNING_SUBSTEPS = 8
"""Number of parts of a step from which a warning is logged."""
STEP_GROWTH_THRESHOLD = 1e-3
"""Error, relative to the tolerance, below which the next part is twice as long."""
MAX_RELATIVE_ERROR = 1e-2
"""Relative error of the shortest parts from which the step fails."""


class StepResult(NamedTuple):
    """End of a step.

    Attributes
    ----------
    chart : ndarray, shape (6,)
        Rotation vector [rad] and displacement [m] of the base since the step began, in its axes of that time.
    q : ndarray
        Positions as the programs take them.
    rates : ndarray, shape (6 + n,)
    coordinates : LoopCoordinates or None
        The coordinates of the rates.
    """

    chart: Array
    q: Array
    rates: Array
    coordinates: LoopCoordinates | None


class Substep(NamedTuple):
    """A part of a step: y at its end, the relative error of its rates, its length [s]."""

    y: Array
    error: float
    length: float


class StepIntegrator:
    """Integrates the equations of motion of a Plant.

    Parameters
    ----------
    plant : Plant
    equations : EquationsOfMotion
    contact : GroundContact or None
    step : float
        Length of a step [s].
    """

    def __init__(self, plant: Plant, equations: EquationsOfMotion, contact: GroundContact | None, step: float) -> None:
        self._plant = plant
        self._equations = equations
        self._contact = contact
        self._step = step
        self._has_warned = False

    def accelerations(
        self, state: SimulationState, q: Array, rates: Array, coordinates: LoopCoordinates | None, inputs: StepInputs
    ) -> Array:
        """ν̇ (6 + n,) at a state, for positions q and rates (6 + n,); the arguments are those of `step`."""
        y = np.concatenate([CHART_ORIGIN, q, rates])
        direction = _direction_near_singular(coordinates, state.joint_velocities)
        conditions = Conditions(state.pose, inputs, coordinates, direction)
        self._begin_contact()
        return self._equations.derivative(state.time, y, conditions)[self._equations.rates]

    def step(
        self, state: SimulationState, q: Array, rates: Array, coordinates: LoopCoordinates | None, inputs: StepInputs
    ) -> StepResult:
        """Integrate one step.

        Parameters
        ----------
        state : SimulationState
            The state where the step begins: its time, pose and velocities.
        q : ndarray
            Positions as the programs take them.
        rates : ndarray, shape (6 + n,)
            Twist of the base and velocities of the independent joints.
        coordinates : LoopCoordinates or None
            Of a robot with loops: the coordinates of the rates.
        inputs : StepInputs

        Returns
        -------
        StepResult

        Raises
        ------
        SimulationError
            The error is too large even in the shortest parts.
        SingularModelError
            The model has no accelerations here, or the loops have no branch to follow.
        """
        loops, equations = self._plant.loops, self._equations
        y = np.concatenate([CHART_ORIGIN, q, rates])
        velocities = state.joint_velocities
        elapsed, length, shortest = 0.0, self._step, self._step
        while elapsed < self._step:
            length = min(length, self._step - elapsed)
            if loops is not None and coordinates is not None:
                least = self._step / MAX_SUBSTEPS
                length = loops.limit_substep(length, least, coordinates, y[equations.x], velocities)
            y, error, length = self._integrate_substep(state, elapsed, length, y, inputs, coordinates, velocities)
            shortest = min(shortest, length)
            is_last = elapsed + length >= (1 - ROUNDING_SHARE) * self._step
            elapsed = self._step if is_last else elapsed + length
            if loops is not None and coordinates is not None:
                time = state.time + elapsed
                y, coordinates, velocities = self._close_loops(loops, y, time, inputs, coordinates, velocities)
            if error < STEP_GROWTH_THRESHOLD * TOLERANCE:
                length *= 2
        if inputs.motion is not None and loops is None:
            y[equations.x] = inputs.motion(state.time + self._step)[0]
        self._warn_of_substeps(shortest)
        return StepResult(y[:6], y[equations.x], y[equations.rates], coordinates)

    def _integrate_substep(
        self,
        state: SimulationState,
        elapsed: float,
        length: float,
        y: Array,
        inputs: StepInputs,
        coordinates: LoopCoordinates | None,
        velocities: Array,
    ) -> Substep:
        """The part of a step that begins `elapsed` [s] after the state, at most as long as `length` [s].

        velocities: (all joints,) where it begins. Raises as `step`.
        """
        loops, equations = self._plant.loops, self._equations
        local_charts: Sequence[LocalAttitudeChart] = ()
        if loops is not None:
            local_charts = loops.attitudes.local_charts(y[equations.x])
            x = loops.attitudes.variables(y[equations.x], local_charts)
            y = np.concatenate([y[:6], x, y[equations.rates]])
        direction = _direction_near_singular(coordinates, velocities)
        conditions = Conditions(state.pose, inputs, coordinates, direction, local_charts)

        def derivative(time: float, y: Array) -> Array:
            return equations.derivative(time, y, conditions)

        while True:
            self._begin_contact()
            change, y_error = increment(derivative, state.time + elapsed, y, length)
            rates_after = y[equations.rates] + change[equations.rates]
            error = self._relative_error(y_error[equations.rates], rates_after)
            is_divisible = length / 2 >= self._step / MAX_SUBSTEPS
            if error <= TOLERANCE or (error <= MAX_RELATIVE_ERROR and not is_divisible):
                if length < self._step / MAX_CONTACT_SUBSTEPS or not self._contact_changes():
                    end = y + change
                    if local_charts:
                        end[equations.x] = equations.joint_positions(end, local_charts)
                    return Substep(end, error, length)
            elif not is_divisible:
                self._raise_too_long(state, equations.joint_positions(y, local_charts), inputs, length)
            length /= 2

    def _raise_too_long(self, state: SimulationState, q: Array, inputs: StepInputs, length: float) -> None:
        """Raise SingularModelError where the model is singular at q, else SimulationError."""
        self._plant.raise_if_singular(q, np.concatenate([state.twist, state.velocities]), inputs.efforts)
        raise SimulationError(
            f"at {state.time:g} s the step is too long: the error is too large even in parts of {length:.3g} s, "
            f"1/{MAX_SUBSTEPS} of the step. Take a shorter step, or a model without such stiff springs, strong dampers "
            "or light links"
        )

    def _close_loops(
        self,
        loops: ConstrainedMotion,
        y: Array,
        time: float,
        inputs: StepInputs,
        coordinates: LoopCoordinates,
        velocities: Array,
    ) -> tuple[Array, LoopCoordinates, Array]:
        """y, coordinates and velocities (all joints,) after a part of a step, with the loops closed.

        Other coordinates are chosen where the present ones have become much worse.
        """
        q, rates = y[self._equations.x], y[self._equations.rates]
        if inputs.motion is not None:
            positions, joint_rates, _ = inputs.motion(time)
            q = self._equations.with_independent_positions(q, positions)
            rates = np.concatenate([rates[:6], joint_rates])
        closed, quality = close_on_branch(loops, coordinates, q, velocities)
        coordinates = coordinates._replace(quality=quality)
        chosen = coordinates if inputs.motion is not None else loops.choose_coordinates(coordinates, closed)
        if chosen.independent != coordinates.independent or quality < NEAR_SINGULAR_QUALITY:
            velocities = self._plant.velocities(coordinates, closed, rates, velocities)
            if chosen.independent != coordinates.independent:
                rates = np.concatenate([rates[:6], velocities[[*chosen.independent]]])
        self._plant.use_coordinates(chosen, velocities)
        return np.concatenate([y[:6], closed, rates]), chosen, velocities

    def _begin_contact(self) -> None:
        if self._contact is not None:
            self._contact.begin_substep()

    def _contact_changes(self) -> bool:
        return self._contact is not None and self._contact.changes_in_substep()

    def _relative_error(self, error: Array, rates: Array) -> float:
        """Largest error (6 + n,) relative to the largest of the rates (6 + n,), in units that count as radians."""
        units = self._plant.units
        ratio: float = np.abs(error / units).max(initial=0) / (MIN_RATE_SCALE + np.abs(rates / units).max(initial=0))
        return ratio

    def _warn_of_substeps(self, shortest: float) -> None:
        """Log a warning, once, where a step is divided into many parts."""
        if shortest < self._step / WARNING_SUBSTEPS and not self._has_warned:
            self._has_warned = True
            logger.warning(
                "%r: steps of %g s are too long for the fast motions of this robot; they are integrated in parts, the "
                "shortest of %.3g s",
                self._plant.dynamics.robot.name,
                self._step,
                shortest,
            )


def _direction_near_singular(coordinates: LoopCoordinates | None, velocities: Array) -> Array | None:
    """The velocities (all joints,) near a singular position of loops, None elsewhere."""
    is_near = coordinates is not None and coordinates.quality < NEAR_SINGULAR_QUALITY
    return velocities if is_near else None
