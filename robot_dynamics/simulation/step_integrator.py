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
from robot_dynamics.simulation.step_limits import MAX_SUBSTEPS, NEAR_SINGULAR_QUALITY
from robot_dynamics.simulation.step_parts import integrate_in_parts, relative_error

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.attitude_integration import LocalAttitudeChart
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.equations_of_motion import EquationsOfMotion
    from robot_dynamics.simulation.ground_contact import GroundContact
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.simulation_state import SimulationState
    from robot_dynamics.simulation.step_inputs import StepInputs

logger = logging.getLogger(__name__)

CHART_ORIGIN = np.zeros(6)
WARNING_SUBSTEPS = 8
"""Number of parts of a step from which a warning is logged."""


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
        if self._contact is not None:
            self._contact.begin_substep()
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
        equations = self._equations
        motion = _StepMotion(self._plant, equations, self._contact, self._step, state, inputs)
        y = np.concatenate([CHART_ORIGIN, q, rates])
        progress = Progress(coordinates, state.joint_velocities)
        y, progress, shortest, is_regular = integrate_in_parts(motion, y, progress, self._step)
        if not is_regular:
            self._raise_too_long(state, y[equations.x], inputs, self._step / MAX_SUBSTEPS)
        if inputs.motion is not None and self._plant.loops is None:
            y[equations.x] = inputs.motion(state.time + self._step)[0]
        self.warn_of_parts(shortest)
        return StepResult(y[:6], y[equations.x], y[equations.rates], progress.coordinates)

    def _raise_too_long(self, state: SimulationState, q: Array, inputs: StepInputs, length: float) -> None:
        """Raise SingularModelError where the model is singular at q, else SimulationError."""
        self._plant.raise_if_singular(q, np.concatenate([state.twist, state.velocities]), inputs.efforts)
        raise SimulationError(
            f"at {state.time:g} s the step is too long: the error is too large even in parts of {length:.3g} s, "
            f"1/{MAX_SUBSTEPS} of the step. Take a shorter step, or a model without such stiff springs, strong dampers "
            "or light links"
        )

    def warn_of_parts(self, shortest: float) -> None:
        """Log a warning, once, where a step is divided into many parts. shortest: length [s] of the shortest one."""
        if shortest < self._step / WARNING_SUBSTEPS and not self._has_warned:
            self._has_warned = True
            logger.warning(
                "%r: steps of %g s are too long for the fast motions of this robot; they are integrated in parts, the "
                "shortest of %.3g s",
                self._plant.dynamics.robot.name,
                self._step,
                shortest,
            )


class Progress(NamedTuple):
    """Coordinates of a robot with loops, and velocities (all joints,) of the motion that led here."""

    coordinates: LoopCoordinates | None
    velocities: Array


class _StepMotion:
    """The motion in one step, as integrate_in_parts takes it."""

    def __init__(
        self,
        plant: Plant,
        equations: EquationsOfMotion,
        contact: GroundContact | None,
        step: float,
        state: SimulationState,
        inputs: StepInputs,
    ) -> None:
        self._plant = plant
        self._equations = equations
        self._contact = contact
        self._step = step
        self._state = state
        self._inputs = inputs

    def limit(self, length: float, y: Array, progress: Progress) -> float:
        """The length [s] of a part in which no joint of the loops travels too far."""
        loops, coordinates = self._plant.loops, progress.coordinates
        if loops is None or coordinates is None:
            return length
        return loops.limit_substep(length, self._step, coordinates, y[self._equations.x], progress.velocities)

    def attempt(self, elapsed: float, length: float, y: Array, progress: Progress) -> tuple[Array, float, bool]:
        """y at the end of a part, the relative error of its rates, and whether its stages resolve the contacts."""
        loops, equations = self._plant.loops, self._equations
        local_charts: Sequence[LocalAttitudeChart] = ()
        if loops is not None:
            local_charts = loops.attitudes.local_charts(y[equations.x])
            x = loops.attitudes.variables(y[equations.x], local_charts)
            y = np.concatenate([y[:6], x, y[equations.rates]])
        direction = _direction_near_singular(progress.coordinates, progress.velocities)
        conditions = Conditions(self._state.pose, self._inputs, progress.coordinates, direction, local_charts)

        def derivative(time: float, y: Array) -> Array:
            return equations.derivative(time, y, conditions)

        if self._contact is not None:
            self._contact.begin_substep()
        change, y_error = increment(derivative, self._state.time + elapsed, y, length)
        end = y + change
        error = relative_error(y_error[equations.rates], end[equations.rates], self._plant.units, end[:6])
        if local_charts:
            end[equations.x] = equations.joint_positions(end, local_charts)
        return end, error, self._contact is None or not self._contact.changes_in_substep()

    def finish(self, elapsed: float, y: Array, progress: Progress) -> tuple[Array, Progress, bool]:
        """y and progress after a part, with the loops closed.

        Other coordinates are chosen where the present ones have become much worse.
        """
        loops, (coordinates, velocities) = self._plant.loops, progress
        if loops is None or coordinates is None:
            return y, progress, True
        motion = self._inputs.motion
        q, rates = y[self._equations.x], y[self._equations.rates]
        if motion is not None:
            positions, joint_rates, _ = motion(self._state.time + elapsed)
            q = self._equations.with_independent_positions(q, positions)
            rates = np.concatenate([rates[:6], joint_rates])
        closed, quality = close_on_branch(loops, coordinates, q, velocities)
        coordinates = coordinates._replace(quality=quality)
        chosen = coordinates if motion is not None else loops.choose_coordinates(coordinates, closed)
        if chosen.independent != coordinates.independent or quality < NEAR_SINGULAR_QUALITY:
            velocities = self._plant.velocities(coordinates, closed, rates, velocities)
            if chosen.independent != coordinates.independent:
                rates = np.concatenate([rates[:6], velocities[[*chosen.independent]]])
        self._plant.use_coordinates(chosen, velocities)
        return np.concatenate([y[:6], closed, rates]), Progress(chosen, velocities), True


def _direction_near_singular(coordinates: LoopCoordinates | None, velocities: Array) -> Array | None:
    """The velocities (all joints,) near a singular position of loops, None elsewhere."""
    is_near = coordinates is not None and coordinates.quality < NEAR_SINGULAR_QUALITY
    return velocities if is_near else None
