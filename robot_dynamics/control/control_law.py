"""Control laws: efforts from the state of a robot and a reference, by its inverse model.

In all of them ID is the inverse model without friction, f the friction of the joints, e = q_d - q, and gains are those
of the error, [1/s²] and [1/s], the same for heavy and light joints (Khalil and Dombre, Modeling, Identification and
Control of Robots, section 14.4):

    gravity_compensation  ID(q, 0, 0)
    damping               ID(q, 0, -K_d q̇)
    pd_gravity            ID(q, 0, K_p e + K_d ė)
    feedforward           ID(q_d, q̇_d, q̈_d) + f(q̇_d)
    computed_torque       ID(q, q̇, q̈_d + K_p e + K_d ė) + f(q̇_f)
    adaptive_computed_torque  of `adaptive_law`

The velocity of friction q̇_f is that of the reference, q̇_d, or the measured one, q̇. If the model is exact and no effort
is at its limit, computed_torque leaves

    ë + K_d ė + K_p e = A(q)⁻¹ (f(q̇) - f(q̇_f))

A is the mass matrix of the controlled joints, with unactuated joints and a base that moves freely eliminated. With the
measured velocity the right side is zero. But a measured velocity is never exactly zero, and the sign of Coulomb
friction at rest then changes with its noise. With the velocity of the reference the right side does not chatter, and
dissipates energy: ėᵀ (f(q̇) - f(q̇_d)) <= 0.

Friction that depends on the load of a joint has the effort ID of that joint as its load.

Friction of unactuated joints that are part of the state (passive or elastic ones) belongs to ID, at the measured
velocity, because it determines their motion. Where motors and loops determine the motion of all joints, it is part of
f.

Where a motor drives its link through a spring, the reference is that of the link. q_d is then the position of the
motor that follows from it (`deflection_solver`), and so are the accelerations of springs in ID. A is then that of the
joints without springs. Vibration of the springs adds A⁻¹ A_s (q̈_s - q̈_sd) to the right side, where A_s are their
columns of the mass matrix. Positions of springs that are not measured are those of the reference, or those at rest
without a reference. A base and unactuated joints, whose future motion is unknown, are assumed to keep their velocities.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.adaptive_law import AdaptiveLaw
from robot_dynamics.control.law_models import LawModels
from robot_dynamics.control.link_side import LinkSide
from robot_dynamics.control.modes import MEASURED, REFERENCE
from robot_dynamics.control.program_positions import ProgramPositions
from robot_dynamics.control.series_elastic_actuators import find_series_elastic_actuators
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError, describe_unknown_name
from robot_dynamics.newton_euler.friction import load_friction

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray, IntArray
    from robot_dynamics.control.modes import FrictionVelocity
    from robot_dynamics.control.natural_adaptation import AdaptationLimits
    from robot_dynamics.control.reference import Reference
    from robot_dynamics.dynamics import Dynamics


TURN = 2 * np.pi
LIMIT_TOLERANCE = 1e-6
"""Rounding [rad or m] by which a reference may exceed the limit of a joint."""


class ControlLaw:
    """The control laws of one robot.

    Parameters
    ----------
    dynamics : Dynamics
    joints : sequence of str
        Names of the joints that get efforts, in the order of the efforts. Other actuated joints are held by another
        controller, and do not accelerate.
    adaptation : AdaptationLimits, optional
        Prepares adaptive_computed_torque with these limits. Default: it is not available.

    Attributes
    ----------
    dynamics : Dynamics
    joints : tuple of str
    joint_indices : ndarray, shape (joints,)
        Indices of the joints in Dynamics.joint_names.
    q, qd : ndarray, shape (n,)
        The state of Dynamics.joint_names [rad or m; rad/s or m/s]. The caller writes it into these buffers.
    dependent_positions : ndarray, shape (dependent joints,)
        Measured positions of the dependent joints of loops, a buffer to write into; nan where they are unknown.
    twist, gravity : ndarray, shape (6,) and (3,)
        Twist of a moving base and gravity, both in the base frame, buffers to write into.
    elastic_actuators : SeriesElasticActuators
    adaptive : AdaptiveLaw or None
        The adaptive law with its parameters.
    error, rate_error : ndarray, shape (joints,)
        Errors e and ė of the last call with a reference.

    Raises
    ------
    InvalidInputError
        A joint is unknown, dependent, unactuated or named twice, or the spring behind it cannot be compensated;
        or the robot cannot be adapted.
    RobotDynamicsError
        There are no joints.
    """

    def __init__(self, dynamics: Dynamics, joints: Sequence[str], adaptation: AdaptationLimits | None = None) -> None:
        robot = dynamics.robot
        self.dynamics = dynamics
        self.joints = tuple(joints)
        self.joint_indices = _find_joint_indices(dynamics, self.joints)
        self.adaptive = None if adaptation is None else AdaptiveLaw(dynamics, self.joint_indices, adaptation)
        joint_count = len(dynamics.joint_names)
        self.q = np.zeros(joint_count)
        self.qd = np.zeros(joint_count)
        self.dependent_positions = np.full(len(dynamics.dependent_joint_names), np.nan)
        self.twist = np.zeros(6)
        self.gravity: Array = np.array(robot.gravity)
        self.error = np.zeros(len(self.joints))
        self.rate_error = np.zeros(len(self.joints))
        self.elastic_actuators = find_series_elastic_actuators(dynamics, self.joints)
        base_state = [self.twist, self.gravity] if robot.moving_base else []
        joints_with_effort = [robot.joints[robot.joint_numbers[name]] for name in self.joints]
        has_load_friction = any(joint.load_friction for joint in joints_with_effort)
        self._load_friction_joints = joints_with_effort if has_load_friction else None
        self._models = LawModels(dynamics, self.elastic_actuators, base_state)
        self._positions = ProgramPositions(dynamics)
        self._link_side: LinkSide | None = None
        if len(self.elastic_actuators.springs):
            self._link_side = LinkSide(
                dynamics, self.joint_indices, self.elastic_actuators, self._models, self._positions, self.q, self.qd
            )
        # springs without a measured state have a finite position that no sensor gives
        self._unmeasured = np.nextafter(self.elastic_actuators.rest, np.inf)
        self.q[self.elastic_actuators.springs] = self._unmeasured
        self._rest_velocities = np.zeros(joint_count)
        self._reference_velocities = np.zeros(joint_count)
        self._accelerations = np.zeros(joint_count)
        controlled = [robot.joints[robot.joint_numbers[name]] for name in self.joints]
        limits = np.array([[joint.limits.lower, joint.limits.upper] for joint in controlled]).reshape(-1, 2)
        self._lower_limits, self._upper_limits = limits.T
        is_unlimited = np.isinf(limits).all(axis=1)
        self._turns_endlessly: BoolArray = np.array([not joint.prismatic for joint in controlled]) & is_unlimited
        self._has_endless_joints = bool(self._turns_endlessly.any())

    @property
    def spring_names(self) -> tuple[str, ...]:
        """Names of the springs behind controlled motors; their positions need not be measured."""
        return tuple(self.dynamics.joint_names[index] for index in self.elastic_actuators.springs)

    def continue_from(self, before: ControlLaw) -> None:
        """Take over the state of the law that was in use before, as far as both have the same joints.

        Parameters
        ----------
        before : ControlLaw
            A law of the same controlled joints.
        """
        _copy_if_same_length(before.q, self.q)
        _copy_if_same_length(before.qd, self.qd)
        _copy_if_same_length(before.dependent_positions, self.dependent_positions)
        self._positions.continue_from(before._positions)
        if self.spring_names == before.spring_names:
            springs = self.elastic_actuators.springs
            self.q[springs] = np.where(before.q[springs] == before._unmeasured, self._unmeasured, self.q[springs])
        if self._link_side is not None and before._link_side is not None:
            self._link_side.solver.continue_from(before._link_side.solver)
        if self.dynamics.robot.moving_base:
            self.twist[:] = before.twist
            self.gravity[:] = before.gravity

    def check_within_limits(self, positions: ArrayLike) -> None:
        """Check that reference positions are within the limits of the joints.

        Parameters
        ----------
        positions : array_like, shape (N, joints)
            [rad or m]

        Raises
        ------
        InvalidInputError
            A position exceeds a limit.
        """
        positions = np.asarray(positions)
        lower, upper = self._lower_limits, self._upper_limits
        outside = np.argwhere((positions < lower - LIMIT_TOLERANCE) | (positions > upper + LIMIT_TOLERANCE))
        if len(outside):
            point, joint = outside[0]
            raise InvalidInputError(
                f"points[{point}].positions has {positions[point, joint]:.6g} for {self.joints[joint]!r}: the robot's "
                f"description limits it to {lower[joint]:.6g} to {upper[joint]:.6g}"
            )

    def clip_to_limits(self, positions: Array) -> Array:
        """Return positions (joints,) [rad or m], or the nearest ones within the limits of the joints."""
        return np.clip(positions, self._lower_limits, self._upper_limits)

    def sample_reference(self, source: Reference, time: float, out: Array) -> None:
        """Sample a reference of the links as one of the controlled joints.

        Parameters
        ----------
        source : Reference
            Trajectory or ReferencePoint of the links.
        time : float
            [s]
        out : ndarray, shape (3, joints)
            Positions, velocities and accelerations of the controlled joints, written.

        Raises
        ------
        RobotDynamicsError
            No motion of a motor gives its link the desired motion.
        """
        if self._link_side is None:
            source.sample(time, out)
        else:
            solver = self._link_side.solver
            solver.compute_motor_reference(source, time, out)
            self._reference_velocities[self.elastic_actuators.springs] = solver.motion[1]

    def link_motion(self) -> Array:
        """Positions and velocities of the links that references are given for.

        Returns
        -------
        ndarray, shape (2, joints)
            Beyond elastic gears those of the motor plus the deflection of its spring; where it is not measured, that of
            a robot at rest at the positions of its motors.
        """
        if self._link_side is None:
            return np.stack([self.q[self.joint_indices], self.qd[self.joint_indices]])
        return self._link_side.link_motion(self._measured_springs(self.q))

    def gravity_compensation(self, out: Array) -> None:
        """Efforts that hold the robot at its position.

        Parameters
        ----------
        out : ndarray, shape (joints,)
            Efforts [N m or N], written.
        """
        self._write_efforts(self._measured_positions(self.q), self._rest_velocities, 0.0, out)

    def damping(self, kd: Array | float, out: Array) -> None:
        """Efforts that compensate gravity and brake the robot.

        Parameters
        ----------
        kd : ndarray, shape (joints,), or float
            Rate at which velocities decay [1/s].
        out : ndarray, shape (joints,)
            Efforts [N m or N], written.
        """
        accelerations = -kd * self.qd[self.joint_indices]
        self._write_efforts(self._measured_positions(self.q), self._rest_velocities, accelerations, out)

    def pd_gravity(self, reference: Array, kp: Array | float, kd: Array | float, out: Array) -> None:
        """Efforts that compensate gravity and correct the error, with gains weighted by the inertia of the robot.

        Parameters
        ----------
        reference : ndarray, shape (3, joints)
            Positions, velocities and accelerations of the controlled joints.
        kp, kd : ndarray, shape (joints,), or float
            Gains [1/s²] and [1/s].
        out : ndarray, shape (joints,)
            Efforts [N m or N], written.
        """
        self._compute_errors(reference)
        accelerations = kp * self.error + kd * self.rate_error
        self._write_efforts(self._measured_positions(self.q), self._rest_velocities, accelerations, out)

    def feedforward(self, reference: Array, out: Array) -> None:
        """Efforts of the reference motion, whatever the state is.

        Parameters
        ----------
        reference : ndarray, shape (3, joints)
            Positions, velocities and accelerations of the controlled joints.
        out : ndarray, shape (joints,)
            Efforts [N m or N], written.
        """
        self._compute_errors(reference)
        q = self.q.copy()
        q[self.joint_indices] = reference[0]
        if self._link_side is not None:
            q[self.elastic_actuators.springs] = self._link_side.solver.motion[0]
        velocities = self._reference_velocities
        velocities[self.joint_indices] = reference[1]
        positions = self._positions.at_reference(q)
        self._write_efforts(positions, velocities, reference[2], out, springs_accelerate=True)
        self._add_friction(positions, velocities, out)

    def computed_torque(
        self,
        reference: Array,
        kp: Array | float,
        kd: Array | float,
        out: Array,
        friction_velocity: FrictionVelocity = REFERENCE,
    ) -> None:
        """Efforts that linearize the dynamics: ë + K_d ė + K_p e = A(q)⁻¹ (f(q̇) - f(q̇_f)) if the model is exact.

        Parameters
        ----------
        reference : ndarray, shape (3, joints)
            Positions, velocities and accelerations of the controlled joints.
        kp, kd : ndarray, shape (joints,), or float
            Gains [1/s²] and [1/s].
        out : ndarray, shape (joints,)
            Efforts [N m or N], written.
        friction_velocity : {"reference", "measured"}
            The velocity q̇_f at which friction is compensated.
        """
        self._compute_errors(reference)
        self._reference_velocities[self.joint_indices] = reference[1]
        accelerations = reference[2] + kp * self.error + kd * self.rate_error
        q, qd = self._state_with_springs()
        positions = self._measured_positions(q)
        self._write_efforts(positions, qd, accelerations, out, springs_accelerate=True)
        self._add_friction(positions, qd if friction_velocity == MEASURED else self._reference_velocities, out)

    def adaptive_computed_torque(self, reference: Array, kp: Array | float, kd: Array | float, out: Array) -> None:
        """Efforts of the adaptive law, with the present parameters.

        Parameters
        ----------
        reference : ndarray, shape (3, joints)
            Positions, velocities and accelerations of the controlled joints.
        kp, kd : ndarray, shape (joints,), or float
            Gains [1/s²] and [1/s], the latter above zero.
        out : ndarray, shape (joints,)
            Efforts [N m or N], written.
        """
        assert self.adaptive is not None, "the mode is refused without it"
        self._compute_errors(reference)
        self._reference_velocities[self.joint_indices] = reference[1]
        positions = self._measured_positions(self.q)
        self.adaptive.efforts(positions, self.qd, reference, (self.error, self.rate_error), kp, kd, out)
        self._add_friction(positions, self._reference_velocities, out)

    def _compute_errors(self, reference: Array) -> None:
        """Errors of the state from a reference (3, joints), without whole turns of joints that turn endlessly."""
        np.subtract(reference[0], self.q[self.joint_indices], out=self.error)
        np.subtract(reference[1], self.qd[self.joint_indices], out=self.rate_error)
        if self._has_endless_joints:
            self.error -= np.where(self._turns_endlessly, TURN * np.rint(self.error / TURN), 0.0)

    def _measured_springs(self, q: Array) -> BoolArray:
        """Whether the position of each spring is measured (springs,)."""
        is_measured: BoolArray = q[self.elastic_actuators.springs] != self._unmeasured
        return is_measured

    def _state_with_springs(self) -> tuple[Array, Array]:
        """Positions and velocities (n,) of the state; springs that are not measured move as in the reference."""
        if self._link_side is None:
            return self.q, self.qd
        springs, motion = self.elastic_actuators.springs, self._link_side.solver.motion
        q, qd = self.q.copy(), self.qd.copy()
        is_measured = self._measured_springs(q)
        q[springs] = np.where(is_measured, q[springs], motion[0])
        qd[springs] = np.where(is_measured, qd[springs], motion[1])
        return q, qd

    def _measured_positions(self, q: Array) -> Array:
        """Program positions at measured positions q (n,)."""
        return self._positions.at_state(q, self.dependent_positions)

    def _write_efforts(
        self,
        positions: Array,
        velocities: Array,
        accelerations: Array | float,
        out: Array,
        springs_accelerate: bool = False,
    ) -> None:
        """Write the efforts for accelerations (joints,) of the controlled joints.

        positions: program positions; velocities: (n,); springs_accelerate: whether springs accelerate as in the
        reference.
        """
        self._accelerations[self.joint_indices] = accelerations
        if self._link_side is not None:
            springs = self.elastic_actuators.springs
            self._accelerations[springs] = self._link_side.solver.motion[2] if springs_accelerate else 0.0
        efforts = self._models.inverse(positions, velocities, self._accelerations)
        np.take(efforts, self.joint_indices, out=out, mode="clip")

    def _add_friction(self, positions: Array, velocities: Array, out: Array) -> None:
        """Add friction at velocities (n,) to the efforts without friction."""
        if self._load_friction_joints is not None:
            out += load_friction(self._load_friction_joints, velocities[self.joint_indices], out)
        friction = self._models.friction(positions, velocities)
        if friction is not None:
            out += friction[self.joint_indices]


def actuated_joint_names(dynamics: Dynamics) -> tuple[str, ...]:
    """Names of the actuated joints, in the order of the description."""
    return tuple(name for name in dynamics.joint_names if name not in dynamics.unactuated_joint_names)


def _find_joint_indices(dynamics: Dynamics, joints: Sequence[str]) -> IntArray:
    """Indices in Dynamics.joint_names of the joints that get efforts, checked."""
    indices = {name: index for index, name in enumerate(dynamics.joint_names)}
    for name in joints:
        if name not in dynamics.robot.joint_numbers:
            raise InvalidInputError(f"parameter joints: {describe_unknown_name('joint', name, dynamics.joint_names)}")
        if name not in indices:
            raise InvalidInputError(f"parameter joints: {name!r} depends on other joints: leave it out")
        if name in dynamics.unactuated_joint_names:
            raise InvalidInputError(f"parameter joints: {name!r} has no motor: leave it out")
    if len(set(joints)) < len(joints):
        raise InvalidInputError("parameter joints: a joint is named more than once")
    if not joints:
        raise RobotDynamicsError(f"{dynamics.robot.name!r} has no actuated joint: there is nothing to control")
    return np.array([indices[name] for name in joints], dtype=np.intp)


def _copy_if_same_length(source: Array, target: Array) -> None:
    if len(source) == len(target):
        target[:] = source
