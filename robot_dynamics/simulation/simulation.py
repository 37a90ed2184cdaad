"""A robot that moves as its model says, in fixed steps: `Simulation`.

A step integrates pose, positions and rates together by a Runge-Kutta method of order 6, the pose in a chart that begins
where the step does, so that rotations stay rotations. What a step must not change is then put right: rates that wheels
forbid go, a robot that flies freely keeps its momentum, dry friction holds what it can hold. The same inputs give the
same numbers, bit for bit.
"""

from dataclasses import replace
from numbers import Integral
from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import QuestionError, unknown_name
from robot_dynamics.model.robot import Robot
from robot_dynamics.newton_euler.kinematics import link_placements
from robot_dynamics.question import checked_pose, finite
from robot_dynamics.simulation.friction import friction_impulses
from robot_dynamics.simulation.momentum import Momentum, momentum, twist_of
from robot_dynamics.simulation.plant import Frames, Plant, carried
from robot_dynamics.simulation.rotation import exponential, orthonormal, rotation_vector_rate
from robot_dynamics.simulation.runge_kutta import increment
from robot_dynamics.simulation.state import SimulationState

NOTHING = np.zeros(6)


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
            raise QuestionError(f"Simulation takes a Robot, as load_robot gives it, not {robot!r:.60}")
        for name, value in (("step", step), ("drive_time", drive_time)):
            if not (isinstance(value, int | float) and np.isfinite(value) and value > 0):
                raise QuestionError(f"{name} is {value!r}: a positive time [s] is needed")
        self.robot, self.step, self.ground, self._drive_time = robot, float(step), ground, float(drive_time)
        touching = () if ground is None else ground.points
        for name in touching:
            if name not in robot.frames_by_name:
                raise QuestionError(f"ground: {unknown_name('link', name, robot.frames_by_name)}")
        self.base = base or ("planar" if wheels else "free" if robot.moving_base else "fixed")
        self._plant = Plant(robot, self.base, tuple(wheels), touching, self.step)
        self.dynamics, self.joint_names = self._plant.dynamics, self._plant.dynamics.joint_names
        self._frames = Frames(self.dynamics, touching) if touching else None
        self._places = [self.dynamics.robot.joint_numbers[name] for name in self.joint_names]
        self._looped = bool(robot.loops)
        self._alone = self.dynamics.joint_names == self.dynamics.all_joint_names
        self._rubbing = np.flatnonzero(self._plant.dry + self._plant.viscous)
        self._kept = None, None  # a state, and the Momentum that a free robot has there
        self.reset(self._resting())

    def _resting(self):
        known = self.dynamics.closed_positions
        return SimulationState(
            0, 0.0, np.eye(4), NOTHING.copy(), known[self._places], np.zeros(self._plant.size), known.copy()
        )

    def start(self, positions=None, velocities=None, base=None):
        """Begin anew at time 0, at positions and velocities (n,) and a base with the pose and twist of a Base; what is
        left out is as the description begins, and at rest. Wheels turn as the base moves; without a Base, it moves as
        the wheels turn.

        positions may have all joints where the robot has loops, as in Dynamics.
        """
        resting = self._resting()
        q = resting.positions if positions is None else positions
        if positions is not None and self._looped and np.shape(positions) == (len(self.dynamics.all_joint_names),):
            everyone = self.dynamics.expand(positions)
        else:
            everyone = self.dynamics.expand(finite("positions", q, self._plant.size, "joints"))
        qd = resting.velocities if velocities is None else finite("velocities", velocities, self._plant.size, "joints")
        if base is not None and self.base == "fixed" and np.any(base.twist):
            raise QuestionError("the base is fixed: it has no twist")
        pose = np.eye(4) if base is None else checked_pose(base.pose, "pose of the base")
        twist = NOTHING if base is None else finite("twist of the base", base.twist, 6, "components")
        rates = self._plant.begun(self._program_q(everyone), np.concatenate([twist, qd]), of_base=base is not None)
        self.reset(
            SimulationState(
                0,
                0.0,
                np.array(pose, dtype=float),
                rates[:6].copy(),
                everyone[self._places],
                rates[6:].copy(),
                np.array(everyone),
            )
        )

    def reset(self, state=None):
        """Go back to the state that the simulation began with, or begin with another: exactly."""
        if state is not None:
            self._start = state
        self.state = self._start

    def alike(self, other):
        """Whether another Simulation has the same joints and a base that moves as this one: then both have the same
        states."""
        return (self.joint_names, self.base) == (other.joint_names, other.base)

    def go_on(self, before):
        """Go on from the state of another Simulation that is `alike`, at time 0; `reset` goes where this one began all
        the same. Raises QuestionError where they are not alike."""
        if not self.alike(before):
            raise QuestionError(
                f"the state of {', '.join(before.joint_names)} on a {before.base} base is none of "
                f"{', '.join(self.joint_names)} on a {self.base} base"
            )
        state = before.state
        everyone = self.dynamics.expand(state.joint_positions if self._looped else state.positions)
        rates = self._plant.begun(self._program_q(everyone), state.rates, of_base=True)
        self.state = replace(state, steps=0, time=0.0, twist=rates[:6].copy(), velocities=rates[6:].copy(),
                                    positions=everyone[self._places], joint_positions=np.array(everyone))  # fmt: skip

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
            raise QuestionError(f"advance by {steps!r:.60} steps: a whole number is needed, not negative; "
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
        found = self._accelerations(q, rates, state.time, state.pose[:3, :3], state.pose[:3, 3], inputs)
        return found[:6] + np.concatenate([carried(state.twist), np.zeros(3)]), found[6:]

    def momentum(self):
        """The Momentum of the robot in the world; of a base that is held, of what moves."""
        A = self._whole_inertia_matrix()
        return momentum(A, self.state.pose[:3, :3], self.state.rates)

    def energy(self):
        """(kinetic, potential) [J]: of bodies and rotors; of weights and springs, zero where the world's origin is."""
        state, rates = self.state, self.state.rates
        A = self._plant.inertia_matrix(self._program_q(state.joint_positions))
        rates = rates[-len(A) :] if len(A) else rates[:0]
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
        return self._plant.residual(self._program_q(self.state.joint_positions), self.state.rates)

    def _whole_inertia_matrix(self):
        if self.base == "fixed":
            raise QuestionError("a robot on a fixed base has no momentum of its own")
        return self._plant.inertia_matrix(self._program_q(self.state.joint_positions))

    def _inputs(self, efforts, external_wrenches, drive, motion):
        size = self._plant.size
        efforts = np.zeros(size) if efforts is None else finite("efforts", efforts, size, "joints")
        wrenches = {
            name: finite(f"external wrench on {name!r}", wrench, 6, "force and torque components")
            for name, wrench in (external_wrenches or {}).items()
        }
        if drive is not None:
            if self.base != "planar":
                raise QuestionError(f"a twist drives a planar base, this one is {self.base}")
            drive = finite("drive", drive, 6, "linear and angular components")
        for name in wrenches:
            self.robot.frame(name)
        new = [name for name in wrenches if name not in self._plant.links]
        if new:
            self._plant.listen_to([*self._plant.links, *new])
        given = [np.ascontiguousarray(wrenches.get(name, NOTHING), dtype=float) for name in self._plant.links]
        undisturbed = self.base == "free" and self.ground is None and not any(map(np.any, given))
        return _Inputs(np.ascontiguousarray(efforts, dtype=float), given, drive, motion, undisturbed)

    def _stepped(self, state, inputs):
        """The state a step later: everything grows together, then what must not change is put right."""
        R0, P0, n = state.pose[:3, :3], state.pose[:3, 3], self._plant.size
        begun = self._rates_of(state, inputs)
        rubbing = len(self._rubbing) > 0 and inputs.motion is None
        if rubbing:
            inputs, held = self._with_friction(state, begun, inputs)

        def derivative(time, y):
            q, rates, R, P, found = y[6 : 6 + n], y[6 + n :], R0, P0, np.zeros(len(y))
            if inputs.motion is not None:
                q, rates[6:], _ = inputs.motion(time)
            if self.base != "fixed":
                E = exponential(y[:3])
                R, P = R0 @ E, P0 + R0 @ y[3:6]
                found[:3] = rotation_vector_rate(y[:3], rates[3:6])
                found[3:6] = E @ rates[:3]
            found[6 : 6 + n] = rates[6:]
            q = self._program_q(self._everyone(q, state.joint_positions))
            found[6 + n :] = self._accelerations(q, rates, time, R, P, inputs)
            return found

        y = np.concatenate([NOTHING, state.positions, begun])
        y = y + increment(derivative, state.time, y, self.step)
        if not np.isfinite(y).all():
            self._plant.refuse(self._program_q(state.joint_positions), begun, inputs.efforts)
        time, pose = (state.steps + 1) * self.step, np.eye(4)
        pose[:3, :3], pose[:3, 3] = orthonormal(R0 @ exponential(y[:3])), P0 + R0 @ y[3:6]
        positions, rates = y[6 : 6 + n], y[6 + n :]
        if inputs.motion is not None:
            positions, rates[6:], _ = inputs.motion(time)
        everyone = self._everyone(positions, state.joint_positions)
        q = self._program_q(everyone)
        if inputs.undisturbed:
            rates[:6] = self._keep_momentum(state, begun, q, pose[:3, :3], rates)
        if rubbing:
            rates = rates + self._friction(q, rates, inputs, held)[0]
        rates = self._plant.allowed(q, rates, joints=inputs.motion is not None)
        positions = np.array(positions, dtype=float)
        found = SimulationState(state.steps + 1, time, pose, rates[:6].copy(), positions, rates[6:].copy(), everyone)
        if inputs.undisturbed:
            self._kept = found, self._kept[1]
        return found

    def _rates_of(self, state, inputs):
        """(6 + n,) rates that a step begins with. Joints that are told to move otherwise than they do jump to it, and a
        base that flies freely answers the jump."""
        if inputs.motion is None:
            return state.rates
        rates = np.concatenate([state.twist, inputs.motion(state.time)[1]])
        if self.base == "free":
            A, R = self._plant.inertia_matrix(self._program_q(state.joint_positions)), state.pose[:3, :3]
            rates[:6] = twist_of(momentum(A, R, state.rates), A, R, rates)
        return self._plant.allowed(self._program_q(state.joint_positions), rates, joints=True)

    def _keep_momentum(self, before, begun, q, R, rates):
        """The twist (6,) of the base that has the momentum from before the step, and what gravity has given."""
        A = self._plant.inertia_matrix(q)
        came_to, kept = self._kept
        if came_to is not before:  # else carried on, so that rounding does not add up
            A_before = self._plant.inertia_matrix(self._program_q(before.joint_positions))
            kept = momentum(A_before, before.pose[:3, :3], begun)
        kept = Momentum(kept.linear + A[0, 0] * self.step * self.robot.gravity, kept.angular)
        self._kept = None, kept
        return twist_of(kept, A, R, rates)

    def _with_friction(self, state, begun, inputs):
        """(_Inputs with friction among the efforts, its impulses (k,)): as it must be through a step, so that joints
        which it holds stay where they are."""
        q, R, P = self._program_q(state.joint_positions), state.pose[:3, :3], state.pose[:3, 3]
        ahead = begun + self.step * self._accelerations(q, begun, state.time, R, P, inputs)
        _, impulses, shares = self._friction(q, ahead, inputs, np.zeros(len(self._rubbing)))
        return inputs._replace(efforts=inputs.efforts + shares @ impulses / self.step), impulses

    def _friction(self, q, rates, inputs, held):
        """(what friction of a step makes of rates (6 + n,): a change of them; its impulses (k,); shares (n, k) of the
        joints in them). held: (k,) impulses that the rates have already."""
        joints = self._rubbing
        shares = self.dynamics.expand_rates(np.eye(self._plant.size), q if self._looped else None)[:, joints]
        response = self._plant.response(q, rates, inputs.drive is not None)[:, 6:] @ shares
        W, dry, viscous = shares.T @ response[6:], self._plant.dry[joints], self._plant.viscous[joints]
        impulses = friction_impulses(W, shares.T @ rates[6:] - W @ held, dry, viscous)
        return response @ (impulses - held), impulses, shares

    def _accelerations(self, q, rates, time, R, P, inputs):
        """ν̇ (6 + n,) with the base turned by R and at P in the world."""
        wrenches = inputs.wrenches
        if self._frames is not None:
            wrenches = self._with_ground(q, rates, R, P, wrenches)
        found = self._plant.unconstrained(q, rates, self.robot.gravity @ R, inputs.efforts, wrenches)
        told = None if inputs.drive is None else (inputs.drive - rates[:6]) / self._drive_time
        joints = None if inputs.motion is None else inputs.motion(time)[2]
        return self._plant.held(q, rates, found, told, joints)

    def _with_ground(self, q, rates, R, P, wrenches):
        """Wrenches on links with what the ground exerts on those that touch it."""
        rotations, positions, velocities = self._frames(q, rates)
        forces = self.ground.forces(P + positions @ R.T, velocities @ R.T)
        wrenches = list(wrenches)
        for place, name in enumerate(self.ground.points):
            if forces[place, 2]:
                wrench = wrenches[self._plant.links.index(name)].copy()
                wrench[:3] += (forces[place] @ R) @ rotations[place]
                wrenches[self._plant.links.index(name)] = wrench
        return wrenches

    def _everyone(self, positions, seed):
        """Positions (all joints,) from those (n,) of the independent ones; loops are closed from a seed."""
        if not self._looped:
            return positions if self._alone else self.dynamics.expand(positions)
        near = seed.copy()
        near[self._places] = positions
        return self.dynamics.expand(near)

    def _program_q(self, everyone):
        """What programs take as q, of positions of all joints."""
        return everyone if self._looped or self._alone else everyone[self._places]


class _Inputs(NamedTuple):
    """What acts during a step. efforts: (n,); wrenches: (6,) for each link that the plant listens to; drive: (6,) or
    None; motion: a function of time, or None; undisturbed: whether nothing but gravity acts on a free base."""

    efforts: np.ndarray
    wrenches: list
    drive: np.ndarray | None
    motion: object
    undisturbed: bool
