"""Compiled models of the control laws: inverse dynamics and the friction that is compensated apart from it."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.control.series_elastic_actuators import with_rigid_actuators
from robot_dynamics.dynamics import Dynamics

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.control.series_elastic_actuators import SeriesElasticActuators
    from robot_dynamics.model.robot import Robot


class LawModels:
    """The inverse model, with springs of series elastic actuators as motors, and the model of friction.

    Friction of unactuated joints that are part of the state belongs to the inverse model, all other friction to the
    model of friction. Friction that depends on the load belongs to neither: the loads are the efforts of the inverse
    model.

    Parameters
    ----------
    dynamics : Dynamics
    actuators : SeriesElasticActuators
    base_state : list of ndarray
        Twist (6,) and gravity (3,) of a moving base in the base frame, buffers; empty for a fixed base.
    """

    def __init__(self, dynamics: Dynamics, actuators: SeriesElasticActuators, base_state: list[Array]) -> None:
        inverse_robot, friction_robot = separate_friction(dynamics, actuators)
        self._base_state = base_state
        self._inverse = Dynamics(inverse_robot).compile("inverse")
        self._efforts, *self._other_outputs = [np.zeros(shape) for _, shape in self._inverse.interface.outputs]
        has_friction = any(joint.has_friction for joint in friction_robot.joints)
        self._friction = Dynamics(friction_robot).compile("friction") if has_friction else None
        self._friction_efforts = np.zeros(len(dynamics.joint_names))

    def inverse(self, q: Array, qd: Array, qdd: Array) -> Array:
        """Efforts (n,) of a motion, a buffer. q: program positions; qd, qdd: (n,)."""
        self._inverse.evaluate(q, qd, qdd, *self._base_state, self._efforts, *self._other_outputs)
        return self._efforts

    def friction(self, q: Array, qd: Array) -> Array | None:
        """Friction (n,) at velocities (n,) without that of loads, a buffer; None if there is none.

        q: program positions.
        """
        if self._friction is None:
            return None
        self._friction.evaluate(q, qd, self._friction_efforts)
        return self._friction_efforts


def separate_friction(dynamics: Dynamics, actuators: SeriesElasticActuators) -> tuple[Robot, Robot]:
    """Separate the friction that a control law compensates apart from the inverse model.

    Parameters
    ----------
    dynamics : Dynamics
    actuators : SeriesElasticActuators

    Returns
    -------
    inverse_robot, friction_robot : Robot
        The robots of the inverse model and of the model of friction.
    """
    robot = dynamics.robot
    springs = {dynamics.joint_names[index] for index in actuators.springs}
    has_unactuated_state = bool(set(dynamics.unactuated_joint_names) - springs)
    unactuated = {joint.name for joint in robot.joints if not joint.actuated} if has_unactuated_state else set()
    in_inverse_model = unactuated - springs
    others = {joint.name for joint in robot.joints} - in_inverse_model
    inverse_robot = with_rigid_actuators(_without_friction(robot, others), dynamics, actuators)
    joints = tuple(replace(joint, load_friction=0.0) for joint in robot.joints)
    return inverse_robot, _without_friction(replace(robot, joints=joints), in_inverse_model | springs)


def _without_friction(robot: Robot, names: Collection[str]) -> Robot:
    """The robot with no friction at the named joints."""
    joints = [joint.without_friction() if joint.name in names else joint for joint in robot.joints]
    return replace(robot, joints=tuple(joints))
