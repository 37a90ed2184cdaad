"""A Panda with known parameters: friction, noise on the efforts, and the values that a fit should return."""

from dataclasses import replace

import numpy as np

from robot_dynamics import Dynamics

NOISE = np.array([0.4, 0.6, 0.4, 0.5, 0.1, 0.1, 0.05])  # [N m] standard deviation on efforts
VISCOUS = np.array([3.0, 2.5, 2.0, 2.0, 0.5, 0.4, 0.3])
COULOMB = np.array([1.0, 1.2, 0.8, 0.7, 0.3, 0.2, 0.2])


def truth(columns, offsets=0.0):
    """Return the true values (P,) of EffortColumns; offsets: (7,) of the joints."""
    robot = columns.dynamics.robot
    joints = [
        replace(joint, viscous_friction=fv, coulomb_friction=fs)
        for joint, fv, fs in zip(robot.joints, VISCOUS, COULOMB, strict=True)
    ]
    parameters = Dynamics(replace(robot, joints=tuple(joints))).parameters
    remainder = np.zeros(len(columns.names) - len(columns.parameter_indices))
    remainder[:7] = offsets
    return np.concatenate([columns.grouping_matrix @ parameters, remainder])
