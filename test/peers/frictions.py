"""Joints with friction of all kinds, and their friction from its definition, joint by joint."""

from dataclasses import replace

import numpy as np


def can_depend_on_load(robot, number):
    """Whether a joint has a load of its own: a motor, no spring, no loop, no mimic joints."""
    joint = robot.joints[number]
    leaders = {leader for follower, (leader, _, _) in enumerate(robot.mimic_relations) if leader != follower}
    is_alone = number not in robot.joints_in_loops and number not in leaders
    return joint.role == "actuated" and joint.spring is None and is_alone


def with_random_friction(robot, seed, joints=None, load_friction=True):
    """Return the robot with random friction of all kinds at joints (numbers; None: all)."""
    rng = np.random.default_rng([seed, 18])
    frictional = list(robot.joints)
    for number, joint in enumerate(robot.joints):
        viscous, coulomb, stribeck, velocity, load = rng.uniform(0.1, 2, 5)
        viscous_part, coulomb_part, sign = rng.uniform(-1, 1, 3)
        if joints is not None and number not in joints:
            continue
        stribeck *= 1.0 if sign > 0 else -0.5 * coulomb / 2
        frictional[number] = replace(
            joint,
            viscous_friction=viscous,
            coulomb_friction=coulomb,
            viscous_asymmetry=viscous_part * viscous,
            coulomb_asymmetry=coulomb_part * (coulomb + min(stribeck, 0)),
            stribeck_friction=stribeck,
            stribeck_velocity=velocity,
            load_friction=load * 0.4 if load_friction and can_depend_on_load(robot, number) else 0.0,
        )
    return replace(robot, joints=tuple(frictional))


def without_friction(robot):
    return replace(robot, joints=tuple(joint.without_friction() for joint in robot.joints))


def joint_friction(joint, velocity, load):
    """Friction [N m or N] of one joint that moves at a velocity under a load: that of its direction."""
    if velocity == 0:
        return 0.0
    if velocity > 0:
        viscous = joint.viscous_friction + joint.viscous_asymmetry
        dry = joint.coulomb_friction + joint.coulomb_asymmetry
    else:
        viscous = joint.viscous_friction - joint.viscous_asymmetry
        dry = joint.coulomb_friction - joint.coulomb_asymmetry
    if joint.stribeck_friction:
        dry += joint.stribeck_friction * joint.stribeck_velocity**2 / (joint.stribeck_velocity**2 + velocity**2)
    dry += joint.load_friction * abs(load)
    return viscous * velocity + (dry if velocity > 0 else -dry)


def all_friction(robot, velocities, loads):
    """Friction (..., n) of all joints at velocities and loads (..., n)."""
    velocities, loads = np.broadcast_arrays(velocities, loads)
    efforts = np.empty(velocities.shape)
    for index in np.ndindex(velocities.shape):
        efforts[index] = joint_friction(robot.joints[index[-1]], velocities[index], loads[index])
    return efforts
