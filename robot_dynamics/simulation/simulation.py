"""Simulation of a robot by its direct dynamic model, in fixed steps.

A step integrates pose, positions and rates together by a Runge-Kutta method of order 6. The pose is integrated in a
chart that begins where the step begins, so that rotations stay rotations. The same inputs give the same numbers, bit
for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.array_checks import require_finite
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.inputs import require_pose
from robot_dynamics.model.robot import Robot
from robot_dynamics.simulation.base_motion import convective_acceleration
from robot_dynamics.simulation.energy import kinetic_energy, potential_energy
from robot_dynamics.simulation.equations_of_motion import EquationsOfMotion
from robot_dynamics.simulation.friction_separation import separate_friction
from robot_dynamics.simulation.ground_contact import GroundContact, PlantKinematics
from robot_dynamics.simulation.momentum import momentum
from robot_dynamics.simulation.plant import Plant
from robot_dynamics.simulation.rate_constraints import BASE_TYPES, RateConstraints
from robot_dynamics.simulation.step_builder import StepBuilder
from robot_dynamics.simulation.step_inputs import build_step_inputs
from robot_dynamics.simulation.step_integrator import StepIntegrator
from robot_dynamics.simulation.step_programs import StepPrograms
from robot_dynamics.simulation.time_stepping import TimeStepping

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.inputs import Base
    from robot_dynamics.simulation.ground import Ground
    from robot_dynamics.simulation.momentum import Momentum
    from robot_dynamics.simulation.rate_constraints import BaseType
    from robot_dynamics.simulation.simulation_state import SimulationState
    from robot_dynamics.simulation.step_inputs import PrescribedMotion
    from robot_dynamics.simulation.wheels import Wheel


class Simulation:
    """A robot that moves as its direct dynamic model computes.

    Parameters
    ----------
    robot : Robot
    step : float
        Length of a step [s].
    base : {"fixed", "free", "planar"}, optional
        Motion of the base; a planar base moves in the plane of its x and y axes. By default planar with wheels, free
        where the description has a moving base, else fixed.
    wheels : iterable of Wheel
        Wheels that carry a planar base and roll without slipping.
    ground : Ground, optional
        Elastic ground below links.
    drive_time : float
        Time [s] in which a driven base comes 63 % nearer to its reference twist.

    Attributes
    ----------
    robot : Robot
    step : float
    base : {"fixed", "free", "planar"}
    ground : Ground or None
    dynamics : Dynamics
        The model that is integrated: the robot without the friction that acts as impulses.
    joint_names : tuple of str
        Names of the n joints of joint vectors, those of Dynamics.joint_names.
    state : SimulationState
        The present state.
    stepping : TimeStepping
        Makes the states.

    Raises
    ------
    InvalidInputError
        An argument is of the wrong kind, or wheels are given to a base that is not planar.
    DescriptionError
        The wheels do not fit the robot.

    Notes
    -----
    Limits of joint positions in the description do not stop a joint.

    Steps run in machine code, many in one call of `advance`. Steps of these kinds run in Python, with the same result
    to rounding, in 0.2 to 2 ms each:

    - with prescribed motion of the joints (`motion`);
    - of a robot with steered wheels, or with wheels in its loops;
    - of loops near a singular position, and the step in which their independent coordinates change;
    - of a platform with a pitch of more than 60 degrees;
    - that an error ends: SimulationError or SingularModelError;
    - of a robot without joints, and all where llvmlite is missing.

    The attribute `python_steps` counts them.
    """

    def __init__(
        self,
        robot: Robot,
        *,
        step: float = 0.001,
        base: BaseType | None = None,
        wheels: Iterable[Wheel] = (),
        ground: Ground | None = None,
        drive_time: float = 0.05,
    ) -> None:
        if not isinstance(robot, Robot):
            raise InvalidInputError(f"Simulation takes a Robot, as load_robot returns it, not {robot!r:.60}")
        for name, value in (("step", step), ("drive_time", drive_time)):
            if not (isinstance(value, int | float) and np.isfinite(value) and value > 0):
                raise InvalidInputError(f"{name} is {value!r}: it must be a positive time [s]")
        contact_links = () if ground is None else ground.points
        for name in contact_links:
            if name not in robot.frames_by_name:
                raise InvalidInputError(f"ground: {describe_unknown_name('link', name, robot.frames_by_name)}")
        wheels = tuple(wheels)
        self.robot = robot
        self.step = float(step)
        self.ground = ground
        self.base = _require_base_type(robot, base, wheels)
        frictionless, friction = separate_friction(replace(robot, moving_base=self.base != "fixed"), self.step)
        self.dynamics = Dynamics(frictionless)
        if robot.loops and self.dynamics.joint_names:
            # the recursions would compute the first states, until a program is ready: these differ in rounding
            self.dynamics.compile("closure")
        self._plant = Plant(self.dynamics, contact_links)
        self.joint_names: tuple[str, ...] = self.dynamics.joint_names
        constraints = RateConstraints(self._plant, self.base, wheels)
        contact = None
        if ground is not None:
            kinematics = PlantKinematics(self._plant, ground.points)
            contact = GroundContact(ground, self._plant.wrench_links, kinematics, robot.characteristic_length)
        equations = EquationsOfMotion(self._plant, constraints, contact, float(drive_time))
        integrator = StepIntegrator(self._plant, equations, contact, self.step)
        builder = StepBuilder(self._plant, self.base, constraints, friction, ground, float(drive_time), self.step)
        programs = StepPrograms(builder)
        self.stepping = TimeStepping(self._plant, self.base, constraints, friction, integrator, programs, self.step)
        self._initial_state = self.stepping.resting_state()
        self.state = self._initial_state
        self.stepping.prepare(self.state)

    def __repr__(self) -> str:
        return f"Simulation({self.robot!r}, step={self.step:g}, base={self.base!r})"

    @property
    def python_steps(self) -> int:
        """Number of steps so far that ran in Python, not in machine code; `start` and `reset` do not change it."""
        return self.stepping.python_steps

    def start(
        self, positions: ArrayLike | None = None, velocities: ArrayLike | None = None, base: Base | None = None
    ) -> None:
        """Start again at time 0.

        Parameters
        ----------
        positions : array_like, shape (n,), optional
            Joint positions [rad or m]; by default the initial ones of the description. Of a robot with loops also
            (all joints,), as in Dynamics: the positions of dependent joints then choose the assembly mode.
        velocities : array_like, shape (n,), optional
            Joint velocities [rad/s or m/s]; zero by default.
        base : Base, optional
            Pose and twist of the base, at rest at the origin of the world by default. With a Base, the wheels turn as
            the base moves; without one, the base moves as the wheels turn.

        Raises
        ------
        InvalidInputError
            An array has the wrong shape or is not finite, or a fixed base is given a twist.
        SingularModelError
            The loops do not close, or are singular.
        """
        resting, size = self.stepping.resting_state(), self._plant.size
        if positions is None:
            positions = resting.positions
        all_joints_shape = (len(self.dynamics.all_joint_names),)
        if not (self.robot.loops and np.asarray(positions).shape == all_joints_shape):
            positions = require_finite("positions", positions, size, "joints")
        joint_positions = self.dynamics.expand_positions(positions)
        qd = resting.velocities
        if velocities is not None:
            qd = require_finite("velocities", velocities, size, "joints")
        if base is not None and self.base == "fixed" and np.any(base.twist):
            raise InvalidInputError("the base is fixed: it has no twist")
        pose, twist = np.eye(4), np.zeros(6)
        if base is not None:
            pose = np.array(require_pose(base.pose, "pose of the base"), dtype=np.float64)
            twist = require_finite("twist of the base", base.twist, 6, "components")
        rates = np.concatenate([twist, qd])
        self.reset(self.stepping.initial_state(pose, joint_positions, rates, has_base_motion=base is not None))

    def reset(self, state: SimulationState | None = None) -> None:
        """Return exactly to the state that the simulation started with.

        Parameters
        ----------
        state : SimulationState, optional
            Start with this state instead.
        """
        if state is not None:
            self._initial_state = state
        self.state = self._initial_state

    def is_compatible_with(self, other: Simulation) -> bool:
        """Whether the states of another Simulation are states of this one: same joints, same type of base.

        Parameters
        ----------
        other : Simulation

        Returns
        -------
        bool
        """
        return (self.joint_names, self.base) == (other.joint_names, other.base)

    def continue_from(self, before: Simulation) -> None:
        """Continue from the state of another Simulation, at time 0.

        `reset` still returns to the state that this simulation started with.

        Parameters
        ----------
        before : Simulation

        Raises
        ------
        InvalidInputError
            The simulations are not compatible.
        """
        if not self.is_compatible_with(before):
            raise InvalidInputError(
                f"cannot continue from {', '.join(before.joint_names)} on a {before.base} base: this simulation has "
                f"{', '.join(self.joint_names)} on a {self.base} base"
            )
        self.state = self.stepping.state_from(before.state)

    def advance(
        self,
        steps: int = 1,
        *,
        efforts: ArrayLike | None = None,
        external_wrenches: Mapping[str, ArrayLike] | None = None,
        drive: ArrayLike | None = None,
        motion: PrescribedMotion | None = None,
    ) -> SimulationState:
        """Advance by some steps.

        Parameters
        ----------
        steps : int
        efforts : array_like, shape (n,), optional
            Joint efforts [N m or N], constant during the steps; zero by default.
        external_wrenches : mapping of str to array_like, shape (6,), optional
            Wrenches [N; N m] of the environment on links, by link name, in the frame of the link; constant too.
        drive : array_like, shape (6,), optional
            Twist that a planar base is driven to, as far as its wheels allow. Joints that are no wheels move by their
            efforts.
        motion : callable, optional
            Prescribed joint motion: a function of the time [s] that returns positions, velocities and accelerations,
            (n,) each. Efforts have then no effect, and the base moves by reaction (Khalil, section 7.2).

        Returns
        -------
        SimulationState
            The state after the steps.

        Raises
        ------
        InvalidInputError
            An argument does not fit the robot.
        SimulationError
            The step is too long for the fast motions of the robot.
        SingularModelError
            The model has no accelerations in some state.

        Notes
        -----
        After an error the state is that of the last successful step. A call takes about 20 µs besides its steps: take
        many steps in a call where the efforts hold. See the class for the steps that run in Python.
        """
        if not isinstance(steps, int | np.integer) or steps < 0:
            raise InvalidInputError(
                f"cannot advance by {steps!r:.60} steps: a non-negative integer is needed; a step is {self.step:g} s"
            )
        inputs = build_step_inputs(
            self._plant, self.base, self.ground is not None, efforts, external_wrenches, drive, motion
        )
        end = self.state.steps + steps
        while self.state.steps < end:
            with np.errstate(all="ignore"):  # the integrator raises where numbers are not finite
                self.state = self.stepping.advance(self.state, inputs, end - self.state.steps)
        return self.state

    def accelerations(
        self,
        *,
        efforts: ArrayLike | None = None,
        external_wrenches: Mapping[str, ArrayLike] | None = None,
        drive: ArrayLike | None = None,
        motion: PrescribedMotion | None = None,
    ) -> tuple[Array, Array]:
        """Accelerations at the present state, without dry friction.

        Parameters
        ----------
        efforts, external_wrenches, drive, motion
            As for `advance`.

        Returns
        -------
        base : ndarray, shape (6,)
            True, classical acceleration of the base [m/s²; rad/s²], in the base frame.
        joints : ndarray, shape (n,)
            Joint accelerations [rad/s² or m/s²].
        """
        inputs = build_step_inputs(
            self._plant, self.base, self.ground is not None, efforts, external_wrenches, drive, motion
        )
        twist_derivative, joints = self.stepping.rate_derivatives(self.state, inputs)
        return twist_derivative + np.concatenate([convective_acceleration(self.state.twist), np.zeros(3)]), joints

    def momentum(self) -> Momentum:
        """Momentum of the robot in the world; of a planar base, that of all moving bodies.

        Returns
        -------
        Momentum

        Raises
        ------
        InvalidInputError
            The base is fixed.
        """
        if self.base == "fixed":
            raise InvalidInputError("a robot on a fixed base has no momentum of its own")
        A = self.stepping.inertia_matrix(self.state)
        return momentum(A, self.state.pose[:3, :3], self.state.rates)

    def energy(self) -> tuple[float, float]:
        """Mechanical energy of the robot.

        Returns
        -------
        kinetic : float
            Kinetic energy of bodies and rotors [J].
        potential : float
            Potential energy of weights and springs [J]; that of weights is zero at the origin of the world.
        """
        state = self.state
        kinetic = kinetic_energy(self.stepping.inertia_matrix(state), state.rates)
        return kinetic, potential_energy(self.robot, state.pose, state.joint_positions)

    def rolling_residual(self) -> Array:
        """Rounding error of the rolling constraints.

        Returns
        -------
        ndarray, shape (m,)
            Velocities [m/s, rad/s] of the present state that plane and wheels forbid.
        """
        return self.stepping.rolling_residual(self.state)


def _require_base_type(robot: Robot, base: BaseType | None, wheels: tuple[Wheel, ...]) -> BaseType:
    """The type of base of a simulation, checked."""
    base = base or ("planar" if wheels else "free" if robot.moving_base else "fixed")
    if base not in BASE_TYPES:
        raise InvalidInputError(f"base is {base!r}: it must be one of {', '.join(BASE_TYPES)}")
    if wheels and base != "planar":
        raise InvalidInputError(f"wheels carry a planar base, not a {base} one")
    return base
