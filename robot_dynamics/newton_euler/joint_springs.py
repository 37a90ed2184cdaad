"""Springs and dampers at joints: k Δq + c q̇, Δq = q - q₀ (Khalil, section 6), what they demand of a motor there."""

import numpy as np


def spring_force(robot, q, qd):
    """(..., n) [N m or N] at joint positions q and velocities qd (..., n); zero where a joint has no spring.

    What an elastic joint exerts on the link that it moves is the opposite.
    """
    springs = [joint.spring for joint in robot.joints]
    if not any(springs):
        return np.zeros_like(q)
    stiffness = np.array([spring.stiffness if spring else 0.0 for spring in springs])
    rest = np.array([spring.rest if spring else 0.0 for spring in springs])
    damping = np.array([spring.damping if spring else 0.0 for spring in springs])
    return stiffness * (q - rest) + damping * qd
