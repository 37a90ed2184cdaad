"""The matrix A and the vector H of the dynamic model, from the inverse model alone (Khalil, section 3.3.1).

With a fixed base Γ = A q̈ + H; with a moving one [f_0; Γ] = A [V̇0; q̈] + H, six rows more in front (section 7.1), where
f_0 is the wrench on the base and V̇0 its classical acceleration, both in frame 0.
"""

import numpy as np

from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass

ZERO_SCREW = np.zeros(6)


def inertia_matrix(robot, q):
    """A (..., m, m) at joint positions q (..., n), rotors counted; m = n, or 6 + n with a moving base.

    Column k is what the inverse model asks for when the k-th acceleration alone is 1, everything else 0.
    """
    joints = len(robot.joints)
    base = 6 if robot.moving_base else 0
    # an axis for the columns, in front of every batch axis, so that one sweep does for all
    unit = np.eye(base + joints).reshape((base + joints,) + (1,) * (q.ndim - 1) + (base + joints,))
    sweep = run_forward_pass(robot, q, np.zeros_like(q), ZERO_SCREW, {})
    base_acceleration = unit[..., :6] if robot.moving_base else ZERO_SCREW
    forces, wrenches = inverse_dynamics(robot, sweep, unit[..., base:], base_acceleration)
    return np.moveaxis(_rows(robot, forces, wrenches, unit.shape[:1] + q.shape[:-1]), 0, -1)


def bias(robot, q, qd, base_twist=ZERO_SCREW, base_acceleration=ZERO_SCREW, external_wrenches=None, drift=None):
    """H (..., m): what the inverse model asks for when all accelerations are 0, or those of joints `drift` (..., n).

    base_acceleration: (..., 6), what H is to hold of gravity: 0 for Coriolis and centrifugal terms alone, -g turned
    into frame 0 for gravity too; with qd and base_twist zero, for gravity alone.
    """
    sweep = run_forward_pass(robot, q, qd, base_twist, external_wrenches or {})
    forces, wrenches = inverse_dynamics(robot, sweep, np.zeros_like(q) if drift is None else drift, base_acceleration)
    batch = np.broadcast_shapes(q.shape[:-1], wrenches.shape[:-2])
    return _rows(robot, forces, wrenches, batch)


def _rows(robot, forces, wrenches, batch):
    """Γ (..., n), or [f_0; Γ] (..., 6 + n) with a moving base, in the shape of the batch."""
    forces = np.broadcast_to(forces, (*batch, len(robot.joints)))
    if not robot.moving_base:
        return forces
    return np.concatenate([np.broadcast_to(wrenches[..., 0, :], (*batch, 6)), forces], axis=-1)
