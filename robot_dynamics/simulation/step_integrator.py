"""One step of a simulation: the equations of motion integrated in as many parts as their error needs.

What is integrated is y = [chart of the pose (6,); q; rates (6 + n,)]. q are the positions of the independent joints,
or of all joints where the robot has loops. The chart begins where the step does, so that rotations stay rotations.
"""

import logging
from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import SimulationError
from robot_dynamics.simulation.constrained_motion import (
    NEAR_SINGULAR_QUALITY,
    SINGULAR_QUALITY,
    TIGHT_CLOSURE_TOLERANCE,
    interpolate,
)
from robot_dynamics.simulation.plant import FrameKinematics
from robot_dynamics.simulation.rotation import exponential, rotation_vector_rate
from robot_dynamics.simulation.runge_kutta import increment

logger = logging.getLogger(__name__)

CHART_ORIGIN = np.zeros(6)
MAX_SUBSTEPS = 256
"""Into which a step is divided."""
ROUNDING_SHARE = 1e-9
"""Share of a step that is rounding."""
MAX_CONTACT_SUBSTEPS = 65536
"""Into which a step is divided where a point meets the ground."""
WARNING_SUBSTEPS = 8
"""Parts of a step from which on a warning says so."""
MIN_RATE_SCALE = 1.0
"""Rate [rad/s or characteristic lengths/s] that errors are compared with where everything moves slower."""
TOLERANCE = 1e-7
"""Relative error of a part of a step. The estimate is of order 4: the error of the method is far smaller."""
STEP_GROWTH_THRESHOLD = 1e-3
"""Share of the tolerance below which the next part is twice as long."""
MAX_CONTACT_DEPTH = 1e-5
"""Depth [characteristic lengths] that a point may reach in the part of a step in which it meets the ground."""
MAX_RELATIVE_ERROR = 1e-2
"""Relative error of the shortest parts at which a step is refused."""


class StepInputs(NamedTuple):
    """What acts during a step.

    efforts: (n,), of all joints where the robot has loops; wrenches: (6,) for each link that the plant listens to;
    drive: (6,) or None; motion: a function of time, or None; undisturbed: whether nothing but gravity acts on a free
    base.
    """

    efforts: np.ndarray
    wrenches: list
    drive: np.ndarray | None
    motion: object
    is_undisturbed: bool


class StepIntegrator:
    """Integrates what a Plant computes.

    Parameters
    ----------
    robot : Robot
    plant : Plant
    step : float
        Length of a step [s].
    ground : Ground or None
    drive_time : float
        Time [s] in which a base that is driven comes 63 % nearer to the twist that is wanted.
    """

    def __init__(self, robot, plant, step, ground, drive_time):
        self._robot, self._plant, self._step, self._drive_time = robot, plant, step, drive_time
        self._ground, self._looped, self._base = ground, bool(robot.loops), plant.base
        self._points = () if ground is None else ground.points
        self._frames = {}  # of the points, by independent joints
        self._warned = False
        self._depths = []  # of the points at the stages of a part of a step

    def accelerations(self, state, q, rates, coordinates, inputs):
        """ν̇ (6 + n,) at a SimulationState, for positions q and rates (6 + n,); the other arguments as for `step`."""
        y, near = np.concatenate([CHART_ORIGIN, q, rates]), self._looped and coordinates.quality < NEAR_SINGULAR_QUALITY
        velocities, self._depths = state.joint_velocities if near else None, []
        return self._derivative(state.time, y, len(q), state.pose, inputs, coordinates, velocities)[6 + len(q) :]

    def step(self, state, q, rates, coordinates, inputs):
        """Integrate one step.

        Parameters
        ----------
        state : SimulationState
            Where the step begins: its time, pose and velocities.
        q : ndarray
            Positions, as programs take them.
        rates : ndarray, shape (6 + n,)
            Twist of the base and velocities of the independent joints.
        coordinates : LoopCoordinates or None
            Of a robot with loops: those of the rates.
        inputs : Inputs

        Returns
        -------
        chart : ndarray, shape (6,)
            Rotation vector [rad] and displacement [m] of the base since the step began, in its axes of that time.
        q, rates : ndarray
        coordinates : LoopCoordinates or None
            Those of the returned rates.

        Raises
        ------
        SimulationError
            The error is too large however short the parts of the step are.
        SingularModelError
            The model has no accelerations here, or the loops no branch to follow.
        """
        size, done, part, shortest = len(q), 0.0, self._step, self._step
        y, velocities = np.concatenate([CHART_ORIGIN, q, rates]), state.joint_velocities
        while done < self._step:
            part = min(part, self._step - done)
            if self._looped:
                least = self._step / MAX_SUBSTEPS
                part = self._plant.loops.limit_substep(part, least, coordinates, y[6 : 6 + size], velocities)
            y, error, part = self._part(state, done, part, y, size, inputs, coordinates, velocities)
            shortest = min(shortest, part)
            done = done + part if done + part < (1 - ROUNDING_SHARE) * self._step else self._step
            if self._looped:
                y, coordinates, velocities = self._on_constraints(
                    y, size, state.time + done, inputs, coordinates, velocities
                )
            if error < STEP_GROWTH_THRESHOLD * TOLERANCE:
                part *= 2
        if inputs.motion is not None and not self._looped:
            y[6 : 6 + size] = inputs.motion(state.time + self._step)[0]
        self._warn_of_parts(shortest)
        return y[:6], y[6 : 6 + size], y[6 + size :], coordinates

    def _part(self, state, done, part, y, size, inputs, coordinates, velocities):
        """(y, relative error, length [s]) after the part of a step that begins `done` [s] after the state, at most as
        long as `part` [s]. Raises as `step`."""
        loops, joints, local_charts = self._plant.loops, slice(6, 6 + size), ()
        near = velocities if self._looped and coordinates.quality < NEAR_SINGULAR_QUALITY else None
        if self._looped:
            local_charts = loops.local_charts(y[joints])
            y = np.concatenate([y[:6], loops.integration_variables(y[joints], local_charts), y[6 + size :]])

        def derivative(time, y):
            return self._derivative(time, y, size, state.pose, inputs, coordinates, near, local_charts)

        while True:
            self._depths = []
            change, error = increment(derivative, state.time + done, y, part)
            error = self._relative_error(error[6 + size :], y[6 + size :] + change[6 + size :])
            divisible = part / 2 >= self._step / MAX_SUBSTEPS
            if error <= TOLERANCE or (error <= MAX_RELATIVE_ERROR and not divisible):
                if part < self._step / MAX_CONTACT_SUBSTEPS or not self._meets_the_ground():
                    end = y + change
                    if local_charts:
                        end[joints] = loops.positions(end[joints], local_charts)
                    return end, error, part
            elif not divisible:
                q = loops.positions(y[joints], local_charts) if self._looped else y[joints]
                self._plant.raise_if_singular(q, np.concatenate([state.twist, state.velocities]), inputs.efforts)
                raise SimulationError(
                    f"at {state.time:g} s the step is too long: parts of {part:.3g} s, 1/{MAX_SUBSTEPS} of it, still are "
                    "for what moves, pushes or vibrates here. Take a shorter step, or a model without such stiff "
                    "springs, strong dampers or light links"
                )
            part /= 2

    def _derivative(self, time, y, size, pose, inputs, coordinates, velocities, local_charts=()):
        """dy/dt of y = [chart of the pose (6,), q (size,), rates (6 + n,)].

        velocities: (all joints,) near singular positions of the loops, else None; steep: SteepAttitudes, in the place
        of which q has rotation vectors.
        """
        x, rates, R, P, found = y[6 : 6 + size], y[6 + size :], pose[:3, :3], pose[:3, 3], np.zeros(len(y))
        q = self._plant.loops.positions(x, local_charts) if local_charts else x
        if inputs.motion is not None:
            positions, rates[6:], _ = inputs.motion(time)
            q = self._with_motors_at(q, positions)
        if self._base != "fixed":
            E = exponential(y[:3])
            R, P = R @ E, P + R @ y[3:6]
            found[:3] = rotation_vector_rate(y[:3], rates[3:6])
            found[3:6] = E @ rates[:3]

        def model(q, rates):
            return self._accelerations(q, rates, time, R, P, inputs)

        if velocities is None:
            speeds, found[6 + size :] = model(q, rates)
        else:
            speeds, found[6 + size :] = self._at_constraints(q, rates, coordinates, velocities, model)
        found[6 : 6 + size] = self._plant.loops.derivative(x, q, speeds, local_charts) if self._looped else speeds
        return found

    def _at_constraints(self, q, rates, coordinates, velocities, model):
        """What model(q, rates) gives where the loops are closed, next to q (all joints,); at a singular position,
        interpolated between neighbours in the direction of velocities (all joints,)."""
        loops = self._plant.loops
        if loops.quality(coordinates, q) > SINGULAR_QUALITY:
            return model(loops.close_loops(coordinates, q, TIGHT_CLOSURE_TOLERANCE)[0], rates)
        return interpolate(lambda q: model(q, rates), loops.neighbours(coordinates, q, velocities))

    def _on_constraints(self, y, size, time, inputs, coordinates, velocities):
        """(y, LoopCoordinates, velocities (all joints,)) after a part of a step: the loops closed, the coordinates
        chosen anew where they have become worse."""
        loops, q, rates = self._plant.loops, y[6 : 6 + size], y[6 + size :]
        if inputs.motion is not None:
            positions, rates[6:], _ = inputs.motion(time)
            q = self._with_motors_at(q, positions)
        closed, quality = loops.close_on_branch(coordinates, q, velocities)
        coordinates = coordinates._replace(quality=quality)
        chosen = coordinates if inputs.motion is not None else loops.choose_coordinates(coordinates, closed)
        if chosen.independent != coordinates.independent or quality < NEAR_SINGULAR_QUALITY:
            velocities = self._plant.velocities(coordinates, closed, rates, velocities)
            if chosen.independent != coordinates.independent:
                rates = np.concatenate([rates[:6], velocities[[*chosen.independent]]])
        self._plant.use_coordinates(chosen, velocities)
        return np.concatenate([y[:6], closed, rates]), chosen, velocities

    def _accelerations(self, q, rates, time, R, P, inputs):
        """(velocities of q, ν̇ (6 + n,)) with the base turned by R and at P in the world."""
        wrenches = inputs.wrenches
        if self._points:
            wrenches = self._with_ground(q, rates, R, P, wrenches)
        velocities, found = self._plant.unconstrained_accelerations(
            q, rates, self._robot.gravity @ R, inputs.efforts, wrenches
        )
        told = None if inputs.drive is None else (inputs.drive - rates[:6]) / self._drive_time
        joints = None if inputs.motion is None else inputs.motion(time)[2]
        return velocities, self._plant.constrain_accelerations(q, rates, found, told, joints)

    def _meets_the_ground(self):
        """Whether a point was both in the ground and above it at the stages of a part of a step, and deeper than
        TOUCHING: then the force of the ground begins or ends within the part, which its slopes do not resolve."""
        if not self._points:
            return False
        depths = np.array(self._depths)
        meets = (depths > 0).any(axis=0) & (depths <= 0).any(axis=0)
        return bool((depths.max(axis=0)[meets] > MAX_CONTACT_DEPTH * self._robot.characteristic_length).any())

    def _with_ground(self, q, rates, R, P, wrenches):
        """Wrenches on links with what the ground exerts on those that touch it."""
        independent = self._plant.independent
        if independent not in self._frames:
            self._frames[independent] = FrameKinematics(self._plant.dynamics, self._points, independent)
        rotations, positions, velocities = self._frames[independent](q, rates)
        positions = P + positions @ R.T
        self._depths.append(self._ground.height - positions[:, 2])
        forces = self._ground.forces(positions, velocities @ R.T)
        wrenches = list(wrenches)
        for place, name in enumerate(self._points):
            if forces[place, 2]:
                wrench = wrenches[self._plant.links.index(name)].copy()
                wrench[:3] += (forces[place] @ R) @ rotations[place]
                wrenches[self._plant.links.index(name)] = wrench
        return wrenches

    def _with_motors_at(self, q, positions):
        """q as programs take it, with the joints of joint_names at positions (n,)."""
        if not self._looped:
            return positions
        q = q.copy()
        q[[*self._plant.loops.default_independent]] = positions
        return q

    def _relative_error(self, error, rates):
        """Error (6 + n,) of rates (6 + n,) beside the largest of them, metres counted in characteristic lengths."""
        units = self._plant.units
        return np.abs(error / units).max(initial=0) / (MIN_RATE_SCALE + np.abs(rates / units).max(initial=0))

    def _warn_of_parts(self, shortest):
        """Warn, once, where steps have to be integrated in many parts."""
        if shortest < self._step / WARNING_SUBSTEPS and not self._warned:
            self._warned = True
            logger.warning(
                "%r: steps of %g s are too long for what moves, pushes or vibrates; they are integrated in parts, the "
                "shortest of %.3g s",
                self._robot.name, self._step, shortest,
            )  # fmt: skip
