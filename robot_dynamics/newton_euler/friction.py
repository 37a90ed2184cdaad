"""Joint friction: Fs sign(q̇) + Fv q̇ (Khalil, sections 7.2 and 7.3, eq. 106)."""

import numpy as np


def friction(robot, qd):
    """(..., n) [N m or N]: what an actuator spends on friction at joint velocities qd (..., n); none at rest."""
    viscous = np.array([joint.viscous_friction for joint in robot.joints])
    coulomb = np.array([joint.coulomb_friction for joint in robot.joints])
    return viscous * qd + coulomb * np.sign(qd)
