"""A robot that moves as its model says, in fixed steps: `Simulation`.

A step integrates pose, positions and rates together by a Runge-Kutta method of order 6, the pose in a chart that begins
where the step does, so that rotations stay rotations. What a step must not change is then put right: rates that wheels
forbid go, a robot that flies freely keeps its momentum, dry friction holds what it can hold. The same inputs give the
same numbers, bit for bit.
"""

from numbers import Integral

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.inputs import require_finite, require_pose
from robot_dynamics.model.robot import Robot
from robot_dynamics.newton_euler.kinematics import link_placements
from robot_dynamics.simulation.friction_impulses import friction_impulses
from robot_dynamics.simulation.momentum import Momentum, momentum, twist_from_momentum
from robot_dynamics.simulation.plant import Plant, convective_acceleration
from robot_dynamics.simulation.rotation import exponential, orthonormalize
from robot_dynamics.simulation.state import SimulationState
from robot_dynamics.simulation.step_integrator import StepInputs, StepIntegrator

ZERO_SCREW = np.zeros(6)


class Simulation:
    """Integrates the direct model of a robot.

    robot: a Robot. step: [s], the same for ever. base: fixed, free or planar; None: as the robot says, planar where
    there are wheels. wheels: Wheels that carry it. ground: a Ground, or None. drive_time: [s] in which a base that is
    told a twist comes 63 % nearer to it.

    state: the SimulationState. Joint vectors are (n,) in the order of `joint_names`, without a limit of their
    positions: limits of a description stop nothing here.

    Raises QuestionError and DescriptionError for what does not fit together.
    """

    def __init__(self, robot, *, step=0.001, base=None, wheels=(), ground=None, drive_time=0.05):
        if not isinstance(robot, Robot):
            raise InvalidInputError(f"Simulation takes a Robot, as load_robot gives it, not {robot!r:.60}")
        for name, value in (("step", step), ("drive_time", drive_time)):
            if not (isinstance(value, int | float) and np.isfinite(value) and value > 0):
                raise InvalidInputError(f"{name} is {value!r}: a positive time [s] is needed")
        self.robot, self.step, self.ground = robot, float(step), ground
        touching = () if ground is None else ground.points
        for name in touching:
            if name not in robot.frames_by_name:
                raise InvalidInputError(f"ground: {describe_unknown_name('link', name, robot.frames_by_name)}")
        self.base = base or ("planar" if wheels else "free" if robot.moving_base else "fixed")
        self._plant = Plant(robot, self.base, tuple(wheels), touching, self.step)
        self.dynamics, self.joint_names = self._plant.dynamics, self._plant.dynamics.joint_names
        self._integrator = StepIntegrator(robot, self._plant, self.step, ground, float(drive_time))
        self._places = [self.dynamics.robot.joint_numbers[name] for name in self.joint_names]
        self._looped = bool(robot.loops)
        self._alone = self.dynamics.joint_names == self.dynamics.all_joint_names
        self._rubbing = np.flatnonzero(self._plant.dry_impulse_limits + self._plant.viscous_impulse_gains)
        self.state = None
        self._kept = None, None  # a state, and the Momentum that a free robot has there
        self.reset(self._resting())

    def _resting(self):
        known, size = self.dynamics.initial_joint_positions, self._plant.size
        return SimulationState(
            0, 0.0, np.eye(4), ZERO_SCREW.copy(), known[self._places], np.zeros(size), known.copy(), np.zeros(len(known)),
            self._first_coordinates(known),
        )  # fmt: skip

    def _first_coordinates(self, known):
        """LoopCoordinates of the motors at positions (all joints,); None without loops."""
        if not self._looped:
            return None
        coordinates = self._plant.loops.default_coordinates(known)
        self._plant.use_coordinates(coordinates, np.zeros(len(known)))
        return coordinates

    def start(self, positions=None, velocities=None, base=None):
        """Begin anew at time 0, at positions and velocities (n,) and a base with the pose and twist of a Base; what is
        left out is as the description begins, and at rest. Wheels turn as the base moves; without a Base, it moves as
        the wheels turn.

        positions may have all joints where the robot has loops, as in Dynamics.
        """
        resting = self._resting()
        q = resting.positions if positions is None else positions
        if positions is not None and self._looped and np.shape(positions) == (len(self.dynamics.all_joint_names),):
            everyone = self.dynamics.expand_positions(positions)
        else:
            everyone = self.dynamics.expand_positions(require_finite("positions", q, self._plant.size, "joints"))
        qd = (
            resting.velocities
            if velocities is None
            else require_finite("velocities", velocities, self._plant.size, "joints")
        )
        if base is not None and self.base == "fixed" and np.any(base.twist):
            raise InvalidInputError("the base is fixed: it has no twist")
        pose = np.eye(4) if base is None else require_pose(base.pose, "pose of the base")
        twist = ZERO_SCREW if base is None else require_finite("twist of the base", base.twist, 6, "components")
        self.reset(self._begun(np.array(pose, dtype=float), everyone, np.concatenate([twist, qd]), base is not None))

    def _begun(self, pose, everyone, rates, has_base_motion):
        """The SimulationState at time 0, at positions (all joints,) and rates (6 + n,) of the base and joint_names."""
        coordinates = self._first_coordinates(everyone)
        rates = self._plant.initial_rates(self._program_q(everyone), rates, has_base_motion)
        return self._state(0, 0.0, pose, self._program_q(everyone), rates, coordinates)

    def reset(self, state=None):
        """Go back to the state that the simulation began with, or begin with another: exactly."""
        if state is not None:
            self._start = state
        self.state = self._start

    def is_compatible_with(self, other):
        """Whether another Simulation has the same joints and a base that moves as this one: then both have the same
        states."""
        return (self.joint_names, self.base) == (other.joint_names, other.base)

    def continue_from(self, before):
        """Go on from the state of another Simulation that is `alike`, at time 0; `reset` goes where this one began all
        the same. Raises QuestionError where they are not alike."""
        if not self.is_compatible_with(before):
            raise InvalidInputError(
                f"the state of {', '.join(before.joint_names)} on a {before.base} base is none of "
                f"{', '.join(self.joint_names)} on a {self.base} base"
            )
        state, coordinates, q = before.state, before.state.coordinates, self._program_q(before.state.joint_positions)
        if self._looped:
            self._plant.use_coordinates(coordinates, state.joint_velocities)
            q, quality = self._plant.loops.close_loops(coordinates, q)
            coordinates = coordinates._replace(quality=quality)
        rates = self._plant.initial_rates(q, state.rates, has_base_motion=True)
        self.state = self._state(0, 0.0, state.pose, q, rates, coordinates, state.joint_velocities)

    def advance(self, steps=1, *, efforts=None, external_wrenches=None, drive=None, motion=None):
        """Go on by some steps, and give the state there.

        efforts: (n,) [N m or N] of the motors, held during the steps. external_wrenches: {link name: (6,)} on links, in
        the link's own frame, held there too. drive: (6,) twist that a planar base is driven to, as far as its wheels
        can; joints that are no wheels go on by their efforts. motion: a function of the time [s] that gives (positions,
        velocities, accelerations), (n,) each, that all joints have: then efforts are not asked for, and the base moves
        by reaction (Khalil, section 7.2).

        Raises SimulationError where numbers grow beyond all bounds, SingularModelError where the model has no answer,
        QuestionError for arguments that do not fit. The state is then that of the last good step.
        """
        if not isinstance(steps, Integral) or steps < 0:
            raise InvalidInputError(f"advance by {steps!r:.60} steps: a whole number is needed, not negative; "
                                f"a step is {self.step:g} s")  # fmt: skip
        inputs = self._inputs(efforts, external_wrenches, drive, motion)
        for _ in range(steps):
            with np.errstate(all="ignore"):  # what is not finite is refused
                self.state = self._stepped(self.state, inputs)
        return self.state

    def accelerations(self, *, efforts=None, external_wrenches=None, drive=None, motion=None):
        """(base (6,), joints (n,)) at the state, for inputs as of `advance`: of the base true and classical, in the
        base frame, dry friction left out."""
        inputs, state = self._inputs(efforts, external_wrenches, drive, motion), self.state
        q, rates = self._program_q(state.joint_positions), state.rates
        slope = self._integrator.accelerations(state, q, rates, self._coordinates_of(state, inputs), inputs)
        joints = slope[6:] if not self._looped else self._plant.joint_accelerations(q, state.joint_velocities, slope)
        return slope[:6] + np.concatenate([convective_acceleration(state.twist), np.zeros(3)]), joints

    def momentum(self):
        """The Momentum of the robot in the world; of a base that is held, of what moves."""
        if self.base == "fixed":
            raise InvalidInputError("a robot on a fixed base has no momentum of its own")
        return momentum(self._inertia_at(self.state), self.state.pose[:3, :3], self.state.rates)

    def energy(self):
        """(kinetic, potential) [J]: of bodies and rotors; of weights and springs, zero where the world's origin is."""
        state = self.state
        A = self._inertia_at(state)
        rates = state.rates[-len(A) :] if len(A) else state.rates[:0]
        height = 0.0
        for link, (R, P) in zip(self.robot.links, link_placements(self.robot, state.joint_positions), strict=True):
            moments = R @ link.inertia.first_moments + link.inertia.mass * P
            world = state.pose[:3, :3] @ moments + link.inertia.mass * state.pose[:3, 3]
            height -= float(self.robot.gravity @ world)
        springs = (
            0.5 * joint.spring.stiffness * (position - joint.spring.rest) ** 2
            for joint, position in zip(self.robot.joints, state.joint_positions, strict=True)
            if joint.spring
        )
        return 0.5 * float(rates @ A @ rates), height + float(sum(springs))

    def rolling_residual(self):
        """(m,) velocities [m/s, rad/s] that the wheels forbid, and are there all the same: rounding."""
        if self._looped:
            self._plant.use_coordinates(self.state.coordinates, self.state.joint_velocities)
        return self._plant.residual(self._program_q(self.state.joint_positions), self.state.rates)

    def _inertia_at(self, state):
        """The inertia matrix at a state, in the coordinates of its rates."""
        if self._looped:
            self._plant.use_coordinates(state.coordinates, state.joint_velocities)
        return self._plant.inertia_matrix(self._program_q(state.joint_positions))

    def _inputs(self, efforts, external_wrenches, drive, motion):
        size = self._plant.size
        efforts = np.zeros(size) if efforts is None else require_finite("efforts", efforts, size, "joints")
        wrenches = {
            name: require_finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
            for name, wrench in (external_wrenches or {}).items()
        }
        if drive is not None:
            if self.base != "planar":
                raise InvalidInputError(f"a twist drives a planar base, this one is {self.base}")
            drive = require_finite("drive", drive, 6, "linear and angular components")
        for name in wrenches:
            self.robot.frame(name)
        new = [name for name in wrenches if name not in self._plant.links]
        if new:
            self._plant.set_wrench_links([*self._plant.links, *new])
        given = [np.ascontiguousarray(wrenches.get(name, ZERO_SCREW), dtype=float) for name in self._plant.links]
        is_undisturbed = self.base == "free" and self.ground is None and not any(map(np.any, given))
        efforts = self.dynamics.embed_efforts(efforts) if self._looped else np.ascontiguousarray(efforts, dtype=float)
        return StepInputs(efforts, given, drive, motion, is_undisturbed)

    def _stepped(self, state, inputs):
        """The state a step later: everything is integrated together, then what must not change is put right."""
        coordinates = self._coordinates_of(state, inputs)
        begun = self._rates_of(state, coordinates, inputs)
        kept = self._momentum_before(state, begun) if inputs.is_undisturbed else None
        rubbing = len(self._rubbing) > 0 and inputs.motion is None
        if rubbing:
            inputs, held = self._with_friction(state, begun, inputs)
        q0 = self._program_q(state.joint_positions)
        phi, q, rates, coordinates = self._integrator.step(state, q0, begun, coordinates, inputs)
        time, pose = (state.steps + 1) * self.step, np.eye(4)
        R0, P0 = state.pose[:3, :3], state.pose[:3, 3]
        pose[:3, :3], pose[:3, 3] = orthonormalize(R0 @ exponential(phi[:3])), P0 + R0 @ phi[3:]
        if inputs.motion is not None:
            rates[6:] = inputs.motion(time)[1]
        if inputs.is_undisturbed:
            rates[:6] = self._keep_momentum(state, q, pose[:3, :3], rates, kept)
        if rubbing:
            rates = rates + self._friction(q, rates, inputs, held)[0]
        rates = self._plant.project_onto_constraints(q, rates, joints=inputs.motion is not None)
        found = self._state(state.steps + 1, time, pose, q, rates, coordinates, state.joint_velocities)
        if inputs.is_undisturbed:
            self._kept = found, self._kept[1]
        return found

    def _state(self, steps, time, pose, q, rates, coordinates, direction=None):
        """The SimulationState at positions q (as programs take them) and rates (6 + n,). direction: velocities (all
        joints,) that led here, None where nothing did."""
        velocities = self._velocities(q, rates, direction, coordinates)
        everyone = q if self._looped or self._alone else self.dynamics.expand_positions(q)
        return SimulationState(
            steps, time, pose, rates[:6].copy(), np.array(everyone[self._places]), velocities[self._places].copy(),
            np.array(everyone), velocities, coordinates,
        )  # fmt: skip

    def _velocities(self, q, rates, direction, coordinates):
        """Velocities (all joints,) at rates (6 + n,)."""
        if self._looped and direction is None:
            return self._plant.initial_velocities(coordinates, q, rates)
        if self._looped:
            return self._plant.velocities(coordinates, q, rates, direction)
        return rates[6:].copy() if self._alone else self._plant.velocity_matrix(q) @ rates[6:]

    def _coordinates_of(self, state, inputs):
        """The LoopCoordinates of a step, which the plant uses from now on; the motors' where joints have a prescribed
        motion. None without loops."""
        coordinates = state.coordinates
        if self._looped:
            if inputs.motion is not None and coordinates.independent != self._plant.loops.default_independent:
                coordinates = self._plant.loops.default_coordinates(state.joint_positions)
            self._plant.use_coordinates(coordinates, state.joint_velocities)
        return coordinates

    def _rates_of(self, state, coordinates, inputs):
        """(6 + n,) rates that a step begins with. Joints with a prescribed motion jump to its velocities, and a base
        that flies freely answers the jump."""
        if inputs.motion is None:
            return state.rates
        q, rates = self._program_q(state.joint_positions), np.concatenate([state.twist, inputs.motion(state.time)[1]])
        if self.base == "free":
            kept, R = self._momentum_of(state, coordinates), state.pose[:3, :3]
            rates[:6] = twist_from_momentum(kept, self._plant.inertia_matrix(q), R, rates)
        return self._plant.project_onto_constraints(q, rates, joints=True)

    def _momentum_of(self, state, coordinates):
        """The Momentum of a state; the plant takes rates as those of `coordinates` afterwards."""
        kept = momentum(self._inertia_at(state), state.pose[:3, :3], state.rates)
        if self._looped:
            self._plant.use_coordinates(coordinates, state.joint_velocities)
        return kept

    def _momentum_before(self, state, begun):
        """The Momentum that a step begins with, at rates (6 + n,): carried on from the step before, so that rounding
        does not add up."""
        came_to, kept = self._kept
        if came_to is state:
            return kept
        return momentum(self._inertia_at(state), state.pose[:3, :3], begun)

    def _keep_momentum(self, state, q, R, rates, kept):
        """The twist (6,) of the base that has the momentum from before the step, and what gravity has given."""
        A = self._plant.inertia_matrix(q)
        kept = Momentum(kept.linear + A[0, 0] * self.step * self.robot.gravity, kept.angular)
        self._kept = None, kept
        return twist_from_momentum(kept, A, R, rates)

    def _with_friction(self, state, begun, inputs):
        """(Inputs with friction among the efforts, its impulses (k,)): as it must be through a step, so that joints
        which it holds stay where they are."""
        q = self._program_q(state.joint_positions)
        coordinates = self._coordinates_of(state, inputs)
        ahead = begun + self.step * self._integrator.accelerations(state, q, begun, coordinates, inputs)
        _, impulses, shares = self._friction(q, ahead, inputs, np.zeros(len(self._rubbing)))
        efforts = inputs.efforts.copy()
        if self._looped:
            efforts[self._rubbing] += impulses / self.step
        else:
            efforts += shares @ impulses / self.step
        return inputs._replace(efforts=efforts), impulses

    def _friction(self, q, rates, inputs, held):
        """(what friction of a step makes of rates (6 + n,): a change of them; its impulses (k,); shares (n, k) of the
        joints in them). held: (k,) impulses that the rates have already."""
        joints = self._rubbing
        shares = self._plant.velocity_matrix(q)[joints].T
        response = self._plant.impulse_response(q, rates, inputs.drive is not None)[:, 6:] @ shares
        W, dry, viscous = (
            shares.T @ response[6:],
            self._plant.dry_impulse_limits[joints],
            self._plant.viscous_impulse_gains[joints],
        )
        impulses = friction_impulses(W, shares.T @ rates[6:] - W @ held, dry, viscous)
        return response @ (impulses - held), impulses, shares

    def _program_q(self, everyone):
        """What programs take as q, of positions of all joints."""
        return everyone if self._looped or self._alone else everyone[self._places]
