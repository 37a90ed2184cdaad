"""What moves a robot: accelerations of its base and its joints from efforts, wrenches, and what holds the base.

Rates are ν = [V0; q̇] (6 + n,), the twist of the base in the base frame and the velocities of Dynamics.joint_names;
ν̇ are their derivatives. Of a fixed base the six are zero.
"""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from scipy.linalg import null_space

from robot_dynamics.codegen.jit.compiled_models import PythonProgram
from robot_dynamics.codegen.jit.compiled_program import compile_program
from robot_dynamics.codegen.trace.models import frames_model
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import CompilationError, InvalidInputError
from robot_dynamics.inputs import Base
from robot_dynamics.newton_euler.walker_orin import inertia_matrix
from robot_dynamics.simulation.constrained_motion import SINGULAR_QUALITY, ConstrainedMotion, interpolate
from robot_dynamics.simulation.friction_impulses import STIFF_DAMPING_RATIO
from robot_dynamics.simulation.wheels import RollingConstraints

BASE_TYPES = ("fixed", "free", "planar")
NO_GRAVITY = np.zeros(3)
RANK_TOLERANCE = 1e-9  # below which a singular value of constraints is rounding
DRIVE_COMPONENTS = (0, 5, 1)  # the rows of V0 in which a base that is told how to drive hears: ahead, turning, aside


class Plant:
    """The compiled models of a robot, with what holds its base.

    base: fixed, free, or planar: gliding in the plane of its x and y, on wheels that roll where there are some.
    dynamics: of the same robot, its base moving or not as `base` says, without the friction that is told by dry and
    viscous: (all joints,) Fs h [N m s] and Fv h, what is for the end of a step of h.
    """

    def __init__(self, robot, base, wheels, links, step):
        if base not in BASE_TYPES:
            raise InvalidInputError(f"base is {base!r}: {', '.join(BASE_TYPES)} are known")
        if wheels and base != "planar":
            raise InvalidInputError(f"wheels carry a planar base, not a {base} one")
        self.base = base
        self.dry_impulse_limits = step * np.array([joint.coulomb_friction for joint in robot.joints])
        self.viscous_impulse_gains = step * np.array([joint.viscous_friction for joint in robot.joints])
        self.viscous_impulse_gains[
            self.viscous_impulse_gains
            <= STIFF_DAMPING_RATIO * minimum_joint_inertias(replace(robot, moving_base=base != "fixed"))
        ] = 0
        joints = tuple(
            replace(joint, coulomb_friction=0.0, viscous_friction=0.0 if stiff else joint.viscous_friction)
            for joint, stiff in zip(robot.joints, self.viscous_impulse_gains, strict=True)
        )
        self.dynamics = Dynamics(replace(robot, joints=joints, moving_base=base != "fixed"))
        self.size = len(self.dynamics.joint_names)
        self._looped = bool(robot.loops)
        self.loops = ConstrainedMotion(self.dynamics) if self._looped else None
        self._links, self._programs, self._inertia = None, {}, {}
        self._places = [robot.joint_numbers[name] for name in self.dynamics.joint_names]
        self._G = None if self._looped else self.dynamics.expand_velocities(np.eye(self.size)).T
        self._coordinates, self._direction = None, None
        length = robot.characteristic_length
        sliding = [length if joint.prismatic else 1.0 for joint in robot.joints]
        self._units = np.array([length] * 3 + [1.0] * 3 + sliding)
        self.set_wrench_links(links)
        self._rolling = RollingConstraints(robot, wheels) if base == "planar" else None
        if self._rolling is not None:
            self._rolling.constraint_rows(self.dynamics.initial_joint_positions)  # refuses wheels that do not stand
        self._known = {}  # what constant constraints give, by whether the base is told how to drive

    @property
    def units(self):
        """(6 + n,) what counts as much as a radian of each of the rates [rad or m]."""
        return self._units[[0, 1, 2, 3, 4, 5, *(6 + number for number in self._places)]]

    @property
    def independent(self):
        """Numbers of the joints that rates belong to, None without loops."""
        return self._coordinates.independent if self._looped else None

    def velocities(self, coordinates, q, rates, direction):
        """Velocities (all joints,) of a robot with loops at rates (6 + n,), at positions q (all joints,) that close
        them. coordinates: the LoopCoordinates in use, with the quality at q; direction: velocities shortly before, for
        singular positions.
        """

        def velocities(q):
            return [self.loops.joint_velocities(q, self._at_rates(q, rates)[0])]

        if coordinates.quality > SINGULAR_QUALITY:
            return velocities(q)[0]
        return interpolate(velocities, self.loops.neighbours(coordinates, q, direction))[0]

    def initial_velocities(self, coordinates, q, rates):
        """Velocities (all joints,) of a robot with loops that begins at q (all joints,) with rates (6 + n,): those of
        the tangent, as no motion has led there."""
        chart_rates = self.loops.constrained_state(coordinates, q).expand_rates(rates[6:])
        return self.velocities(coordinates, q, rates, self.loops.joint_velocities(q, chart_rates))

    def _at_rates(self, q, rates):
        """`unconstrained`, without efforts, wrenches and gravity of a moving base."""
        return self.unconstrained_accelerations(
            q, rates, NO_GRAVITY, np.zeros(len(q)), [np.zeros(6)] * len(self._links)
        )

    def joint_accelerations(self, q, velocities, rates_derivative):
        """(n,) of Dynamics.joint_names, from those (6 + n,) of the coordinates in use, for a robot with loops."""

        def accelerations(q):
            configuration = self.loops.constrained_state(self._coordinates, q)
            drift = configuration.drift(configuration.expand_rates(velocities[self._places]))
            return configuration.expand_rates(rates_derivative[6:]) + drift

        return self._smooth(accelerations, q)[[*self.loops.default_independent]]

    def set_wrench_links(self, links):
        """Let external wrenches act on the named links."""
        links = tuple(links)
        if links != self._links:
            self._links, self._programs = links, {}
            if not self._looped:
                self._use_program("direct", None)
            elif self._coordinates is not None:
                self.use_coordinates(self._coordinates, self._direction)

    def use_coordinates(self, coordinates, velocities):
        """Take the rates of a robot with loops as those of other coordinates from now on.

        coordinates: LoopCoordinates; velocities: (all joints,), the direction of motion, for singular positions.
        """
        self._coordinates, self._direction = coordinates, velocities
        self._places = list(coordinates.independent)
        self._use_program("state_derivative", coordinates.independent)

    def _use_program(self, model, independent):
        if independent not in self._programs:
            program = self.dynamics.compile(model, wrenches=self._links, independent=independent)
            outputs = [np.empty(shape) for _, shape in program.interface.outputs]
            self._programs[independent] = program, outputs
        self._program, self._outputs = self._programs[independent]

    @property
    def links(self):
        """Names of the links that external wrenches act on, in the order in which `unconstrained` takes them."""
        return self._links

    def unconstrained_accelerations(self, q, rates, gravity, efforts, wrenches):
        """(velocities of the positions q, ν̇ (6 + n,)) where nothing holds a moving base.

        q: as programs take it; gravity: (3,) in the base frame; efforts: (n,), of all joints where the robot has loops;
        wrenches: (6,) for each of `links`. Velocities of a platform's angles are those of the chart of its attitude.
        """
        found, twist = np.zeros(6 + self.size), rates[:6]
        base = () if self.base == "fixed" else (twist, gravity)
        self._program.evaluate(q, rates[6:], efforts, *base, *wrenches, *self._outputs)
        velocities, outputs = rates[6:], self._outputs
        if self._looped:
            velocities, *outputs = outputs
            velocities = velocities.copy()
        found[6:] = outputs[0]
        if base:
            found[:6] = outputs[1]
            found[:3] -= convective_acceleration(twist)
        return velocities, found

    def raise_if_singular(self, q, rates, efforts):
        """Raise SingularModelError where the model has no accelerations at rates (6 + n,) of Dynamics.joint_names."""
        base = {} if self.base == "fixed" else {"base": Base(twist=rates[:6])}
        efforts = efforts[[*self.loops.default_independent]] if self._looped else efforts
        with suppress(InvalidInputError):  # numbers too large, which the caller says
            self.dynamics.direct(q, rates[6:], efforts, **base)

    def velocity_matrix(self, q):
        """G (all joints, n), from the rates of the independent joints to the velocities of all; of a platform's angles
        in the chart of its attitude."""
        return (
            self._smooth(lambda q: self.loops.constrained_state(self._coordinates, q).G, q) if self._looped else self._G
        )

    def _smooth(self, function, q):
        """function(q), an array, also at singular positions of loops."""
        if not self._looped or self._coordinates.quality > SINGULAR_QUALITY:
            return function(q)
        neighbours = self.loops.neighbours(self._coordinates, q, self._direction)
        return interpolate(lambda q: [function(q)], neighbours)[0]

    def inertia_matrix(self, q):
        """A (6 + n, 6 + n), or (n, n) where the base is fixed."""
        if self.independent not in self._inertia:
            program = self.dynamics.compile("inertia_matrix", independent=self.independent)
            self._inertia[self.independent] = program
        return self._smooth(self._inertia[self.independent].evaluate, q)

    def constrain_accelerations(self, q, rates, accelerations, told=None, joints=None):
        """ν̇ (6 + n,) of what is held, from that of `unconstrained` (Gauss's principle of least constraint).

        told: (6,) derivative of the twist that a drive gives the base, as far as wheels can; joints: (n,) accelerations
        that all joints have.

            ν̇ = b + N (Nᵀ A N)⁻¹ Nᵀ A (ν̇_free - b),   C N = 0,   C b = c
        """
        if self._rolling is None and joints is None:
            return accelerations
        if self.base == "fixed":
            return np.concatenate([np.zeros(6), joints])
        N, solver, heard, drift = self._constraint(q, rates, told is not None, joints is not None)
        wanted = [-drift]
        if told is not None:
            wanted.append(told[heard])
        if joints is not None:
            wanted.append(joints)
        given = solver @ np.concatenate(wanted)
        return given + self._response(q, N) @ (self.inertia_matrix(q) @ (accelerations - given))

    def project_onto_constraints(self, q, rates, joints=False):
        """The rates (6 + n,) nearest to these, by their energy, that the constraints allow. joints: whether those of
        the joints stay."""
        if self._rolling is None:
            return rates
        N, solver, _, drift = self._constraint(q, rates, False, joints)
        given = solver @ np.concatenate([np.zeros_like(drift), rates[6:]]) if joints else np.zeros_like(rates)
        return given + self._response(q, N) @ (self.inertia_matrix(q) @ (rates - given))

    def impulse_response(self, q, rates, told=False):
        """(6 + n, 6 + n) what rates change by for unit impulses. told: whether a drive moves the base."""
        if self.base == "fixed":
            found = np.zeros((6 + self.size, 6 + self.size))
            found[6:, 6:] = np.linalg.inv(self.inertia_matrix(q))
            return found
        N = np.eye(6 + self.size) if self._rolling is None else self._constraint(q, rates, told, False)[0]
        return self._response(q, N)

    def _response(self, q, N):
        """N (Nᵀ A N)⁻¹ Nᵀ."""
        return N @ np.linalg.solve(N.T @ self.inertia_matrix(q) @ N, N.T)

    def initial_rates(self, q, rates, has_base_motion):
        """Rates (6 + n,) that the constraints allow, to begin with: where it is said how the base moves (of_base) the
        wheels follow, else the base follows the joints."""
        if self._rolling is None:
            return rates
        C, _ = self._rows(q, rates)
        N = null_space(C)
        wheels = [6 + k for k in range(self.size) if self._places[k] in self._rolling.joints]
        others = [k for k in range(6, 6 + self.size) if k not in wheels]
        asked = [*self._heard(N), *others] if has_base_motion else slice(6, None)
        return N @ np.linalg.lstsq(N[asked], rates[asked], rcond=None)[0]

    def residual(self, q, rates):
        """C ν (m,): velocities [m/s, rad/s] that wheels and plane forbid."""
        return np.zeros(0) if self._rolling is None else self._rows(q, rates)[0] @ rates

    def _rows(self, q, rates):
        """(C (m, 6 + n), Ċ ν (m,))."""
        everyone, G = q if self._looped else self.dynamics.expand_positions(q), self.velocity_matrix(q)
        qd = G @ rates[6:]
        C, turned = self._rolling.constraint_rows(everyone, qd)
        drift = turned @ np.concatenate([rates[:6], qd])
        if self._looped:
            drift = drift + C[:, 6:] @ self._smooth(
                lambda q: self.loops.constrained_state(self._coordinates, q).drift(qd), q
            )
        return np.concatenate([C[:, :6], C[:, 6:] @ G], axis=1), drift

    def _constraint(self, q, rates, told, joints):
        """(N, C⁺, rows of the twist that are told, Ċ ν), kept where they never change."""
        constant = self._rolling is None or (self._rolling.is_constant and not self._looped)
        if constant and (told, joints) in self._known:
            return self._known[told, joints]
        unit = np.eye(6 + self.size)
        C, drift = (unit[:0], np.zeros(0)) if self._rolling is None else self._rows(q, rates)
        heard = self._heard(null_space(C)) if told else []
        C = np.concatenate([C, unit[heard], unit[6:] if joints else unit[:0]])
        U, sizes, V = np.linalg.svd(C)
        rank = int(np.sum(sizes > RANK_TOLERANCE * sizes[0]))
        solver = (V[:rank].T / sizes[:rank]) @ U[:, :rank].T
        found = V[rank:].T, solver, heard, drift
        if constant:
            self._known[told, joints] = found
        return found

    def _heard(self, N):
        """Rows of the twist of the base that can be told independently for rates N u."""
        heard = []
        for row in DRIVE_COMPONENTS:
            if np.linalg.matrix_rank(N[[*heard, row]], tol=RANK_TOLERANCE) > len(heard):
                heard.append(row)
        return heard


def minimum_joint_inertias(robot):
    """(all joints,) about the least inertia that a joint may have to move: everything else free to give way."""
    free = replace(robot, loops=(), platforms=(), joints=tuple(replace(joint, mimic=None) for joint in robot.joints))
    A = inertia_matrix(free, np.array([joint.initial_position for joint in robot.joints]))
    with np.errstate(all="ignore"):
        return 1 / np.diagonal(np.linalg.pinv(A))[len(A) - len(robot.joints) :]


def convective_acceleration(twist):
    """ω × v (3,): what the classical acceleration of the base has beside the derivative of v in the base frame."""
    a, b, c, x, y, z = twist.tolist()
    return np.array([y * c - z * b, z * a - x * c, x * b - y * a])


class FrameKinematics:
    """Where named frames are and how they move: a compiled program.

    independent: numbers of the joints that rates belong to, None for those of Dynamics.
    """

    def __init__(self, dynamics, names, independent=None):
        self._moving = dynamics.robot.moving_base
        program = frames_model(dynamics.robot, names, independent=independent)
        try:
            self._program = compile_program(program)
        except CompilationError:
            self._program = PythonProgram(program)

    def __call__(self, q, rates):
        """Rotations (k, 3, 3), positions (k, 3) and velocities (k, 3) in frame 0."""
        return self._program.evaluate(q, rates[6:], *((rates[:6],) if self._moving else ()))
