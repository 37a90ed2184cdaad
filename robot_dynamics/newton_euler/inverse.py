"""Inverse dynamic model in two passes, for known accelerations of all joints and of the base."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.newton_euler.kinematics import axis_component, axis_screw
from robot_dynamics.newton_euler.screw import (
    apply,
    concatenate_vectors,
    stack_vectors,
    twist_to_successor,
    wrench_to_antecedent,
)

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.newton_euler.kinematics import ForwardPass


def inverse_dynamics(
    robot: Robot, forward_pass: ForwardPass, qdd: ScalarArray, base_acceleration: ScalarArray
) -> tuple[ScalarArray, ScalarArray]:
    """Joint forces and link wrenches of a motion.

    Parameters
    ----------
    robot : Robot
    forward_pass : ForwardPass
    qdd : ndarray, shape (..., n)
        Joint accelerations [rad/s² or m/s²].
    base_acceleration : ndarray, shape (..., 6)
        0V̇0, gravity subtracted.

    Returns
    -------
    forces : ndarray, shape (..., n)
        Joint forces [N m or N], friction not counted.
    wrenches : ndarray, shape (..., n + 1, 6)
        Wrench that the antecedent exerts on link j, in frame j at its origin; in the first row the wrench that the
        ground exerts on the base.

    Notes
    -----
    Source: Khalil, section 3.2 (Luh, Walker and Paul); the row of the base is section 7.1, first method.
    """
    accelerations = [base_acceleration]
    wrenches = [apply(robot.links[0].inertia.spatial, base_acceleration) - forward_pass.betas[0]]
    for j, joint in enumerate(robot.joints, start=1):
        R = forward_pass.rotations[j]
        P = forward_pass.positions[j]
        V_dot = twist_to_successor(R, P, accelerations[joint.antecedent]) + forward_pass.gammas[j]
        V_dot = V_dot + axis_screw(joint, qdd[..., j - 1 : j])
        accelerations.append(V_dot)
        wrenches.append(apply(robot.links[j].inertia.spatial, V_dot) - forward_pass.betas[j])
    forces: list[ScalarArray] = []
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        forces.append(axis_component(joint, wrenches[j]) + joint.rotor_inertia * qdd[..., j - 1 : j])
        i = joint.antecedent
        wrench = wrench_to_antecedent(forward_pass.rotations[j], forward_pass.positions[j], wrenches[j])
        wrenches[i] = wrenches[i] + wrench
    return concatenate_vectors(forces[::-1]), stack_vectors(wrenches)
