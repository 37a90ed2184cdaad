"""Where joints without motor come to rest: springs, gravity and wrenches in balance, the motors held.

With Γ_f the forces at these joints that the inverse model asks for at rest, f(q_f) = Γ_f(q_f) + k (q_f - q₀) is what is
out of balance, and K its derivative, the stiffness that a small displacement meets. From the positions that are given
the joints move as if through thick oil, always downhill: steps -(K + μ 1)⁻¹ f, with μ as large as it takes to make the
matrix positive definite, none longer than LONGEST_TURN and none beyond the balance along its way. Joints are measured
by their own stiffness, so that a soft one beside a stiff one counts. Near a stable
equilibrium μ is zero, and the steps are Newton's. Where they stand in balance from the start they stay, stable or not.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.joint_springs import spring_force
from robot_dynamics.newton_euler.linear import solve_each
from robot_dynamics.newton_euler.walker_orin import bias

MAX_ITERATIONS = 300
MAX_HALVINGS = 30
MAX_ROTATION, MAX_TRANSLATION = (
    0.2,
    5.0,
)  # of one step [rad], [m]: gravity along a slide does not change, about an axis it does
DISPLACEMENT = 1e-6  # [rad or m] for the derivative by central differences
MIN_STIFFNESS = 1e-6  # stiffness against all joints together, as a part of their own, that is taken for a valley
NEUTRAL_STIFFNESS = 1e-9  # and below which there is none
RELATIVE_BALANCE_TOLERANCE = 1e-14  # nothing moves for less than this part of the weights, wrenches and springs


class StaticBalance(NamedTuple):
    """configuration: positions of all joints, and how they move together; stable: (...), for loads that have a
    potential: wrenches, which turn with their links, may excite what this calls stable; left: (..., free) the forces
    that are left at the joints without motor, and scale: (..., free), the weights, wrenches and springs' forces at 1
    rad or m to compare with."""

    constrained_state: object
    is_stable: np.ndarray
    residual: np.ndarray
    scale: np.ndarray


def find_equilibrium(robot, state_near, start, q, free, base_acceleration, external_wrenches):
    """The Balance of a robot whose independent joints `free` (numbers) have no motor.

    configured: gives for positions (..., m) of the independent joints, and positions (..., joints) of all joints near
    there, the configuration, with q (..., joints) of all joints and G (..., joints, m); start: the configuration where
    the search begins; q: (..., m), the positions of the independent joints there; base_acceleration: (..., 6), gravity
    taken off; external_wrenches: {link number: jf_e (..., 6)}.
    """

    def independent(q_free):
        positions = np.array(np.broadcast_to(q, (*q_free.shape[:-1], q.shape[-1])))
        positions[..., free] = q_free
        return positions

    def forces(q_free):
        """What is out of balance at the free joints (..., free), not far from `here`."""
        there = state_near(independent(q_free), here.q)
        rest = np.zeros_like(there.q)
        held = bias(
            there.robot, there.chart_q, rest, base_acceleration=base_acceleration, external_wrenches=external_wrenches
        )
        return there.projected(held[..., -len(robot.joints) :] + spring_force(robot, there.q, rest))[..., free]

    found, here = q[..., free], start
    left = forces(found)
    found = np.array(np.broadcast_to(found, left.shape))  # the batch of base and wrenches too
    G = here.G[..., free]
    scale = _scale(robot, G, base_acceleration, external_wrenches)
    turning = np.array([not joint.prismatic for joint in robot.joints])
    slides = ~np.any((G != 0) & turning[:, None], axis=tuple(range(G.ndim - 1)))
    longest = np.where(slides, MAX_TRANSLATION, MAX_ROTATION)
    for _ in range(MAX_ITERATIONS):
        if not np.isfinite(left).all():
            return StaticBalance(here, np.False_, left, scale)
        before = found
        rests = (np.abs(left) <= RELATIVE_BALANCE_TOLERANCE * scale).all(axis=-1)
        found, left = _moved(forces, found, left, _stiffness(forces, found), rests, longest)
        here = state_near(independent(found), here.q)
        if np.all(np.abs(found - before) <= 1e-15 * (1 + np.abs(found))):
            break
    _, scaled = _by_own_stiffness(_stiffness(forces, found))
    smallest = np.linalg.eigvalsh((scaled + np.swapaxes(scaled, -1, -2)) / 2).min(axis=-1)
    return StaticBalance(here, smallest > NEUTRAL_STIFFNESS, left, scale)


def _scale(robot, G, base_acceleration, external_wrenches):
    """(..., free) what is to balance: weights, wrenches, and the force of the joint's own springs at 1 rad or m."""
    stiffness = np.array([joint.spring.stiffness if joint.spring else 0.0 for joint in robot.joints])
    masses = np.array([link.inertia.mass for link in robot.links])
    for number in range(len(robot.joints), 0, -1):  # what hangs on each joint
        masses[robot.joints[number - 1].antecedent] += masses[number]
    outside = (masses[1:] @ np.abs(G)) * np.linalg.norm(base_acceleration, axis=-1, keepdims=True)
    outside = outside + sum(np.linalg.norm(wrench, axis=-1, keepdims=True) for wrench in external_wrenches.values())
    return outside + stiffness @ (G * G)


def _by_own_stiffness(K):
    """(s, s K s): 1/√|K_ii| of each joint (..., free), one where there is none, and K in these measures."""
    own = np.abs(np.diagonal(K, axis1=-2, axis2=-1))
    s = 1 / np.sqrt(np.where(own > 1e-12 * own.max(axis=-1, keepdims=True), own, 1.0))
    return s, s[..., :, None] * K * s[..., None, :]


def _stiffness(forces, found):
    """(..., free, free): the derivative of what is out of balance."""
    size = found.shape[-1]
    moves = DISPLACEMENT * np.eye(size).reshape(size, *(1,) * (found.ndim - 1), size)
    columns = (forces(found + moves) - forces(found - moves)) / (2 * DISPLACEMENT)
    return np.moveaxis(columns, 0, -1)


def _moved(forces, found, left, K, rests, longest):
    """(positions, forces left) after one step downhill in each sample; none where it `rests` or where none helps."""
    s, K = _by_own_stiffness(K)
    smallest = np.linalg.eigvalsh((K + np.swapaxes(K, -1, -2)) / 2).min(axis=-1)
    damping = np.where(smallest < MIN_STIFFNESS, MIN_STIFFNESS - smallest + np.abs(smallest), 0.0)
    matrix = K + damping[..., None, None] * np.eye(K.shape[-1])
    step = -s * solve_each(matrix, s * left)
    step = step / np.maximum(1.0, np.abs(step / longest).max(axis=-1, keepdims=True))
    downhill = -(left * step).sum(axis=-1, keepdims=True)
    share = np.ones((*step.shape[:-1], 1))
    for _ in range(MAX_HALVINGS):
        now = forces(found + share * step)
        beyond = (now * step).sum(axis=-1, keepdims=True) > 0.5 * np.abs(downhill)
        if not beyond.any():
            break
        share = np.where(beyond, share / 2, share)
    stuck = beyond | ~(downhill > 0) | rests[..., None]
    share = np.where(stuck, 0.0, share)
    return found + share * step, np.where(stuck, left, now)
