"""Joint friction: Fs sign(q̇) + Fv q̇ (Khalil, sections 7.2 and 7.3, eq. 106)."""

import numpy as np

_recorded_sign = np.frompyfunc(lambda scalar: scalar.signum() if hasattr(scalar, "signum") else np.sign(scalar), 1, 1)


def friction(robot, qd):
    """(..., n) [N m or N]: what an actuator spends on friction at joint velocities qd (..., n); none at rest."""
    viscous = np.array([joint.viscous_friction for joint in robot.joints])
    coulomb = np.array([joint.coulomb_friction for joint in robot.joints])
    return viscous * qd + coulomb * signs(qd)


def signs(rates):
    """-1, 0 or 1 of each rate; of symbols, the operation `signum`."""
    return np.sign(rates) if np.asarray(rates).dtype != object else _recorded_sign(rates)
