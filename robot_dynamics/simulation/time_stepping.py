"""One step of a simulation: integration, then corrections that conserve momentum and keep constraints.

All variables are integrated together. Afterwards a free robot gets the base twist that conserves its momentum, joint
friction acts as impulses, and rates that the wheels forbid are removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.simulation.base_motion import displaced
from robot_dynamics.simulation.friction_steps import FrictionSteps
from robot_dynamics.simulation.momentum import Momentum, after_gravity, momentum, twist_from_momentum
from robot_dynamics.simulation.simulation_state import SimulationState
from robot_dynamics.simulation.step_programs import ProgramState

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.constrained_motion import ConstrainedMotion, LoopCoordinates
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.rate_constraints import BaseType, RateConstraints
    from robot_dynamics.simulation.step_inputs import StepInputs
    from robot_dynamics.simulation.step_integrator import StepIntegrator
    from robot_dynamics.simulation.step_programs import RecordedRun, Run, StepPrograms

NO_TWIST = np.zeros(6)
NOTHING = np.zeros(0)


class TimeStepping:
    """Makes the states of a simulation.

    Parameters
    ----------
    plant : Plant
    base : {"fixed", "free", "planar"}
    constraints : RateConstraints
    friction : ImpulsiveFriction
    integrator : StepIntegrator
    programs : StepPrograms
    step : float
        Length of a step [s].

    Attributes
    ----------
    python_steps : int
        Number of steps that machine code did not take.
    """

    def __init__(
        self,
        plant: Plant,
        base: BaseType,
        constraints: RateConstraints,
        friction: ImpulsiveFriction,
        integrator: StepIntegrator,
        programs: StepPrograms,
        step: float,
    ) -> None:
        self._plant = plant
        self._base = base
        self._constraints = constraints
        self._friction = FrictionSteps(plant, constraints, friction, integrator, step)
        self._integrator = integrator
        self._step = step
        self.python_steps = 0
        self._programs: StepPrograms | None = programs
        dynamics = plant.dynamics
        self._joint_indices = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
        self._momentum_state: SimulationState | None = None
        self._conserved_momentum: Momentum | None = None  # of the free robot in that state

    def resting_state(self) -> SimulationState:
        """The state of rest at the initial joint positions of the description, the base at the origin of the world."""
        q = self._plant.dynamics.initial_joint_positions
        return SimulationState(
            steps=0,
            time=0.0,
            pose=np.eye(4),
            twist=np.zeros(6),
            positions=q[self._joint_indices],
            velocities=np.zeros(self._plant.size),
            joint_positions=q.copy(),
            joint_velocities=np.zeros(len(q)),
            coordinates=self._initial_coordinates(q),
        )

    def initial_state(
        self, pose: Array, joint_positions: Array, rates: Array, has_base_motion: bool
    ) -> SimulationState:
        """The state at time 0.

        joint_positions: (all joints,); rates: (6 + n,) of the base and of Dynamics.joint_names; has_base_motion:
        whether the motion of the base is an input, which the wheels follow.
        """
        coordinates = self._initial_coordinates(joint_positions)
        q = self.program_positions(joint_positions)
        rates = self._constraints.initial_rates(q, rates, has_base_motion)
        return self._build_state(0, 0.0, pose, q, rates, coordinates)

    def state_from(self, previous: SimulationState) -> SimulationState:
        """The state at time 0 that continues a state of another simulation with the same joints and type of base."""
        coordinates = previous.coordinates
        q = self.program_positions(previous.joint_positions)
        if self._plant.loops is not None and coordinates is not None:
            self._plant.use_coordinates(coordinates, previous.joint_velocities)
            q, quality = self._plant.loops.close_loops(coordinates, q)
            coordinates = coordinates._replace(quality=quality)
        rates = self._constraints.initial_rates(q, previous.rates, has_base_motion=True)
        return self._build_state(0, 0.0, previous.pose, q, rates, coordinates, previous.joint_velocities)

    def advance(self, state: SimulationState, inputs: StepInputs, steps: int) -> SimulationState:
        """The state after some steps: as many as possible in machine code, at least one. Raises as `step`."""
        if self._programs is not None and inputs.motion is None:
            coordinates = self._use_coordinates(state, inputs)
            run = self._programs.advance(steps, self._program_state(state, coordinates, inputs), inputs)
            if run is not None:
                self._integrator.warn_of_parts(run.shortest)
                return self._state_after(state, run, inputs)
        self.python_steps += 1
        return self.step(state, inputs)

    def _program_state(
        self, state: SimulationState, coordinates: LoopCoordinates | None, inputs: StepInputs
    ) -> ProgramState:
        """A state as programs take it."""
        q = self.program_positions(state.joint_positions)
        rates = state.rates
        if self._base == "fixed":
            return ProgramState(state.pose, q, rates[6:], coordinates, NOTHING)
        conserved = NOTHING
        if self._base == "free":
            conserved = np.concatenate(self._momentum_before(state, rates)) if inputs.is_undisturbed else NO_TWIST
        return ProgramState(state.pose, q, rates, coordinates, conserved)

    def prepare(self, state: SimulationState) -> None:
        """Compile the programs for the coordinates of a state, so that no step waits for them."""
        if self._programs is not None:
            independent = None if state.coordinates is None else state.coordinates.independent
            for is_driven in (False, True) if self._base == "planar" else (False,):
                self._programs.program("advance", independent, is_driven)

    def vary_inertias(self, links: tuple[int, ...]) -> None:
        """Let `record` take inertias of some links (numbers); no other method takes steps in machine code then."""
        if self._programs is not None:
            self._programs = self._programs.with_varied_links(links)

    @property
    def takes_wrenches(self) -> bool:
        """Whether the programs take external wrenches, as they do from the first step with wrenches on."""
        return bool(self._plant.wrench_links)

    def is_recorded(self, coordinates: LoopCoordinates | None) -> bool:
        """Whether `record` takes states with these coordinates."""
        loops = self._plant.loops
        independent = None if coordinates is None else coordinates.independent
        is_default = loops is None or independent == loops.default_independent
        return is_default and self._programs is not None and self._programs.program("record", independent) is not None

    def record(
        self,
        q: Array,
        rates: Array,
        efforts: Array,
        coordinates: Sequence[LoopCoordinates | None],
        threads: int,
        inertias: Array | None = None,
    ) -> RecordedRun:
        """Steps of M simulations in machine code, each with its efforts.

        Parameters
        ----------
        q : ndarray, shape (M, ...)
            Positions as the programs of the plant take them.
        rates : ndarray, shape (M, n)
        efforts : ndarray, shape (M, K, n)
            K is at most RECORDED_STEPS.
        coordinates : sequence of LoopCoordinates or None
            Those that `is_recorded` allows.
        threads : int
        inertias : ndarray, shape (M, 10 k), optional
            Of the links of `vary_inertias`.

        Returns
        -------
        RecordedRun
        """
        assert self._programs is not None
        if self._plant.loops is not None:
            efforts = self._plant.dynamics.embed_efforts(efforts)
        run = self._programs.record(q, rates, efforts, coordinates, threads, inertias)
        self._integrator.warn_of_parts(run.shortest)
        return run

    @property
    def loops(self) -> ConstrainedMotion | None:
        """Motion on the constraints of the loops; None without loops."""
        return self._plant.loops

    @property
    def joint_columns(self) -> list[int] | slice:
        """Columns of Dynamics.joint_names in positions as the programs take them."""
        return slice(None) if self._plant.loops is None else self._joint_indices

    def program_positions(self, joint_positions: Array) -> Array:
        """Positions as the programs take them, from positions (all joints,)."""
        return self._plant.program_positions(joint_positions)

    def state_at(self, steps: int, q: Array, rates: Array, coordinates: LoopCoordinates | None) -> SimulationState:
        """The state of a robot on a fixed base at positions q, as the programs take them, and rates (n,)."""
        if coordinates is not None:
            self._plant.use_coordinates(coordinates, np.zeros(len(q)))
        rates = np.concatenate([NO_TWIST, rates])
        return self._build_state(steps, steps * self._step, np.eye(4), np.array(q), rates, coordinates)

    def _state_after(self, state: SimulationState, run: Run, inputs: StepInputs) -> SimulationState:
        """The state after steps of machine code."""
        steps = state.steps + run.steps
        end = run.state
        pose, rates = state.pose, end.rates
        if self._base == "fixed":
            rates = np.concatenate([NO_TWIST, rates])
        else:
            pose = end.pose
        direction = state.joint_velocities
        successor = self._build_state(steps, steps * self._step, pose, end.q, rates, end.coordinates, direction)
        if inputs.is_undisturbed:
            self._keep_momentum(successor, Momentum(end.momentum[:3], end.momentum[3:]))
        return successor

    def _keep_momentum(self, state: SimulationState, conserved: Momentum) -> None:
        """Let the next step from a state begin with this momentum."""
        self._momentum_state = state
        self._conserved_momentum = conserved

    def step(self, state: SimulationState, inputs: StepInputs) -> SimulationState:
        """The state one step later.

        Raises
        ------
        SimulationError
            The step is too long for the fast motions of the robot.
        SingularModelError
            The model has no accelerations, or the loops have no branch to follow.
        """
        coordinates = self._use_coordinates(state, inputs)
        initial_rates = self._rates_at(state, coordinates, inputs)
        conserved = self._momentum_before(state, initial_rates) if inputs.is_undisturbed else None
        initial_q = self.program_positions(state.joint_positions)
        inputs, friction = self._friction.begin(state, initial_q, initial_rates, coordinates, inputs)
        chart, q, rates, coordinates = self._integrator.step(state, initial_q, initial_rates, coordinates, inputs)
        time = (state.steps + 1) * self._step
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = displaced(state.pose[:3, :3], state.pose[:3, 3], chart)
        if inputs.motion is not None:
            rates[6:] = inputs.motion(time)[1]
        if conserved is not None:
            A = self._plant.inertia_matrix(q)
            conserved = after_gravity(conserved, A[0, 0], self._plant.dynamics.robot.gravity, self._step)
            rates[:6] = twist_from_momentum(conserved, A, pose[:3, :3], rates)
        rates = self._friction.end(q, rates, inputs, friction)
        rates = self._constraints.project_onto_constraints(q, rates, keep_joint_rates=inputs.motion is not None)
        successor = self._build_state(state.steps + 1, time, pose, q, rates, coordinates, state.joint_velocities)
        if conserved is not None:
            self._keep_momentum(successor, conserved)
        return successor

    def rate_derivatives(self, state: SimulationState, inputs: StepInputs) -> tuple[Array, Array]:
        """Derivative of the twist (6,) and accelerations (n,) of Dynamics.joint_names, without dry friction."""
        q = self.program_positions(state.joint_positions)
        coordinates = self._use_coordinates(state, inputs)
        derivative = self._integrator.accelerations(state, q, state.rates, coordinates, inputs)
        if self._plant.loops is None:
            return derivative[:6], derivative[6:]
        return derivative[:6], self._plant.joint_accelerations(q, state.joint_velocities, derivative)

    def inertia_matrix(self, state: SimulationState) -> Array:
        """A (6 + n, 6 + n), or (n, n) on a fixed base, in the coordinates of the rates of a state."""
        self._use_state_coordinates(state)
        return self._plant.inertia_matrix(self.program_positions(state.joint_positions))

    def rolling_residual(self, state: SimulationState) -> Array:
        """Velocities (m,) [m/s, rad/s] of a state that plane and wheels forbid."""
        self._use_state_coordinates(state)
        return self._constraints.residual(self.program_positions(state.joint_positions), state.rates)

    def _build_state(
        self,
        steps: int,
        time: float,
        pose: Array,
        q: Array,
        rates: Array,
        coordinates: LoopCoordinates | None,
        direction: Array | None = None,
    ) -> SimulationState:
        """The state at positions q (as the programs take them) and rates (6 + n,).

        direction: velocities (all joints,) of the motion that led here; None at the start.
        """
        velocities = self._joint_velocities(q, rates, direction, coordinates)
        joint_positions = q if self._plant.takes_all_joints else self._plant.dynamics.expand_positions(q)
        return SimulationState(
            steps=steps,
            time=time,
            pose=pose,
            twist=rates[:6].copy(),
            positions=np.array(joint_positions[self._joint_indices]),
            velocities=velocities[self._joint_indices].copy(),
            joint_positions=np.array(joint_positions),
            joint_velocities=velocities,
            coordinates=coordinates,
        )

    def _joint_velocities(
        self, q: Array, rates: Array, direction: Array | None, coordinates: LoopCoordinates | None
    ) -> Array:
        """Velocities (all joints,) at rates (6 + n,)."""
        if coordinates is not None and direction is None:
            return self._plant.initial_velocities(coordinates, q, rates)
        if coordinates is not None and direction is not None:
            return self._plant.velocities(coordinates, q, rates, direction)
        return rates[6:].copy() if self._plant.takes_all_joints else self._plant.velocity_matrix(q) @ rates[6:]

    def _initial_coordinates(self, q: Array) -> LoopCoordinates | None:
        """Coordinates of Dynamics.joint_names at positions (all joints,), used from now on; None without loops."""
        if self._plant.loops is None:
            return None
        coordinates = self._plant.loops.default_coordinates(q)
        self._plant.use_coordinates(coordinates, np.zeros(len(q)))
        return coordinates

    def _use_coordinates(self, state: SimulationState, inputs: StepInputs) -> LoopCoordinates | None:
        """Coordinates of a step, used from now on; None without loops.

        With prescribed joint motion they are those of Dynamics.joint_names.
        """
        loops, coordinates = self._plant.loops, state.coordinates
        if loops is None or coordinates is None:
            return None
        if inputs.motion is not None and coordinates.independent != loops.default_independent:
            coordinates = loops.default_coordinates(state.joint_positions)
        self._plant.use_coordinates(coordinates, state.joint_velocities)
        return coordinates

    def _use_state_coordinates(self, state: SimulationState) -> None:
        """Use the coordinates of the rates of a state."""
        if state.coordinates is not None:
            self._plant.use_coordinates(state.coordinates, state.joint_velocities)

    def _rates_at(self, state: SimulationState, coordinates: LoopCoordinates | None, inputs: StepInputs) -> Array:
        """Rates (6 + n,) that a step begins with.

        Joints with prescribed motion jump to its velocities; a free base reacts to the jump.
        """
        if inputs.motion is None:
            return state.rates
        q = self.program_positions(state.joint_positions)
        rates = np.concatenate([state.twist, inputs.motion(state.time)[1]])
        if self._base == "free":
            R = state.pose[:3, :3]
            conserved = momentum(self.inertia_matrix(state), R, state.rates)
            if coordinates is not None:
                self._plant.use_coordinates(coordinates, state.joint_velocities)
            rates[:6] = twist_from_momentum(conserved, self._plant.inertia_matrix(q), R, rates)
        return self._constraints.project_onto_constraints(q, rates, keep_joint_rates=True)

    def _momentum_before(self, state: SimulationState, initial_rates: Array) -> Momentum:
        """Momentum that a step begins with at rates (6 + n,).

        It is carried on from the step before, so that rounding does not add up.
        """
        if self._momentum_state is state and self._conserved_momentum is not None:
            return self._conserved_momentum
        return momentum(self.inertia_matrix(state), state.pose[:3, :3], initial_rates)
