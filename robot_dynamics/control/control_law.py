"""Laws of control: efforts from the state of a robot and from a reference, by its inverse model.

In all of them ID is the inverse model without friction, f the friction of the joints, e = q_d - q, and gains are those
of the error, [1/s²] and [1/s], the same for heavy joints and light ones (Khalil and Dombre, Modeling, Identification
and Control of Robots, section 14.4):

    gravity_compensation  ID(q, 0, 0)
    damping               ID(q, 0, -K_d q̇)
    pd_gravity            ID(q, 0, K_p e + K_d ė)
    feedforward           ID(q_d, q̇_d, q̈_d) + f(q̇_d)
    computed_torque       ID(q, q̇, q̈_d + K_p e + K_d ė) + f(q̇_f)

The velocity of friction q̇_f is that of the reference, q̇_d, or the measured one, q̇. Where the model is right and no
effort is at its limit, computed_torque leaves

    ë + K_d ė + K_p e = A(q)⁻¹ (f(q̇) - f(q̇_f))

A is the mass matrix of the motors: that of all joints with those eliminated that are not actuated, and a base that
moves freely. With the measured velocity the right side is zero; but a measured velocity is never quite zero, and the
sign of Coulomb friction at rest then changes with its noise. With the velocity of the reference the right side does not
chatter, and takes energy: ėᵀ (f(q̇) - f(q̇_d)) <= 0.

Friction of joints without a motor belongs to ID, at the measured velocity, where it decides how unactuated joints move
(passive or elastic ones that are part of the state). Where motors and loops place all joints, it is part of f.

Where a motor drives its link through a spring, the reference is that of the link, and q_d that of the motor which
follows from it (`elastic`); ID takes accelerations of springs from there as well. A is then that of the joints without
springs, and vibration of the springs adds A⁻¹ A_s (q̈_s - q̈_sd) to the right side, A_s their columns of the mass
matrix. Positions of springs that are not measured are those of the reference, without a reference those at rest. A base
and unactuated joints, whose motion is not known ahead, are taken to keep their velocities.
"""

from dataclasses import replace

import numpy as np

from robot_dynamics.control.series_elastic_actuators import (
    DeflectionSolver,
    find_series_elastic_actuators,
    with_rigid_actuators,
)
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError, describe_unknown_name

GRAVITY, FEEDFORWARD, COMPUTED_TORQUE, PD_GRAVITY = (
    "gravity_compensation",
    "feedforward",
    "computed_torque",
    "pd_gravity",
)
MODES = (GRAVITY, FEEDFORWARD, COMPUTED_TORQUE, PD_GRAVITY)
NO_REFERENCE_ACTIONS = ("gravity", "damp", "zero")
TURN = 2 * np.pi
REFERENCE, MEASURED = FRICTION_VELOCITIES = ("reference", "measured")
REST_ITERATIONS = 10  # steps in which the deflections of a robot at rest are found
LIMIT_TOLERANCE = 1e-6  # [rad or m] beyond a limit that is rounding


class ControlLaw:
    """The laws for one robot and those of its joints that get efforts.

    joints: names, in the order of the efforts; those of the robot's other joints that have motors are held by someone
    else, and are not accelerated. The state, (n,) in the order of dynamics.joint_names, is written into `q` and `qd`;
    where the robot has loops, seeds of the joints that they place into `looped`, nan where nothing is known. What a
    moving base does is written into `twist` (6,) and `gravity` (3,), both in the base frame.

    Raises QuestionError for joints that cannot be driven.
    """

    def __init__(self, dynamics, joints):
        self.dynamics, self.joints = dynamics, tuple(joints)
        self.joint_indices = _rows(dynamics, self.joints)
        n, robot = len(dynamics.joint_names), dynamics.robot
        self.q, self.qd = np.zeros(n), np.zeros(n)
        self.dependent_positions = np.full(len(dynamics.dependent_joint_names), np.nan)
        self.twist, self.gravity = np.zeros(6), np.array(robot.gravity)
        self._base = [self.twist, self.gravity] if robot.moving_base else []
        self.elastic_actuators = find_series_elastic_actuators(dynamics, self.joints)
        smooth, rubbing = self._split(robot)
        self._inverse = Dynamics(smooth).compile("inverse")
        self._deflections = self._new_deflections() if len(self.elastic_actuators.springs) else None
        # finite, but no position that a sensor gives: springs of which no state is known
        self._unmeasured = np.nextafter(self.elastic_actuators.rest, np.inf)
        self.q[self.elastic_actuators.springs] = self._unmeasured
        self._efforts, *self._others = [np.zeros(shape) for _, shape in self._inverse.interface.outputs]
        rubs = any(joint.viscous_friction or joint.coulomb_friction for joint in rubbing.joints)
        self._friction = Dynamics(rubbing).compile("friction") if rubs else None
        self._lost = np.zeros(n)
        self._nothing, self._qd_d, self._qdd = np.zeros(n), np.zeros(n), np.zeros(n)
        self._places = {name: k for k, name in enumerate(dynamics.all_joint_names)}
        self._given = [self._places[name] for name in dynamics.joint_names]
        self._placed = [self._places[name] for name in dynamics.dependent_joint_names]
        self._numbers = np.array(self._given) if robot.loops else np.arange(n)  # of the joints, in what programs take
        unactuated = [dynamics.joint_names.index(name) for name in dynamics.unactuated_joint_names]
        self._unactuated = np.setdiff1d(unactuated, self.elastic_actuators.springs).astype(int)
        self._loops, self._all, self._all_d = bool(robot.loops), *np.zeros((2, len(robot.joints)))
        self._all[:] = self._all_d[:] = np.nan
        free = [robot.joints[self._places[name]] for name in self.joints]
        self._limits = np.array([[joint.limits.lower, joint.limits.upper] for joint in free]).reshape(-1, 2).T
        self._turning = np.array([not joint.prismatic for joint in free]) & np.isinf(self._limits).all(axis=0)
        self._turns = bool(self._turning.any())
        self.error, self.rate_error = np.zeros((2, len(self.joints)))

    @property
    def spring_names(self):
        """Names of the springs behind controlled motors; their positions need not be measured."""
        return tuple(self.dynamics.joint_names[number] for number in self.elastic_actuators.springs)

    def _split(self, robot):
        """The robot of the inverse model, and that of the friction which is added to its efforts."""
        springs = set(self.spring_names)
        state = set(self.dynamics.unactuated_joint_names) - springs
        kept = {joint.name for joint in robot.joints if state and not joint.actuated} - springs
        others = {joint.name for joint in robot.joints} - kept
        smooth = with_rigid_actuators(_without_friction(robot, others), self.dynamics, self.elastic_actuators)
        return smooth, _without_friction(robot, kept | springs)

    def _new_deflections(self):
        return DeflectionSolver(self.elastic_actuators, self._link_side, self._spring_loads, len(self.joints))

    def continue_from(self, before):
        """Take over the state from the Law of the same joints that was in use before, as far as both have the same."""
        for old, new in ((before.q, self.q), (before.qd, self.qd), (before.dependent_positions, self.dependent_positions),
                         (before._all, self._all), (before._all_d, self._all_d)):  # fmt: skip
            if len(old) == len(new):
                new[:] = old
        if self.spring_names == before.spring_names:
            springs = self.elastic_actuators.springs
            self.q[springs] = np.where(before.q[springs] == before._unmeasured, self._unmeasured, self.q[springs])
        if self._deflections is not None and before._deflections is not None:
            self._deflections.continue_from(before._deflections)
        if self.dynamics.robot.moving_base:
            self.twist[:], self.gravity[:] = before.twist, before.gravity

    def check_within_limits(self, positions):
        """Refuse positions (N, joints) of points that are beyond the limits of joints. Raises QuestionError."""
        lower, upper = self._limits
        beyond = np.argwhere((positions < lower - LIMIT_TOLERANCE) | (positions > upper + LIMIT_TOLERANCE))
        if len(beyond):
            point, place = beyond[0]
            raise InvalidInputError(
                f"points[{point}].positions has {positions[point, place]:.6g} for {self.joints[place]!r}: the robot's "
                f"description limits it to {lower[place]:.6g} to {upper[place]:.6g}"
            )

    def sample_reference(self, followed, time, reference):
        """Write into reference (3, joints) what the joints should do at a time [s] to follow what is `followed`."""
        if self._deflections is None:
            followed.sample(time, reference)
        else:
            self._deflections.compute_motor_reference(followed, time, reference)
            self._qd_d[self.elastic_actuators.springs] = self._deflections.motion[1]

    def link_motion(self):
        """(2, joints) where the links are that references are of, and how they move.

        Beyond elastic gears that is the motor and the deflection of its spring: as measured, else as a robot at rest
        has it where its motors are.
        """
        here = np.stack([self.q[self.joint_indices], self.qd[self.joint_indices]])
        if self._deflections is None:
            return here
        elastic_actuators = self.elastic_actuators
        measured, motors = (
            self.q[elastic_actuators.springs] != self._unmeasured,
            here[0, elastic_actuators.motors].copy(),
        )
        deflections = np.where(measured, self.q[elastic_actuators.springs] - elastic_actuators.rest, 0.0)
        here[1, elastic_actuators.motors] += np.where(measured, self.qd[elastic_actuators.springs], 0.0)
        samples = np.zeros((1, 3, len(self.joints)))
        for _ in range(0 if measured.all() else REST_ITERATIONS):
            samples[0, 0] = here[0]
            samples[0, 0, elastic_actuators.motors] = motors + deflections
            held = np.zeros((1, 3, len(motors)))
            held[0, 0] = deflections
            loads = self._spring_loads(self._link_side(samples), samples, held)[0]
            deflections = np.where(measured, deflections, -loads / elastic_actuators.stiffness)
        here[0, elastic_actuators.motors] = motors + deflections
        return here

    def gravity_compensation(self, out):
        """Efforts into out: those that hold the robot where it is."""
        self._run(self._positions(), self._nothing, None, out)

    def damping(self, kd, out):
        """Efforts into out: gravity, and braking at the rate kd [1/s]."""
        self._run(self._positions(), self._nothing, -kd * self.qd[self.joint_indices], out)

    def pd_gravity(self, reference, kp, kd, out):
        """Efforts into out for a reference (3, joints): gravity, and gains that see the inertia of the robot."""
        self._compare(reference)
        self._run(self._positions(), self._nothing, kp * self.error + kd * self.rate_error, out)

    def feedforward(self, reference, out):
        """Efforts into out for a reference: those of the motion that it wants, whatever the state is."""
        self._compare(reference)
        q = self.q.copy()
        q[self.joint_indices] = reference[0]
        if self._deflections is not None:
            q[self.elastic_actuators.springs] = self._deflections.motion[0]
        self._wanted(reference)
        self._run(self._closed(q, self._all_d), self._qd_d, reference[2], out, moving=True)
        self._add_friction(out, self._qd_d)

    def computed_torque(self, reference, kp, kd, out, friction_velocity=REFERENCE):
        """Efforts into out for a reference: ë + K_d ė + K_p e = A(q)⁻¹ (f(q̇) - f(q̇_f)) if the model is right.

        friction_velocity: `reference` or `measured`, the velocity q̇_f of which friction is compensated.
        """
        self._compare(reference)
        self._wanted(reference)
        wanted = reference[2] + kp * self.error + kd * self.rate_error
        q, qd = self._with_springs()
        self._run(self._positions(q), qd, wanted, out, moving=True)
        self._add_friction(out, qd if friction_velocity == MEASURED else self._qd_d)

    def _compare(self, reference):
        """Errors of the state from a reference; joints without limits are where they are after whole turns too."""
        np.subtract(reference[0], self.q[self.joint_indices], out=self.error)
        np.subtract(reference[1], self.qd[self.joint_indices], out=self.rate_error)
        if self._turns:
            self.error -= np.where(self._turning, TURN * np.rint(self.error / TURN), 0.0)

    def _wanted(self, reference):
        self._qd_d[self.joint_indices] = reference[1]

    def _with_springs(self):
        """(q, qd) of the state, in which springs that are not measured move as the reference has them."""
        if self._deflections is None:
            return self.q, self.qd
        q, qd, springs, motion = self.q.copy(), self.qd.copy(), self.elastic_actuators.springs, self._deflections.motion
        measured = q[springs] != self._unmeasured
        q[springs] = np.where(measured, q[springs], motion[0])
        qd[springs] = np.where(measured, qd[springs], motion[1])
        return q, qd

    def _positions(self, q=None):
        """What programs take as q at the state, or at q (n,)."""
        q = self.q if q is None else q
        if not self._loops:
            return q
        heard = np.isfinite(self.dependent_positions)
        self._all[self._placed] = np.where(heard, self.dependent_positions, self._all[self._placed])
        return self._closed(q, self._all)

    def _closed(self, q, near):
        """What programs take as q for (n,): where there are loops they are closed from `near`, where that goes on."""
        if not self._loops:
            return q
        near[self._given] = q
        near[:] = self.dynamics.expand_positions(near)
        return near

    def _link_side(self, samples):
        """What programs take as q, one row for each of samples (nodes, 3, joints) of the links; springs are at rest."""
        q = np.tile(self.q, (len(samples), 1))
        q[:, self.joint_indices], q[:, self.elastic_actuators.springs] = samples[:, 0], self.elastic_actuators.rest
        if not self._loops:
            return q
        found = np.empty((len(q), len(self._all_d)))
        for node, positions in enumerate(q):
            # the same positions are closed once: what stands still has no rates then, to the last digit
            same = node and np.array_equal(positions, q[node - 1])
            found[node] = found[node - 1] if same else self._closed(positions, self._all_d)
        return found

    def _spring_loads(self, positions, samples, deflections):
        """(nodes, springs) the rows of the springs in the inverse model, for motions of the links.

        positions: of `_link_side`; samples: (nodes, 3, joints); deflections: (nodes, 3, springs) of the springs, by
        which the motors are behind. Other joints stay where they are, and unactuated ones keep their velocities.
        """
        elastic_actuators, motors, springs = (
            self.elastic_actuators,
            self.joint_indices[self.elastic_actuators.motors],
            self.elastic_actuators.springs,
        )
        rates, accelerations = np.zeros((2, len(samples), len(self.q)))
        rates[:, self._unactuated] = self.qd[self._unactuated]
        rates[:, self.joint_indices], accelerations[:, self.joint_indices] = samples[:, 1], samples[:, 2]
        link_rates = rates.copy()  # those of the passive joints of loops, to the last digit
        positions, places = positions.copy(), self._numbers
        for values, motor, spring, by in ((positions, places[motors], places[springs], deflections[:, 0]),
                                          (rates, motors, springs, deflections[:, 1]),
                                          (accelerations, motors, springs, deflections[:, 2])):  # fmt: skip
            values[:, motor] -= by
            values[:, spring] += by
        if self._loops and not elastic_actuators.has_unbranched_motor_links:
            positions = np.array([self._closed(q[self._given], self._all_d).copy() for q in positions])
            link_rates = rates
        loads = np.empty((len(samples), len(springs)))
        for node, q in enumerate(positions):
            self._inverse.evaluate(q, rates[node], accelerations[node], *self._base, self._efforts, *self._others)
            loads[node] = self._efforts[springs]
            if self._loops and self._friction is not None:
                self._friction.evaluate(q, link_rates[node], self._lost)
                loads[node] += self._lost[springs]
        return loads

    def _run(self, q, qd, accelerations, out=None, moving=False):
        """Efforts into out for accelerations of the joints that get them, None for zero.

        moving: whether springs of gears accelerate as the reference has it.
        """
        self._qdd[self.joint_indices] = 0.0 if accelerations is None else accelerations
        if self._deflections is not None:
            self._qdd[self.elastic_actuators.springs] = self._deflections.motion[2] if moving else 0.0
        self._inverse.evaluate(q, qd, self._qdd, *self._base, self._efforts, *self._others)
        if out is not None:
            np.take(self._efforts, self.joint_indices, out=out, mode="clip")
            self._q = q

    def _add_friction(self, out, rates):
        if self._friction is not None:
            self._friction.evaluate(self._q, rates, self._lost)
            out += self._lost[self.joint_indices]


def _rows(dynamics, joints):
    """Numbers in dynamics.joint_names of the joints that get efforts."""
    places = {name: k for k, name in enumerate(dynamics.joint_names)}
    for name in joints:
        if name not in dynamics.robot.joint_numbers:
            raise InvalidInputError(f"parameter joints: {describe_unknown_name('joint', name, dynamics.joint_names)}")
        if name not in places:
            raise InvalidInputError(f"parameter joints: {name!r} depends on other joints: leave it out")
        if name in dynamics.unactuated_joint_names:
            raise InvalidInputError(f"parameter joints: no motor drives {name!r}: leave it out")
    if len(set(joints)) < len(joints):
        raise InvalidInputError("parameter joints: a joint is named more than once")
    if not joints:
        raise RobotDynamicsError(f"{dynamics.robot.name!r} has no joint with a motor: there is nothing to control")
    return np.array([places[name] for name in joints], dtype=int)


def actuated_joint_names(dynamics):
    """Names of the joints that have motors, in the order of the description."""
    return tuple(name for name in dynamics.joint_names if name not in dynamics.unactuated_joint_names)


def _without_friction(robot, names):
    """The robot in which some joints have no friction."""
    joints = [
        replace(joint, viscous_friction=0.0, coulomb_friction=0.0) if joint.name in names else joint
        for joint in robot.joints
    ]
    return replace(robot, joints=tuple(joints))
