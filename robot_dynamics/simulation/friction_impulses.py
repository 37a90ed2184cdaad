"""Joint friction as impulses at the end of a step: dry friction that sticks, and stiff viscous friction.

Dry friction changes the velocities v* that result from everything else as far as it can: v = v* + W p with |p| ≤ Fs h.
The impulse p opposes the remaining motion, or is the one that holds the joint at rest. A force Fs sign(q̇) in explicit
steps would chatter instead. Viscous friction that is too strong for explicit steps is treated here as well, with
p = -Fv h v. Source: J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988 (time stepping).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.newton_euler.walker_orin import inertia_matrix

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.model.robot import Robot

MAX_SWEEPS = 200
CONVERGENCE_TOLERANCE = 1e-12
"""Change in one sweep, relative to the largest impulse, at which the iteration ends."""
STIFF_DAMPING_RATIO = 0.3
"""h Fv / inertia of a joint beyond which its viscous friction is treated as an impulse."""


@dataclass(frozen=True, eq=False)
class ImpulsiveFriction:
    """Friction of the joints of a robot that acts as impulses during a step of length h.

    Attributes
    ----------
    joints : ndarray, shape (k,)
        Numbers of the joints with such friction.
    dry_limits : ndarray, shape (k,)
        Largest impulses of dry friction, Fs h [N m s or N s].
    viscous_gains : ndarray, shape (k,)
        Viscous impulses per velocity, Fv h.
    """

    joints: IntArray
    dry_limits: Array
    viscous_gains: Array


def separate_friction(robot: Robot, step: float) -> tuple[Robot, ImpulsiveFriction]:
    """The robot without the friction that acts as impulses, and that friction, for steps of a length [s].

    Dry friction is always treated as impulses, viscous friction where it is too strong for explicit steps.
    """
    dry = step * np.array([joint.coulomb_friction for joint in robot.joints])
    viscous = step * np.array([joint.viscous_friction for joint in robot.joints])
    viscous[viscous <= STIFF_DAMPING_RATIO * minimum_joint_inertias(robot)] = 0
    joints = tuple(
        replace(joint, coulomb_friction=0.0, viscous_friction=0.0 if is_stiff else joint.viscous_friction)
        for joint, is_stiff in zip(robot.joints, viscous, strict=True)
    )
    numbers = np.flatnonzero(dry + viscous)
    return replace(robot, joints=joints), ImpulsiveFriction(numbers, dry[numbers], viscous[numbers])


def minimum_joint_inertias(robot: Robot) -> Array:
    """Approximate least inertia (all joints,) of each joint: all other joints and a moving base are free."""
    free = replace(robot, loops=(), platforms=(), joints=tuple(replace(joint, mimic=None) for joint in robot.joints))
    A = inertia_matrix(free, np.array([joint.initial_position for joint in robot.joints]))
    with np.errstate(all="ignore"):
        return 1 / np.diagonal(np.linalg.pinv(A))[len(A) - len(robot.joints) :]


def friction_impulses(W: Array, velocities: Array, dry: Array, viscous: Array) -> Array:
    """Impulses p (k,) [N m s or N s] of friction.

    W (k, k): change of the velocities (k,) for unit impulses; dry, viscous (k,): Fs h and Fv h. The method is
    Gauss-Seidel with projection; where all joints continue to slide, the initial impulses are the solution.
    """
    right_side = np.column_stack([velocities, W])
    damped = np.asarray(np.linalg.solve(np.eye(len(W)) + W * viscous, right_side), dtype=np.float64)
    damped_velocities = damped[:, 0]
    damped_W = damped[:, 1:]
    impulses = _dry_impulses(damped_W, damped_velocities, dry) if dry.any() else np.zeros(len(dry))
    return impulses - viscous * (damped_velocities + damped_W @ impulses)


def _dry_impulses(W: Array, velocities: Array, limits: Array) -> Array:
    """Impulses (k,) within the limits (k,) that bring the joints to rest or oppose their motion."""
    impulses = -limits * np.sign(velocities)
    if ((velocities + W @ impulses) * velocities >= 0).all():
        return impulses
    for _ in range(MAX_SWEEPS):
        previous = impulses.copy()
        for k in range(len(limits)):
            sticking_impulse = impulses[k] - (velocities[k] + W[k] @ impulses) / W[k, k]
            impulses[k] = min(max(sticking_impulse, -limits[k]), limits[k])
        if np.abs(impulses - previous).max() <= CONVERGENCE_TOLERANCE * limits.max():
            break
    return impulses
