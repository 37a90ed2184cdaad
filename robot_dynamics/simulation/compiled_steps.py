"""Steps of a simulation in machine code, with inputs that are held.

The procedures follow `time_stepping`, `equations_of_motion` and `step_integrator`, with the same functions where these
compute. The Python of these modules takes the steps that the procedures refuse: those that need other coordinates, or
that fail.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.procedures import procedure, select, solve, zeros
from robot_dynamics.simulation.base_motion import chart_motion, displaced, rates_derivative
from robot_dynamics.simulation.momentum import Momentum, after_gravity, twist_from_momentum
from robot_dynamics.simulation.part_motion import HeldInputs, PartMotion, split
from robot_dynamics.simulation.rate_constraints import constrain, joint_impulse_response
from robot_dynamics.simulation.step_limits import RECORDED_STEPS
from robot_dynamics.simulation.step_parts import integrate_in_parts

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction
    from robot_dynamics.simulation.ground_contact import GroundContact
    from robot_dynamics.simulation.rate_constraints import BaseType, ConstraintSolution

BEST_QUALITY = 1.0
"""Quality of coordinates that determine all joints everywhere."""


class StepEnvironment(NamedTuple):
    """What acts on a robot beside its joints.

    Attributes
    ----------
    base : {"fixed", "free", "planar"}
    gravity : ndarray, shape (3,)
        In the world [m/s²].
    wrench_count : int
        Number of links that external wrenches act on.
    contact : GroundContact or None
    plane : ConstraintSolution or None
        Constraints of a planar base, that of plane and wheels.
    drive : ConstraintSolution or None
        Those of a base that is driven: with the driven components of its twist.
    drive_time : float
        Time [s] in which a driven base comes 63 % nearer to its reference twist.
    """

    base: BaseType
    gravity: Array
    wrench_count: int
    contact: GroundContact | None
    plane: ConstraintSolution | None
    drive: ConstraintSolution | None
    drive_time: float


class CompiledSteps(ABC):
    """Steps as procedures.

    A state is one array: the pose (12,) of the base without its last row, if it moves or there is ground; positions q
    as the programs of the plant take them; rates (m,), those of a moving base first; the best and the present quality
    of the coordinates, which is BEST_QUALITY without loops; the momentum (6,) of a free base. The inputs are one array
    as well: efforts; wrenches (6,) on links; the reference twist (6,) of a driven base; for a free base 1 if its
    momentum is conserved, else 0.

    Parameters
    ----------
    inertia_matrix : callable
        A (m, m) at positions q.
    friction : ImpulsiveFriction
    units : ndarray, shape (m,)
        Change of each rate that counts as much as one radian [rad or m].
    position_count : int
        Number of entries of q, and of the efforts.
    environment : StepEnvironment
    step : float
        Length of a step [s].
    """

    def __init__(
        self,
        inertia_matrix: Callable[[Any], Any],
        friction: ImpulsiveFriction,
        units: Array,
        position_count: int,
        environment: StepEnvironment,
        step: float,
    ) -> None:
        self._inertia_matrix = inertia_matrix
        self._friction = friction
        self._environment = environment
        self._position_count = position_count
        self._step = step
        self._has_moving_base = environment.base != "fixed"
        self._base_size = 6 if self._has_moving_base else 0
        self._joint_count = len(units) - self._base_size
        self.units = units
        self.contact = environment.contact
        # the depths of contacts are those of stages without a loop
        self.has_long_derivative = environment.plane is not None and self.contact is None

    @property
    def state_sizes(self) -> tuple[int, ...]:
        """Numbers of entries of the parts of a state."""
        pose = 12 if self._has_moving_base or self.contact is not None else 0
        return pose, self._position_count, len(self.units), 2, 6 if self._environment.base == "free" else 0

    @property
    def input_sizes(self) -> tuple[int, ...]:
        """Numbers of entries of the parts of the inputs."""
        drive = 0 if self._environment.drive is None else 6
        wrenches = 6 * self._environment.wrench_count
        return self._position_count, wrenches, drive, 1 if self._environment.base == "free" else 0

    @procedure
    def advance(self, state: Any, inputs: Any, limits: Any) -> Any:
        """The state after some steps.

        limits (2,): largest number of steps, and number of parts of steps after which no other step begins. The number
        of steps and the length [s] of the shortest part (2,) follow. The steps are fewer if one fails.
        """
        done = 0.0
        parts = 0.0
        shortest = self._step
        is_regular: Any = True
        while done < limits[0] and parts < limits[1] and is_regular:
            end, length, is_regular = self._try_step(state, inputs)
            if is_regular:
                state = end
                done = done + 1.0
                parts = parts + self._step / length
                if length < shortest:
                    shortest = length
        return state, np.array([done, shortest])

    @procedure
    def record(self, state: Any, inputs: Any, limits: Any) -> Any:
        """States (RECORDED_STEPS, state size) after each step, and (2,) steps done and length [s] of the shortest part.

        inputs (RECORDED_STEPS * input size,): those of each step; limits (1,): largest number of steps.
        The steps are fewer if one fails.
        """
        inputs = inputs.reshape(RECORDED_STEPS, sum(self.input_sizes))
        states = zeros(RECORDED_STEPS, sum(self.state_sizes))
        done = 0.0
        shortest = self._step
        is_regular: Any = True
        for k in range(RECORDED_STEPS):
            if is_regular and done < limits[0]:
                end, length, is_regular = self._try_step(state, inputs[k])
                if is_regular:
                    state = end
                    states[k] = state
                    done = done + 1.0
                    if length < shortest:
                        shortest = length
        return states, np.array([done, shortest])

    @procedure
    def _try_step(self, state: Any, inputs: Any) -> Any:
        """The state one step later, the length [s] of the shortest part of the step, and whether it is regular."""
        pose, q, rates, qualities, conserved = split(state, self.state_sizes)
        efforts, wrenches, reference_twist, keeps_momentum = split(inputs, self.input_sizes)
        held = HeldInputs(efforts, wrenches.reshape(-1, 6), reference_twist)
        placement = pose.reshape(-1, 4)
        R = placement[:, :3]
        P = placement[:, 3]
        held, speed, impulses, limits, is_regular = self._begin_step(q, rates, R, P, held)
        motion = PartMotion(self, R, P, held, speed)
        y = np.concatenate([np.zeros(self._base_size), q, rates])
        y, qualities, shortest, is_integrated = integrate_in_parts(motion, y, qualities, self._step)
        chart, q, rates = self.split_variables(y)
        if self._has_moving_base:
            R, P = displaced(R, P, chart)
            pose = np.concatenate([R, P[:, None]], axis=1).ravel()
        if len(conserved):
            rates, conserved = self._conserve_momentum(q, rates, R, conserved, keeps_momentum)
        if len(impulses):
            joint_shares = self._shares_at(q)
            velocities = joint_shares.T @ rates[self._base_size :]
            response = self._response(q, joint_shares)
            _, change = self._friction.apply(response, joint_shares, velocities, impulses, limits)
            rates = rates + change
        if self._environment.plane is not None:
            rates = constrain(self._inertia_matrix(q), self._environment.plane.N, rates, np.zeros(len(self.units)))
        end = np.concatenate([pose, q, rates, qualities, conserved])
        return end, shortest, is_regular & is_integrated

    @procedure
    def _begin_step(self, q: Any, rates: Any, R: Any, P: Any, held: HeldInputs) -> Any:
        """Friction of a step: inputs with friction among the efforts, its impulses (k,) and their limits (k,).

        Also the speed of the joints in loops, and whether the step can begin here.
        """
        efforts, wrenches, reference_twist = held
        impulses = np.zeros(len(self._friction.joints))
        limits = impulses, impulses
        speed: Any = 0.0
        if self._has_loops or len(impulses):
            velocities, accelerations = self.accelerations(q, rates, R, P, held)
            speed = self._loop_speed(velocities)
        if len(impulses):
            joint_shares = self._shares_at(q)
            joint_efforts = self._efforts_at_joints(joint_shares, efforts)
            joint_velocities = joint_shares.T @ rates[self._base_size :]
            limits = self._friction.limits(joint_velocities, joint_efforts)
            predicted = joint_shares.T @ (rates + self._step * accelerations)[self._base_size :]
            response = self._response(q, joint_shares)
            impulses, _ = self._friction.apply(response, joint_shares, predicted, impulses, limits)
            efforts = efforts + self._efforts_from_joints(joint_shares, impulses / self._step)
        return HeldInputs(efforts, wrenches, reference_twist), speed, impulses, limits, self.can_begin(q)

    @procedure
    def _conserve_momentum(self, q: Any, rates: Any, R: Any, conserved: Any, keeps_momentum: Any) -> Any:
        """Rates (m,) of a free robot with its momentum, if it is conserved, and the momentum (6,) after the step."""
        if keeps_momentum[0] > 0:
            A = self._inertia_matrix(q)
            before = Momentum(conserved[:3], conserved[3:])
            after = after_gravity(before, A[0, 0], self._environment.gravity, self._step)
            rates = np.concatenate([twist_from_momentum(after, A, R, rates), rates[6:]])
            conserved = np.concatenate(after)
        return rates, conserved

    def accelerations(self, q: Any, rates: Any, R: Any, P: Any, held: HeldInputs) -> tuple[Any, Any]:
        """Velocities of q, in the charts of platforms, and the derivative (m,) of the rates.

        R, P: orientation and position of the base in the world, where a state has them.
        """
        environment = self._environment
        size = self._base_size
        wrenches = held.wrenches
        if self.contact is not None:
            wrenches = self.contact.add_wrenches(q, rates, R, P, wrenches)
        base = (rates[:6], environment.gravity @ R) if size else ()
        velocities, derivative, *base_acceleration = self._model(q, rates[size:], held.efforts, *base, *wrenches)
        if base_acceleration:
            derivative = rates_derivative(rates[:6], base_acceleration[0], derivative)
        solution = environment.drive or environment.plane
        if solution is not None:
            right_side = [-solution.drift]
            if environment.drive is not None:
                reference_acceleration = (held.reference_twist - rates[:6]) / environment.drive_time
                right_side.append(reference_acceleration[solution.driven_components])
            prescribed = solution.pseudoinverse @ np.concatenate(right_side)
            derivative = constrain(self._inertia_matrix(q), solution.N, derivative, prescribed)
        return velocities, derivative

    def derivative(self, y: Any, R: Any, P: Any, held: HeldInputs) -> Any:
        """dy/dt. R, P: orientation and position of the base where the step begins."""
        chart, q, rates = self.split_variables(y)
        if self._has_moving_base:
            R, P, chart = chart_motion(R, P, chart, rates[:6])
        velocities, derivative = self.accelerations(q, rates, R, P, held)
        return np.concatenate([chart, self._position_rates(q, velocities), derivative])

    def split_variables(self, y: Any) -> list[Any]:
        """Chart of a moving base, positions q, and rates in y."""
        return split(y, (self._base_size, self._position_count, len(self.units)))

    def _response(self, q: Any, joint_shares: Any) -> Any:
        """Change of the rates (m, k) for unit impulses at the joints with friction."""
        A = self._inertia_matrix(q)
        if not self._has_moving_base:
            return solve(A, joint_shares)
        solution = self._environment.drive or self._environment.plane
        return joint_impulse_response(A, None if solution is None else solution.N, joint_shares)

    @property
    @abstractmethod
    def _has_loops(self) -> bool:
        """Whether the robot has loops."""

    @abstractmethod
    def _model(self, q: Any, joint_rates: Any, efforts: Any, *others: Any) -> tuple[Any, ...]:
        """Velocities of q, in the charts of platforms; accelerations (n,); the acceleration (6,) of a moving base.

        others: twist and gravity (3,) in the frame of a moving base, then wrenches (6,).
        """

    @abstractmethod
    def _position_rates(self, q: Any, velocities: Any) -> Any:
        """Derivative of q from velocities in the charts of platforms."""

    @abstractmethod
    def _loop_speed(self, velocities: Any) -> Any:
        """Largest speed of a joint in loops [rad/s or characteristic lengths/s]."""

    @abstractmethod
    def can_begin(self, q: Any) -> Any:
        """Whether a part of a step can begin at q."""

    @abstractmethod
    def limit(self, length: Any, speed: Any) -> Any:
        """A length [s] of a part of a step, limited for a speed of the joints in loops."""

    @abstractmethod
    def close(self, q: Any, qualities: Any) -> tuple[Any, Any, Any]:
        """Positions with closed loops, from integrated ones; qualities (2,); whether the step goes on."""

    @abstractmethod
    def _shares_at(self, q: Any) -> Any:
        """Velocity of each joint with friction for unit rates (n, k)."""

    @abstractmethod
    def _efforts_at_joints(self, joint_shares: Any, efforts: Any) -> Any:
        """Efforts (k,) of the motors at the joints with friction."""

    @abstractmethod
    def _efforts_from_joints(self, joint_shares: Any, values: Any) -> Any:
        """Efforts that act as values (k,) at the joints with friction."""


def keep_best(qualities: Any, quality: Any) -> Any:
    """Qualities (2,) of the coordinates, best and present one, where the present one is another."""
    return np.array([select(quality > qualities[0], quality, qualities[0]), quality])
