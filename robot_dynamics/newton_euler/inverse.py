"""The inverse dynamic model in two sweeps: the cheap way where every acceleration is known, the base's too."""

from robot_dynamics.newton_euler.kinematics import axis_component, axis_screw
from robot_dynamics.newton_euler.screw import (
    apply,
    concatenate_vectors,
    stack_vectors,
    twist_to_successor,
    wrench_to_antecedent,
)


def inverse_dynamics(robot, sweep, qdd, base_acceleration):
    """Joint forces and link wrenches of a motion.

    sweep: what `sweep_forward` left; qdd: (..., n) [rad/s² or m/s²]; base_acceleration: 0V̇0 (..., 6), gravity taken
    off.

    Returns (forces, wrenches): (..., n) [N m or N], friction not counted; (..., n + 1, 6), what the antecedent exerts
    on link j, in frame j at its origin, and in the first row what the ground exerts on the base.

    Source: Khalil, section 3.2 (Luh, Walker and Paul); the base's row is its section 7.1, first method.
    """
    accelerations = [base_acceleration]
    wrenches = [apply(robot.links[0].inertia.spatial, base_acceleration) - sweep.betas[0]]
    for j, joint in enumerate(robot.joints, start=1):
        R, P = sweep.rotations[j], sweep.positions[j]
        V_dot = twist_to_successor(R, P, accelerations[joint.antecedent]) + sweep.gammas[j]
        V_dot = V_dot + axis_screw(joint, qdd[..., j - 1 : j])
        accelerations.append(V_dot)
        wrenches.append(apply(robot.links[j].inertia.spatial, V_dot) - sweep.betas[j])
    forces = [None] * len(robot.joints)
    for j in range(len(robot.joints), 0, -1):
        joint = robot.joints[j - 1]
        forces[j - 1] = axis_component(joint, wrenches[j]) + joint.rotor_inertia * qdd[..., j - 1 : j]
        i = joint.antecedent
        wrenches[i] = wrenches[i] + wrench_to_antecedent(sweep.rotations[j], sweep.positions[j], wrenches[j])
    return concatenate_vectors(forces), stack_vectors(wrenches)
