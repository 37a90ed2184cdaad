"""Elastic gears: a reference of the link beyond a motor and its spring, turned into one of the motor.

A motor q_m moves one end of a spring with a damper; the other end carries the link at y = q_m + δ, where δ = q_s - q₀
is the deflection of the spring. Spring and damper transmit what the link needs:

    d δ̇ + k δ = τ,    τ = -(row of the spring in the inverse dynamics of the robot, spring and damper left out)

τ follows from the motion (y, ẏ, ÿ) of the links, and, where the bodies between motors and springs have inertia, from
(δ, δ̇, δ̈) too. The motor then moves as q_m = y - δ. The position q₀ of the spring at rest is counted to the link: with
the gear unloaded motor and reference agree. Source: the inverse model of elastic joints of Khalil, section 6, for a
motion of the links.

The solution of the equation is the sum of two parts. Where τ is the polynomial p through its values at NODES around a
time, one part is the polynomial σ with d σ̇ + k σ = p, which solves it exactly. The other, c exp(-k t / d), is the
memory of the damper: it keeps δ continuous where the reference changes its law or is replaced. It is the only state,
and is forgotten after some multiples of d / k. Where d / k is less than SPACING it is left out: efforts at some kHz
cannot follow it. Where τ depends on δ, its rate would be another than k / d; dampers for which it counts, those with
d / k above LONGEST, are refused there.
"""

from dataclasses import dataclass, replace

import numpy as np

from robot_dynamics.control.reference import ReferencePoint
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError

NODE_SPACING = 2e-3  # [s] between two nodes; a jump of the derivative of τ is spread over all of them
NODES = np.arange(-3, 4)  # of the polynomial around a time, in SPACING
SOLUTION_STEP = 3 * NODE_SPACING  # [s] for which a polynomial is used
MEMORY_TIME_CONSTANTS = 30.0  # multiples of d / k after which nothing is left of a deflection
MAX_HISTORY_STEPS = 250  # through the past of a reference that begins to be followed in the midst of its motion
NEGLIGIBLE_DEFLECTION = 1e-12  # part of a deflection
MAX_TIME_CONSTANT = 5e-3  # d / k [s] of a spring behind a motor that moves a body
MAX_ITERATIONS = 10  # through the nodes, where τ depends on the deflections
CONVERGENCE_TOLERANCE = 1e-8  # part of the deflections that a pass may still change; the next one changes less
DIVERGENCE_THRESHOLD = 1e-2  # part that the last pass may change: more is no solution
AXIS_TOLERANCE = 1e-9  # how far the axes of a motor and of its spring may be from each other


@dataclass(frozen=True, eq=False)
class SeriesElasticActuators:
    """Springs behind motors, the same axis for both.

    motors: their places among the joints that get efforts; springs: numbers in dynamics.joint_names; stiffness, rest,
    damping: of the springs, viscous friction of their joints counted in the damping. plain: whether nothing but the
    spring is attached to the link of each motor; light: whether τ does not depend on deflections.
    """

    motors: np.ndarray
    springs: np.ndarray
    stiffness: np.ndarray
    rest: np.ndarray
    damping: np.ndarray
    has_unbranched_motor_links: bool = True
    is_decoupled: bool = True


def find_series_elastic_actuators(dynamics, joints):
    """The Gears of a robot that lie behind those of its motors that are controlled.

    Raises QuestionError where no motion of a motor moves the link as wanted, or it cannot be computed: Coulomb friction
    beside the spring, two springs behind one motor, a slow damper behind a motor that moves a body.
    """
    robot = dynamics.robot
    numbers = [number for number, joint in enumerate(robot.joints) if _is_gear(dynamics, joints, number)]
    motors = [robot.joints[number].antecedent - 1 for number in numbers]
    elastic = [robot.joints[number] for number in numbers]
    for joint, motor in zip(elastic, motors, strict=True):
        if joint.coulomb_friction:
            raise InvalidInputError(
                f"joint {joint.name!r} has Coulomb friction beside its spring: the motor {robot.joints[motor].name!r} "
                "would have to jump where the spring reverses. Give that friction to the motor, or leave the motor out "
                "of the joints that get efforts"
            )
        if motors.count(motor) > 1:
            raise InvalidInputError(
                f"more than one spring is behind the motor {robot.joints[motor].name!r}: it cannot move the links of "
                "both as wanted. Leave it out of the joints that get efforts"
            )
    elastic_actuators = _gears(dynamics, joints, motors, numbers)
    slow = np.flatnonzero(elastic_actuators.damping > MAX_TIME_CONSTANT * elastic_actuators.stiffness)
    if len(slow) and not elastic_actuators.is_decoupled:
        joint, motor = elastic[slow[0]], robot.joints[motors[slow[0]]]
        raise InvalidInputError(
            f"joint {joint.name!r} has a damper with d / k of {elastic_actuators.damping[slow[0]] / joint.spring.stiffness:.3g} s: "
            "where what springs transmit depends on their deflections, as of bodies between motors and springs, "
            f"{MAX_TIME_CONSTANT:g} s at most can be compensated. Give the spring less damping, or leave {motor.name!r} out of "
            "the joints that get efforts"
        )
    return elastic_actuators


def _gears(dynamics, joints, motors, numbers):
    """The Gears of motors and of their elastic joints, by number."""
    robot = dynamics.robot
    elastic = [robot.joints[number] for number in numbers]
    springs = [joint.spring for joint in elastic]
    alone = [_attached(robot, motor + 1) == 1 for motor in motors]
    reacts = robot.loops or robot.moving_base or len(dynamics.unactuated_joint_names) > len(numbers)
    still = [_moves_nothing(robot, motor, numbers, reacts) for motor in motors]
    return SeriesElasticActuators(
        np.array([joints.index(robot.joints[motor].name) for motor in motors], dtype=int),
        np.array([dynamics.joint_names.index(joint.name) for joint in elastic], dtype=int),
        np.array([spring.stiffness for spring in springs]),
        np.array([spring.rest for spring in springs]),
        np.array([joint.spring.damping + joint.viscous_friction for joint in elastic]),
        all(alone),
        all(still) and not any(joint.rotor_inertia for joint in elastic),
    )


def _is_gear(dynamics, joints, number):
    robot, joint = dynamics.robot, dynamics.robot.joints[number]
    motor = joint.antecedent - 1
    if joint.role != "elastic" or joint.name not in dynamics.joint_names or motor < 0 or not joint.spring.stiffness:
        return False
    return robot.joints[motor].name in joints and _same_axis(robot.joints[motor], joint)


def _same_axis(motor, spring):
    R, P = spring.placement[:3, :3], spring.placement[:3, 3]
    off = 0.0 if motor.prismatic else np.abs(P[:2]).max()
    return motor.prismatic == spring.prismatic and abs(R[2, 2] - 1) < AXIS_TOLERANCE and off < AXIS_TOLERANCE


def _attached(robot, link):
    """How many joints are attached to a link, ends of loops and joints that follow its own joint counted too."""
    children = sum(joint.antecedent == link for joint in robot.joints)
    ends = sum(end.link == link for loop in robot.loops for end in loop.ends)
    return children + ends + _followers(robot, link - 1)


def _followers(robot, number):
    name = robot.joints[number].name
    return sum(joint.mimic is not None and joint.mimic.joint == name for joint in robot.joints)


def _moves_nothing(robot, motor, springs, reacts):
    """Whether no spring feels how a motor moves in itself, the links beyond the springs moving as they do.

    motor: number of its joint; springs: those of the springs. reacts: whether what moves somewhere moves all else, by
    loops, a free base or unactuated joints; else a spring feels what is beyond it alone.
    """
    link, beyond = robot.joints[motor].antecedent, bool(reacts)
    while link and not beyond:
        beyond = link - 1 in springs
        link = robot.joints[link - 1].antecedent
    if not beyond:
        return not _followers(robot, motor)
    return _attached(robot, motor + 1) == 1 and not np.any(robot.links[motor + 1].inertia.spatial)


def with_rigid_actuators(robot, dynamics, elastic_actuators):
    """The robot in which the springs of gears are joints with motors: their efforts are what the springs must bear."""
    names = {dynamics.joint_names[number] for number in elastic_actuators.springs}
    joints = [replace(joint, actuated=True, spring=None) if joint.name in names else joint for joint in robot.joints]
    return replace(robot, joints=tuple(joints))


class DeflectionSolver:
    """What the springs do while the links move as wanted: `motion` (3, springs), positions, velocities, accelerations.

    place: a function of samples (nodes, 3, joints) of the reference of the links that gives positions of the robot,
    with springs at rest, one row a node. load: a function of such positions, of the samples, and of deflections with
    their derivatives (nodes, 3, springs), that gives -τ (nodes, springs).
    """

    def __init__(self, elastic_actuators, place, load, joints):
        count = len(elastic_actuators.springs)
        self._gears, self._place, self._load = elastic_actuators, place, load
        self._samples = np.zeros((len(NODES), 3, joints))
        self._near = np.zeros((len(NODES), 3, count))
        lasts = (
            elastic_actuators.damping / elastic_actuators.stiffness
        )  # [s] in which the part of the damper falls to 1 / e
        self._solution = _solution(elastic_actuators.stiffness, lasts)
        self._lasts = np.where(elastic_actuators.is_decoupled & (lasts > NODE_SPACING), lasts, 0.0)
        self._time, self._deflection = None, np.zeros(count)
        self.motion = np.zeros((3, count))

    def continue_from(self, before):
        """Take over the deflections from those of the same springs that were in use before."""
        if len(before._deflection) == len(self._deflection):
            self._time, self._deflection[:] = before._time, before._deflection

    def compute_motor_reference(self, followed, time, reference):
        """Write into reference (3, joints) what the motors should do, that the links do as `followed` says.

        Raises RobotDynamicsError where there is no such motion.
        """
        self._go_to(followed, time)
        self._solve(followed, time)
        self.motion[:] = self._near[CENTRE]
        self._time, self._deflection[:] = time, self.motion[0]
        np.copyto(reference, self._samples[CENTRE])
        reference[:, self._gears.motors] -= self.motion
        self.motion[0] += self._gears.rest

    def _go_to(self, followed, time):
        """Solve the equation until less than a STRIDE before a time, where dampers have a memory."""
        reach = MEMORY_TIME_CONSTANTS * self._lasts.max()
        if not reach:
            self._time = None
            return
        if self._time is None or not time - reach <= self._time <= time:
            past = time - min(reach, MAX_HISTORY_STEPS * SOLUTION_STEP)
            start = min(max(getattr(followed, "start", past), past), time)
            self._time = None
            self._solve(followed, start)
            self._time, self._deflection[:] = start, -self._loads[CENTRE] / self._gears.stiffness
        while time - self._time > SOLUTION_STEP:
            now = self._time + SOLUTION_STEP
            self._solve(followed, now)
            self._time, self._deflection[:] = now, self._near[CENTRE, 0]

    def _solve(self, followed, time):
        """Write deflections and their derivatives at the nodes around a time into _near, from what they were before.

        Raises RobotDynamicsError where passes through the nodes, each with the loads of the last one, do not settle.
        """
        self._sample(followed, time)
        positions, near = self._place(self._samples), self._near
        near[:] = 0.0
        for _ in range(1 if self._gears.is_decoupled else MAX_ITERATIONS):
            before = near[:, 0].copy()
            self._loads = self._load(positions, self._samples, near)
            coefficients = self._slow_part(self._loads)
            near[:] = np.swapaxes(DERIVATIVES @ coefficients, 0, 1)
            near += self._damper_part(coefficients, time)
            change, most = np.abs(near[:, 0] - before).max(), np.abs(near[:, 0]).max()
            if change <= CONVERGENCE_TOLERANCE * most:
                return
        if not (self._gears.is_decoupled or change <= DIVERGENCE_THRESHOLD * most):
            stiffness = ", ".join(f"{k:g}" for k in self._gears.stiffness)
            raise RobotDynamicsError(
                "the deflections of the elastic gears cannot be computed: for what moves between the motors and the "
                f"springs these are too soft (stiffness {stiffness}). Leave their motors out of the joints that get "
                "efforts, or use a mode without a reference"
            )

    def _slow_part(self, loads):
        """(powers, springs) coefficients of σ, of powers of (t - time) / SPACING, for loads (nodes, springs)."""
        # differences from the middle: at rest the rates are zero to the last digit, as friction has a sign
        coefficients = (self._solution @ (loads[CENTRE] - loads).T[..., None])[..., 0].T
        coefficients[0] -= loads[CENTRE] / self._gears.stiffness
        return coefficients

    def _damper_part(self, coefficients, time):
        """(nodes, 3, springs) what is left around a time of the difference between δ and σ before."""
        if self._time is None:
            return 0.0
        since = self._time - time
        with np.errstate(all="ignore"):
            left = (self._deflection - (since / NODE_SPACING) ** POWERS @ coefficients) * np.exp(since / self._lasts)
            left[~((self._lasts > 0) & (np.abs(left) > NEGLIGIBLE_DEFLECTION * np.abs(coefficients[0])))] = 0.0
            rates = np.where(left != 0.0, -1.0 / self._lasts, 0.0)
        return left * np.exp(rates * NODE_TIMES[:, None, None]) * rates ** np.arange(3)[:, None]

    def _sample(self, followed, time):
        """Write the samples of the reference at the nodes around a time."""
        if not isinstance(followed, ReferencePoint):
            for since, sample in zip(NODE_TIMES, self._samples, strict=True):
                followed.sample(time + since, sample)
            return
        centre = np.empty_like(self._samples[CENTRE])  # the point before is not known any more: this one goes on
        followed.sample(time, centre)
        since = NODE_TIMES[:, None]
        self._samples[:, 0] = centre[0] + since * centre[1] + 0.5 * since**2 * centre[2]
        self._samples[:, 1] = centre[1] + since * centre[2]
        self._samples[:, 2] = centre[2]


def _solution(stiffness, lasts):
    """(springs, powers, nodes) from the differences of τ at the nodes from the middle one to the coefficients of σ."""
    polynomial = np.linalg.inv(NODES[:, None] ** POWERS.astype(float))
    derivative = np.diag(POWERS[1:], 1)
    slow = np.linalg.inv(np.eye(len(POWERS)) + lasts[:, None, None] / NODE_SPACING * derivative)
    return slow @ polynomial / stiffness[:, None, None]


CENTRE = len(NODES) // 2
NODE_TIMES = NODES * NODE_SPACING
POWERS = np.arange(len(NODES))
DERIVATIVES = np.stack(
    [
        np.where(POWERS >= d, NODES[:, None] ** np.maximum(POWERS - d, 0.0), 0.0)
        * np.array([np.prod(np.arange(power, power - d, -1), initial=1.0) for power in POWERS])
        / NODE_SPACING**d
        for d in range(3)
    ]
)  # (3, nodes, powers) from coefficients to values, first and second derivatives at the nodes
