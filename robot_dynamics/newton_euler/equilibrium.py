"""Where joints without motor come to rest: springs, gravity and wrenches in balance, the motors held.

With Γ_f the forces at these joints that the inverse model asks for at rest, q_f solves Γ_f(q_f) + k (q_f - q₀) = 0, by
Newton's method from the positions that are given. The derivative of the left side is the stiffness that a small
displacement meets: the equilibrium is stable where its symmetric part is positive definite.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.elastic import spring_force
from robot_dynamics.newton_euler.walker_orin import bias

ITERATIONS = 100
HALVINGS = 30
DISPLACEMENT = 1e-6  # [rad or m] for the derivative by central differences
NEUTRAL = 1e-9  # a stiffness below this part of the largest is none


class Balance(NamedTuple):
    """q: (..., m) positions of the independent joints; stable: (...); unbalance: (...), the largest force that is left
    at a joint without motor, as a part of the weights, the wrenches and the springs' forces at 1 rad or m."""

    q: np.ndarray
    stable: np.ndarray
    unbalance: np.ndarray


def balance(robot, S, offset, free, q, base_acceleration, external_wrenches):
    """The Balance of a robot whose independent joints `free` (numbers) have no motor.

    q: (..., m) positions of the independent joints, those of `free` where the search begins; S, offset: as `coupling`
    gives them; base_acceleration: (..., 6), gravity taken off; external_wrenches: {link number: jf_e (..., 6)}.
    """

    def independent(q_free):
        positions = np.array(np.broadcast_to(q, (*q_free.shape[:-1], q.shape[-1])))
        positions[..., free] = q_free
        return positions

    def forces(q_free):
        """What is out of balance at the free joints (..., free)."""
        positions = independent(q_free) @ S.T + offset
        rest = np.zeros_like(positions)
        held = bias(robot, positions, rest, base_acceleration=base_acceleration, external_wrenches=external_wrenches)
        return ((held[..., -len(robot.joints) :] + spring_force(robot, positions, rest)) @ S)[..., free]

    found = q[..., free]
    left = forces(found)
    for _ in range(ITERATIONS):
        if not np.isfinite(left).all():
            return Balance(independent(found), np.False_, np.max(left))
        step = -(np.linalg.pinv(_stiffness(forces, found)) @ left[..., None])[..., 0]
        before = found
        found, left = _shortened(forces, found, step, left)
        if np.all(np.abs(found - before) <= 1e-15 * (1 + np.abs(found))):
            break
    K = _stiffness(forces, found)
    smallest = np.linalg.eigvalsh((K + np.swapaxes(K, -1, -2)) / 2).min(axis=-1)
    springs = sum(joint.spring.stiffness for joint in robot.joints if joint.spring)
    mass = sum(link.inertia.mass for link in robot.links[1:])
    scale = mass * np.linalg.norm(base_acceleration, axis=-1) + springs
    scale = scale + sum(np.linalg.norm(wrench, axis=-1) for wrench in external_wrenches.values())
    return Balance(
        independent(found),
        smallest > NEUTRAL * np.abs(K).max(axis=(-2, -1)),
        np.abs(left).max(axis=-1) / np.where(scale > 0, scale, 1.0),
    )


def _stiffness(forces, found):
    """(..., free, free): the derivative of what is out of balance."""
    size = found.shape[-1]
    moves = DISPLACEMENT * np.eye(size).reshape(size, *(1,) * (found.ndim - 1), size)
    columns = (forces(found + moves) - forces(found - moves)) / (2 * DISPLACEMENT)
    return np.moveaxis(columns, 0, -1)


def _shortened(forces, found, step, left):
    """(positions, forces left) after the step, halved in each sample until less is left; none where nothing helps."""
    share = np.ones((*step.shape[:-1], 1))
    for _ in range(HALVINGS):
        now = forces(found + share * step)
        worse = ~(np.linalg.norm(now, axis=-1, keepdims=True) < np.linalg.norm(left, axis=-1, keepdims=True))
        if not worse.any():
            return found + share * step, now
        share = np.where(worse, share / 2, share)
    share = np.where(worse, 0.0, share)
    return found + share * step, forces(found + share * step)
