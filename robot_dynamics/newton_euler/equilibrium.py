"""Where joints without motor come to rest: springs, gravity and wrenches in balance, the motors held.

With Γ_f the forces at these joints that the inverse model asks for at rest, f(q_f) = Γ_f(q_f) + k (q_f - q₀) is what is
out of balance, and K its derivative, the stiffness that a small displacement meets. From the positions that are given
the joints move as if through thick oil, always downhill: steps -(K + μ 1)⁻¹ f, with μ as large as it takes to make the
matrix positive definite, none longer than LONGEST_STEP and none beyond the balance along its way. Near a stable
equilibrium μ is zero, and the steps are Newton's. Where they stand in balance from the start they stay, stable or not.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.elastic import spring_force
from robot_dynamics.newton_euler.walker_orin import bias

ITERATIONS = 300
HALVINGS = 30
LONGEST_STEP = 0.2  # [rad or m]
DISPLACEMENT = 1e-6  # [rad or m] for the derivative by central differences
NEUTRAL = 1e-9  # a stiffness below this part of the largest is none
AT_REST = 1e-14  # nothing moves for less than this part of the weights, wrenches and springs


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
    found = np.array(np.broadcast_to(found, left.shape))  # the batch of base and wrenches too
    scale = _scale(robot, S[:, free], base_acceleration, external_wrenches)
    for _ in range(ITERATIONS):
        if not np.isfinite(left).all():
            return Balance(independent(found), np.False_, np.max(left))
        before = found
        rests = (np.abs(left) <= AT_REST * scale).all(axis=-1)
        found, left = _moved(forces, found, left, _stiffness(forces, found), rests)
        if np.all(np.abs(found - before) <= 1e-15 * (1 + np.abs(found))):
            break
    K = _stiffness(forces, found)
    smallest = np.linalg.eigvalsh((K + np.swapaxes(K, -1, -2)) / 2).min(axis=-1)
    return Balance(
        independent(found),
        smallest > NEUTRAL * np.abs(K).max(axis=(-2, -1)),
        (np.abs(left) / np.where(scale > 0, scale, 1.0)).max(axis=-1),
    )


def _scale(robot, S, base_acceleration, external_wrenches):
    """(..., free) what is to balance: weights, wrenches, and the force of the joint's own springs at 1 rad or m."""
    stiffness = np.array([joint.spring.stiffness if joint.spring else 0.0 for joint in robot.joints])
    mass = sum(link.inertia.mass for link in robot.links[1:])
    outside = mass * np.linalg.norm(base_acceleration, axis=-1, keepdims=True)
    outside = outside + sum(np.linalg.norm(wrench, axis=-1, keepdims=True) for wrench in external_wrenches.values())
    return outside + stiffness @ (S * S)


def _stiffness(forces, found):
    """(..., free, free): the derivative of what is out of balance."""
    size = found.shape[-1]
    moves = DISPLACEMENT * np.eye(size).reshape(size, *(1,) * (found.ndim - 1), size)
    columns = (forces(found + moves) - forces(found - moves)) / (2 * DISPLACEMENT)
    return np.moveaxis(columns, 0, -1)


def _moved(forces, found, left, K, rests):
    """(positions, forces left) after one step downhill in each sample; none where it `rests` or where none helps."""
    symmetric = (K + np.swapaxes(K, -1, -2)) / 2
    smallest = np.linalg.eigvalsh(symmetric).min(axis=-1)
    largest = np.abs(K).max(axis=(-2, -1))
    softest = np.maximum(1e-6 * largest, 1e-12 * np.abs(left).max(axis=-1)) + 1e-300
    damping = np.maximum(0.0, softest - smallest) + np.where(smallest < softest, np.abs(smallest), 0.0)
    matrix = K + damping[..., None, None] * np.eye(K.shape[-1])
    step = -np.linalg.solve(matrix, left[..., None])[..., 0]
    longest = np.abs(step).max(axis=-1, keepdims=True)
    step = step * np.minimum(1.0, LONGEST_STEP / np.maximum(longest, 1e-300))
    downhill = -(left * step).sum(axis=-1, keepdims=True)
    share = np.ones((*step.shape[:-1], 1))
    for _ in range(HALVINGS):
        now = forces(found + share * step)
        beyond = (now * step).sum(axis=-1, keepdims=True) > 0.5 * np.abs(downhill)
        if not beyond.any():
            break
        share = np.where(beyond, share / 2, share)
    stuck = beyond | ~(downhill > 0) | rests[..., None]
    share = np.where(stuck, 0.0, share)
    return found + share * step, np.where(stuck, left, now)
