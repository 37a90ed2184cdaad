"""Inertia matrix A and bias vector H of the dynamic model, from the inverse model alone (Khalil, section 3.3.1).

With a fixed base Γ = A q̈ + H; with a moving one [f_0; Γ] = A [V̇0; q̈] + H, with six more rows in front (section 7.1).
f_0 is the wrench on the base and V̇0 its classical acceleration, both in frame 0.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.newton_euler.inverse import inverse_dynamics
from robot_dynamics.newton_euler.kinematics import run_forward_pass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot

ZERO_SCREW = np.zeros(6)


def inertia_matrix(robot: Robot, q: Array) -> Array:
    """Inertia matrix A of a robot, rotors counted.

    Column k is the result of the inverse model where the k-th acceleration is 1, all others and all velocities 0.

    Parameters
    ----------
    robot : Robot
    q : ndarray, shape (..., n)

    Returns
    -------
    ndarray, shape (..., m, m)
        m = n, or 6 + n with a moving base.
    """
    joints = len(robot.joints)
    base = 6 if robot.moving_base else 0
    size = base + joints
    # an axis for the columns in front of every batch axis: one forward pass serves all columns
    unit = np.eye(size).reshape((size,) + (1,) * (q.ndim - 1) + (size,))
    forward_pass = run_forward_pass(robot, q, np.zeros_like(q), ZERO_SCREW, {})
    base_acceleration = unit[..., :6] if robot.moving_base else ZERO_SCREW
    forces, wrenches = inverse_dynamics(robot, forward_pass, unit[..., base:], base_acceleration)
    return np.moveaxis(_rows(robot, forces, wrenches, unit.shape[:1] + q.shape[:-1]), 0, -1)


def bias(
    robot: Robot,
    q: Array,
    qd: Array,
    base_twist: Array = ZERO_SCREW,
    base_acceleration: Array = ZERO_SCREW,
    external_wrenches: Mapping[int, Array] | None = None,
    drift: Array | None = None,
) -> Array:
    """Bias vector H: result of the inverse model without accelerations.

    Parameters
    ----------
    robot : Robot
    q, qd : ndarray, shape (..., n)
    base_twist : ndarray, shape (..., 6)
    base_acceleration : ndarray, shape (..., 6)
        0 for Coriolis and centrifugal terms only; -g in frame 0 to add gravity, or with qd and base_twist zero for
        gravity only.
    external_wrenches : mapping of int to ndarray, optional
        jf_e (..., 6) by link number.
    drift : ndarray, shape (..., n), optional
        Joint accelerations, by default 0.

    Returns
    -------
    ndarray, shape (..., m)
    """
    forward_pass = run_forward_pass(robot, q, qd, base_twist, external_wrenches or {})
    accelerations = np.zeros_like(q) if drift is None else drift
    forces, wrenches = inverse_dynamics(robot, forward_pass, accelerations, base_acceleration)
    batch = np.broadcast_shapes(q.shape[:-1], wrenches.shape[:-2])
    return _rows(robot, forces, wrenches, batch)


def _rows(robot: Robot, forces: Array, wrenches: Array, batch: tuple[int, ...]) -> Array:
    """Γ (*batch, n), or [f_0; Γ] (*batch, 6 + n) with a moving base."""
    forces = np.broadcast_to(forces, (*batch, len(robot.joints)))
    if not robot.moving_base:
        return forces
    return np.concatenate([np.broadcast_to(wrenches[..., 0, :], (*batch, 6)), forces], axis=-1)
