"""Joint friction: Fs sign(q̇) + Fv q̇ (Khalil, sections 7.2 and 7.3, eq. 106)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot

_symbolic_sign = np.frompyfunc(lambda scalar: scalar.signum() if hasattr(scalar, "signum") else np.sign(scalar), 1, 1)


def friction(robot: Robot, qd: ScalarArray) -> ScalarArray:
    """Efforts (..., n) [N m or N] that overcome friction at joint velocities qd (..., n); zero at rest."""
    viscous = np.array([joint.viscous_friction for joint in robot.joints])
    coulomb = np.array([joint.coulomb_friction for joint in robot.joints])
    efforts: ScalarArray = viscous * qd + coulomb * signs(qd)
    return efforts


def signs(rates: ScalarArray) -> ScalarArray:
    """Sign of each rate: -1, 0 or 1; the operation `signum` for symbols."""
    result: ScalarArray = np.sign(rates) if np.asarray(rates).dtype != object else _symbolic_sign(rates)
    return result
