"""Series elastic actuators: springs between motors and their links, found in a robot.

A motor q_m moves one end of a spring with a damper; the other end carries the link at y = q_m + δ, where δ = q_s - q₀
is the deflection of the spring. `deflection_solver` computes the motion of the motor from that of the link.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

MAX_TIME_CONSTANT = 5e-3
"""Largest d / k [s] of a spring behind a motor that moves a body."""
AXIS_TOLERANCE = 1e-9
"""Deviation of the axis of a spring from that of its motor [m, or cosine]."""


@dataclass(frozen=True, eq=False)
class SeriesElasticActuators:
    """Springs behind motors, on the same axes.

    Attributes
    ----------
    motors : ndarray, shape (springs,)
        Places of the motors among the joints that get efforts.
    springs : ndarray, shape (springs,)
        Indices of the springs in Dynamics.joint_names.
    stiffness, rest : ndarray, shape (springs,)
        Stiffness k [N m/rad or N/m] and rest position q₀ [rad or m].
    damping : ndarray, shape (springs,)
        Damping d [N m s/rad or N s/m], with the viscous friction of the joints of the springs.
    has_unbranched_motor_links : bool
        Whether the link of each motor carries its spring only.
    is_decoupled : bool
        Whether the transmitted torque τ does not depend on deflections.
    """

    motors: IntArray
    springs: IntArray
    stiffness: Array
    rest: Array
    damping: Array
    has_unbranched_motor_links: bool = True
    is_decoupled: bool = True


def find_series_elastic_actuators(dynamics: Dynamics, joints: Sequence[str]) -> SeriesElasticActuators:
    """The series elastic actuators of a robot whose motors are among the controlled joints.

    Parameters
    ----------
    dynamics : Dynamics
    joints : sequence of str
        Names of the joints that get efforts.

    Returns
    -------
    SeriesElasticActuators

    Raises
    ------
    InvalidInputError
        No motion of a motor gives its link the desired motion, or it cannot be computed: Coulomb friction beside the
        spring, two springs behind one motor, a slow damper behind a motor that moves a body.
    """
    robot = dynamics.robot
    numbers = [number for number in range(len(robot.joints)) if _is_actuator_spring(dynamics, joints, number)]
    motors = [robot.joints[number].antecedent - 1 for number in numbers]
    spring_joints = [robot.joints[number] for number in numbers]
    for joint, motor in zip(spring_joints, motors, strict=True):
        if joint.coulomb_friction or joint.stribeck_friction or joint.viscous_asymmetry:
            kind, effect = "asymmetric viscous", "change its acceleration at once"
            if joint.coulomb_friction or joint.stribeck_friction:
                kind, effect = "Coulomb", "jump"
            raise InvalidInputError(
                f"joint {joint.name!r} has {kind} friction beside its spring: the motor {robot.joints[motor].name!r} "
                f"would have to {effect} where the spring reverses. Give that friction to the motor, or leave the "
                "motor out of the joints that get efforts"
            )
        if motors.count(motor) > 1:
            raise InvalidInputError(
                f"more than one spring is behind the motor {robot.joints[motor].name!r}: it cannot move both links as "
                "desired. Leave it out of the joints that get efforts"
            )
    actuators = _build_actuators(dynamics, joints, motors, numbers)
    slow = np.flatnonzero(actuators.damping > MAX_TIME_CONSTANT * actuators.stiffness)
    if len(slow) and not actuators.is_decoupled:
        joint, motor = spring_joints[slow[0]], robot.joints[motors[slow[0]]]
        time_constant = actuators.damping[slow[0]] / actuators.stiffness[slow[0]]
        raise InvalidInputError(
            f"joint {joint.name!r} has a damper with d / k of {time_constant:.3g} s: where the torques of springs "
            f"depend on their deflections, as with bodies between motors and springs, {MAX_TIME_CONSTANT:g} s at most "
            f"can be compensated. Give the spring less damping, or leave {motor.name!r} out of the joints that get "
            "efforts"
        )
    return actuators


def with_rigid_actuators(robot: Robot, dynamics: Dynamics, actuators: SeriesElasticActuators) -> Robot:
    """The robot with motors in the place of the springs: their efforts are the loads of the springs."""
    names = {dynamics.joint_names[index] for index in actuators.springs}
    joints = [replace(joint, actuated=True, spring=None) if joint.name in names else joint for joint in robot.joints]
    return replace(robot, joints=tuple(joints))


def _build_actuators(
    dynamics: Dynamics, joints: Sequence[str], motors: list[int], spring_numbers: list[int]
) -> SeriesElasticActuators:
    """The actuators of motors and of the joints of their springs, by number."""
    robot = dynamics.robot
    spring_joints = [robot.joints[number] for number in spring_numbers]
    springs = [joint.spring for joint in spring_joints if joint.spring is not None]
    is_unbranched = [_attachment_count(robot, motor + 1) == 1 for motor in motors]
    has_unactuated_joints = len(dynamics.unactuated_joint_names) > len(spring_numbers)
    is_coupled = bool(robot.loops) or robot.moving_base or has_unactuated_joints
    is_unloaded = [_moves_no_inertia(robot, motor, spring_numbers, is_coupled) for motor in motors]
    viscous_friction = [joint.viscous_friction for joint in spring_joints]
    damping = [spring.damping + friction for spring, friction in zip(springs, viscous_friction, strict=True)]
    return SeriesElasticActuators(
        motors=np.array([joints.index(robot.joints[motor].name) for motor in motors], dtype=np.intp),
        springs=np.array([dynamics.joint_names.index(joint.name) for joint in spring_joints], dtype=np.intp),
        stiffness=np.array([spring.stiffness for spring in springs]),
        rest=np.array([spring.rest for spring in springs]),
        damping=np.array(damping),
        has_unbranched_motor_links=all(is_unbranched),
        is_decoupled=all(is_unloaded) and not any(joint.rotor_inertia for joint in spring_joints),
    )


def _is_actuator_spring(dynamics: Dynamics, joints: Collection[str], number: int) -> bool:
    """Whether a joint is a spring on the axis of a controlled motor that carries it."""
    robot = dynamics.robot
    joint = robot.joints[number]
    motor = joint.antecedent - 1
    if joint.role != "elastic" or joint.spring is None or not joint.spring.stiffness:
        return False
    if joint.name not in dynamics.joint_names or motor < 0:
        return False
    return robot.joints[motor].name in joints and _have_same_axis(robot.joints[motor], joint)


def _have_same_axis(motor: Joint, spring: Joint) -> bool:
    R, P = spring.placement[:3, :3], spring.placement[:3, 3]
    offset = 0.0 if motor.prismatic else np.abs(P[:2]).max()
    is_parallel = abs(R[2, 2] - 1) < AXIS_TOLERANCE
    return bool(motor.prismatic == spring.prismatic and is_parallel and offset < AXIS_TOLERANCE)


def _attachment_count(robot: Robot, link: int) -> int:
    """Number of joints attached to a link, with the ends of loops and the mimic joints of its own joint."""
    children = sum(joint.antecedent == link for joint in robot.joints)
    loop_ends = sum(end.link == link for loop in robot.loops for end in loop.ends)
    return children + loop_ends + _mimic_count(robot, link - 1)


def _mimic_count(robot: Robot, number: int) -> int:
    """Number of mimic joints of a joint."""
    name = robot.joints[number].name
    return sum(joint.mimic is not None and joint.mimic.joint == name for joint in robot.joints)


def _moves_no_inertia(robot: Robot, motor: int, spring_numbers: list[int], is_coupled: bool) -> bool:
    """Whether the motion of a motor by itself loads no spring, for the same motion of the links beyond the springs.

    motor: number of its joint; spring_numbers: those of the springs; is_coupled: whether loops, a free base or
    unactuated joints couple all motions. Otherwise a motor loads only the springs that carry it.
    """
    loads_spring = is_coupled
    link = robot.joints[motor].antecedent
    while link and not loads_spring:
        loads_spring = link - 1 in spring_numbers
        link = robot.joints[link - 1].antecedent
    if not loads_spring:
        return not _mimic_count(robot, motor)
    return _attachment_count(robot, motor + 1) == 1 and not np.any(robot.links[motor + 1].inertia.spatial)
