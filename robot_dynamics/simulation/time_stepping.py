"""One step of a simulation: integration, then corrections that conserve momentum and keep constraints.

All variables are integrated together. Afterwards a free robot gets the base twist that conserves its momentum, joint
friction acts as impulses, and rates that the wheels forbid are removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.simulation.friction_impulses import friction_impulses
from robot_dynamics.simulation.momentum import Momentum, momentum, twist_from_momentum
from robot_dynamics.simulation.rotation import exponential, orthonormalize
from robot_dynamics.simulation.simulation_state import SimulationState
from robot_dynamics.simulation.step_programs import StepPrograms

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.plant import Plant
    from robot_dynamics.simulation.rate_constraints import BaseType, RateConstraints
    from robot_dynamics.simulation.step_inputs import StepInputs
    from robot_dynamics.simulation.step_integrator import StepIntegrator
    from robot_dynamics.simulation.step_programs import RecordedRun, Run

NO_TWIST = np.zeros(6)


class TimeStepping:
    """Makes the states of a simulation.

    Parameters
    ----------
    plant : Plant
    base : {"fixed", "free", "planar"}
    constraints : RateConstraints
    friction : ImpulsiveFriction
    integrator : StepIntegrator
    step : float
        Length of a step [s].
    """

    def __init__(
        self,
        plant: Plant,
        base: BaseType,
        constraints: RateConstraints,
        friction: ImpulsiveFriction,
        integrator: StepIntegrator,
        step: float,
    ) -> None:
        self._plant = plant
        self._base = base
        self._constraints = constraints
        self._friction = friction
        self._integrator = integrator
        self._step = step
        has_program = base == "fixed" and not plant.wrench_links
        self._programs = StepPrograms(plant, friction, step) if has_program else None
        dynamics = plant.dynamics
        self._joint_indices = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
        self._takes_all_joints = plant.loops is not None or dynamics.joint_names == dynamics.all_joint_names
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
        q = self._program_positions(joint_positions)
        rates = self._constraints.initial_rates(q, rates, has_base_motion)
        return self._build_state(0, 0.0, pose, q, rates, coordinates)

    def state_from(self, previous: SimulationState) -> SimulationState:
        """The state at time 0 that continues a state of another simulation with the same joints and type of base."""
        coordinates = previous.coordinates
        q = self._program_positions(previous.joint_positions)
        if self._plant.loops is not None and coordinates is not None:
            self._plant.use_coordinates(coordinates, previous.joint_velocities)
            q, quality = self._plant.loops.close_loops(coordinates, q)
            coordinates = coordinates._replace(quality=quality)
        rates = self._constraints.initial_rates(q, previous.rates, has_base_motion=True)
        return self._build_state(0, 0.0, previous.pose, q, rates, coordinates, previous.joint_velocities)

    def advance(self, state: SimulationState, inputs: StepInputs, steps: int) -> SimulationState:
        """The state after some steps: as many as possible in machine code, at least one. Raises as `step`."""
        if self._programs is not None and inputs.motion is None and not inputs.wrenches:
            coordinates = self._use_coordinates(state, inputs)
            q = self._program_positions(state.joint_positions)
            run = self._programs.advance(steps, q, state.rates[6:], inputs.efforts, coordinates)
            if run is not None:
                return self._state_after(state, run)
        return self.step(state, inputs)

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

        Returns
        -------
        RecordedRun
        """
        assert self._programs is not None
        if self._plant.loops is not None:
            efforts = self._plant.dynamics.embed_efforts(efforts)
        return self._programs.record(q, rates, efforts, coordinates, threads)

    @property
    def joint_columns(self) -> list[int] | slice:
        """Columns of Dynamics.joint_names in positions as the programs take them."""
        return slice(None) if self._plant.loops is None else self._joint_indices

    def program_positions(self, state: SimulationState) -> Array:
        """Positions of a state as the programs take them."""
        return self._program_positions(state.joint_positions)

    def state_at(self, steps: int, q: Array, rates: Array, coordinates: LoopCoordinates | None) -> SimulationState:
        """The state of a robot on a fixed base at positions q, as the programs take them, and rates (n,)."""
        if coordinates is not None:
            self._plant.use_coordinates(coordinates, np.zeros(len(q)))
        rates = np.concatenate([NO_TWIST, rates])
        return self._build_state(steps, steps * self._step, np.eye(4), np.array(q), rates, coordinates)

    def _state_after(self, state: SimulationState, run: Run) -> SimulationState:
        """The state after steps of machine code."""
        steps = state.steps + run.steps
        rates = np.concatenate([NO_TWIST, run.rates])
        direction = state.joint_velocities
        return self._build_state(steps, steps * self._step, state.pose, run.q, rates, run.coordinates, direction)

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
        has_friction = len(self._friction.joints) > 0 and inputs.motion is None
        impulses = np.zeros(0)
        limits = impulses, impulses
        if has_friction:
            limits = self._friction_limits(state, initial_rates, inputs)
            inputs, impulses = self._add_friction_efforts(state, initial_rates, inputs, limits)
        initial_q = self._program_positions(state.joint_positions)
        chart, q, rates, coordinates = self._integrator.step(state, initial_q, initial_rates, coordinates, inputs)
        time = (state.steps + 1) * self._step
        pose = _displaced(state.pose, chart)
        if inputs.motion is not None:
            rates[6:] = inputs.motion(time)[1]
        if conserved is not None:
            A = self._plant.inertia_matrix(q)
            gravity = self._plant.dynamics.robot.gravity
            conserved = Momentum(conserved.linear + A[0, 0] * self._step * gravity, conserved.angular)
            rates[:6] = twist_from_momentum(conserved, A, pose[:3, :3], rates)
        if has_friction:
            rates = rates + self._friction_response(q, rates, inputs, impulses, limits)[0]
        rates = self._constraints.project_onto_constraints(q, rates, keep_joint_rates=inputs.motion is not None)
        successor = self._build_state(state.steps + 1, time, pose, q, rates, coordinates, state.joint_velocities)
        if conserved is not None:
            self._momentum_state = successor
            self._conserved_momentum = conserved
        return successor

    def rate_derivatives(self, state: SimulationState, inputs: StepInputs) -> tuple[Array, Array]:
        """Derivative of the twist (6,) and accelerations (n,) of Dynamics.joint_names, without dry friction."""
        q = self._program_positions(state.joint_positions)
        coordinates = self._use_coordinates(state, inputs)
        derivative = self._integrator.accelerations(state, q, state.rates, coordinates, inputs)
        if self._plant.loops is None:
            return derivative[:6], derivative[6:]
        return derivative[:6], self._plant.joint_accelerations(q, state.joint_velocities, derivative)

    def inertia_matrix(self, state: SimulationState) -> Array:
        """A (6 + n, 6 + n), or (n, n) on a fixed base, in the coordinates of the rates of a state."""
        self._use_state_coordinates(state)
        return self._plant.inertia_matrix(self._program_positions(state.joint_positions))

    def rolling_residual(self, state: SimulationState) -> Array:
        """Velocities (m,) [m/s, rad/s] of a state that plane and wheels forbid."""
        self._use_state_coordinates(state)
        return self._constraints.residual(self._program_positions(state.joint_positions), state.rates)

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
        joint_positions = q if self._takes_all_joints else self._plant.dynamics.expand_positions(q)
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
        return rates[6:].copy() if self._takes_all_joints else self._plant.velocity_matrix(q) @ rates[6:]

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
        q = self._program_positions(state.joint_positions)
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

    def _friction_limits(self, state: SimulationState, initial_rates: Array, inputs: StepInputs) -> tuple[Array, Array]:
        """Lowest and highest impulse (k,) of dry friction in a step that begins with rates (6 + n,)."""
        if self._friction.constant_limits is not None:
            return self._friction.constant_limits
        self._use_coordinates(state, inputs)
        joints = self._friction.joints
        joint_shares = self._plant.velocity_matrix(self._program_positions(state.joint_positions))[joints].T
        efforts = inputs.efforts[joints] if self._plant.loops is not None else joint_shares.T @ inputs.efforts
        return self._friction.impulse_limits(joint_shares.T @ initial_rates[6:], efforts)

    def _add_friction_efforts(
        self, state: SimulationState, initial_rates: Array, inputs: StepInputs, limits: tuple[Array, Array]
    ) -> tuple[StepInputs, Array]:
        """Inputs with friction among the efforts, and its impulses (k,) within the limits (k,) of dry friction.

        The friction predicted for the end of the step acts throughout the step, so that sticking joints do not move.
        """
        q = self._program_positions(state.joint_positions)
        coordinates = self._use_coordinates(state, inputs)
        accelerations = self._integrator.accelerations(state, q, initial_rates, coordinates, inputs)
        predicted_rates = initial_rates + self._step * accelerations
        joints = self._friction.joints
        _, impulses, joint_shares = self._friction_response(q, predicted_rates, inputs, np.zeros(len(joints)), limits)
        efforts = inputs.efforts.copy()
        if self._plant.loops is not None:
            efforts[joints] += impulses / self._step
        else:
            efforts += joint_shares @ impulses / self._step
        return inputs._replace(efforts=efforts), impulses

    def _friction_response(
        self, q: Array, rates: Array, inputs: StepInputs, applied_impulses: Array, limits: tuple[Array, Array]
    ) -> tuple[Array, Array, Array]:
        """Change of the rates (6 + n,) by friction, its impulses (k,), and the shares (n, k) of joints in them.

        applied_impulses: (k,) those that the rates (6 + n,) contain already; limits: lowest and highest impulse (k,) of
        dry friction.
        """
        friction = self._friction
        joint_shares = self._plant.velocity_matrix(q)[friction.joints].T
        response = self._constraints.impulse_response(q, rates, inputs.drive is not None)[:, 6:] @ joint_shares
        W = joint_shares.T @ response[6:]
        velocities = joint_shares.T @ rates[6:] - W @ applied_impulses
        viscous_gains = friction.viscous_gains + friction.viscous_asymmetries * np.sign(velocities)
        impulses = friction_impulses(W, velocities, limits, viscous_gains)
        return response @ (impulses - applied_impulses), impulses, joint_shares

    def _program_positions(self, joint_positions: Array) -> Array:
        """Positions as the programs take them, from positions (all joints,)."""
        return joint_positions if self._takes_all_joints else joint_positions[self._joint_indices]


def _displaced(pose: Array, chart: Array) -> Array:
    """Pose (4, 4) at a point (6,) of the chart that begins at a pose (4, 4)."""
    R, P = pose[:3, :3], pose[:3, 3]
    displaced = np.eye(4)
    displaced[:3, :3] = orthonormalize(R @ exponential(chart[:3]))
    displaced[:3, 3] = P + R @ chart[3:]
    return displaced
