"""Separation of joint friction into forces and impulses, for a simulation in steps."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.newton_euler.walker_orin import inertia_matrix
from robot_dynamics.simulation.friction_impulses import ImpulsiveFriction

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot

STIFF_DAMPING_RATIO = 0.3
"""h Fv / inertia of a joint beyond which its viscous friction is treated as an impulse."""


def separate_friction(robot: Robot, step: float) -> tuple[Robot, ImpulsiveFriction]:
    """The robot without the friction that acts as impulses, and that friction, for steps of a length [s].

    Dry friction is always treated as impulses, viscous friction where it is too strong for explicit steps.
    """
    viscous = step * np.array([joint.viscous_friction for joint in robot.joints])
    asymmetry = step * np.array([joint.viscous_asymmetry for joint in robot.joints])
    is_stiff = viscous + np.abs(asymmetry) > STIFF_DAMPING_RATIO * minimum_joint_inertias(robot)
    joints = []
    numbers = []
    for number, joint in enumerate(robot.joints):
        explicit = joint.without_friction()
        if not is_stiff[number]:
            viscous_friction, viscous_asymmetry = joint.viscous_friction, joint.viscous_asymmetry
            explicit = replace(explicit, viscous_friction=viscous_friction, viscous_asymmetry=viscous_asymmetry)
        joints.append(explicit)
        dry = replace(joint, viscous_friction=0.0, viscous_asymmetry=0.0)
        if dry.has_friction or (is_stiff[number] and joint.viscous_friction):
            numbers.append(number)
    friction = ImpulsiveFriction(
        np.array(numbers, dtype=np.intp),
        tuple(robot.joints[number] for number in numbers),
        step,
        (viscous * is_stiff)[numbers],
        (asymmetry * is_stiff)[numbers],
    )
    return replace(robot, joints=tuple(joints)), friction


def minimum_joint_inertias(robot: Robot) -> Array:
    """Approximate least inertia (all joints,) of each joint: all other joints and a moving base are free."""
    free = replace(robot, loops=(), platforms=(), joints=tuple(replace(joint, mimic=None) for joint in robot.joints))
    A = inertia_matrix(free, np.array([joint.initial_position for joint in robot.joints]))
    with np.errstate(all="ignore"):
        return 1 / np.diagonal(np.linalg.pinv(A))[len(A) - len(robot.joints) :]
