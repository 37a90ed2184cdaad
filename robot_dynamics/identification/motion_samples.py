"""Random motions of a robot that show all that can be seen of its parameters."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.constraints.manifold_walk import build_constraint_manifold
from robot_dynamics.inputs import Base

DEFAULT_RANGE = np.pi, 1.0  # [rad], [m] to both sides of the initial position of a joint without limits
MAX_RATE = 3.0  # [rad or characteristic lengths, per second and per second²]
MIN_SINGULAR_VALUE_RATIO = (
    0.03  # of the largest singular value of what the independent joints place: less is near a dead point
)


class Motions(NamedTuple):
    """Samples q (N, n) or, with loops, (N, all joints), qd, qdd (N, n); base: a Base or None."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    base: Base | None


class LoopMotions(NamedTuple):
    """Samples q, qd, qdd (N, all joints) that keep the loops closed; directions: (N, all joints, n) of independent
    motions; base: a Base or None."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    directions: np.ndarray
    base: Base | None


def sample_random_motions(dynamics, samples, seed=0):
    """Motions within joint limits, rates and accelerations up to 3 [per second, per second²]. The same for a seed.

    With loops, of the whole range that they reach from the initial positions without passing a position at which their
    mobility changes, but near dead points of the independent joints.
    """
    rng = np.random.default_rng(seed)
    robot, n = dynamics.robot, len(dynamics.joint_names)
    if robot.loops:
        manifold = build_constraint_manifold(robot)
        q = _well_placed(manifold, rng, samples)
    else:
        joints = [robot.joints[robot.joint_numbers[name]] for name in dynamics.joint_names]
        q = rng.uniform(*np.array([position_bounds(joint) for joint in joints]).reshape(-1, 2).T, (samples, n))
    qd, qdd = rng.uniform(-MAX_RATE, MAX_RATE, (2, samples, n))
    return Motions(q, qd, qdd, _base(rng, samples) if robot.moving_base else None)


def sample_loop_motions(robot, samples, seed=0):
    """LoopMotions of a robot with loops, of the whole range that they reach as for `random_motions`, dead points of
    motors and their neighbourhood too: rates are those along the manifold of closed positions, up to 3 [rad or
    characteristic lengths, per second and per second²]."""
    rng, manifold = np.random.default_rng(seed), build_constraint_manifold(robot)
    S, reach = manifold.topology.S, manifold.units
    t = _spread(manifold.random_walks(rng), samples)
    tangent, q = manifold.tangent(t), manifold.joint_positions(t)
    directions = reach[:, None] * tangent.basis
    rates = rng.uniform(-MAX_RATE, MAX_RATE, (2, samples, directions.shape[2], 1))
    qd = (directions @ rates[0])[..., 0] @ S.T
    drift = loop_equations(robot, q, qd).drift
    turning = reach * (tangent.pseudo_inverse @ drift[..., None])[..., 0]
    qdd = ((directions @ rates[1])[..., 0] - turning) @ S.T
    return LoopMotions(q, qd, qdd, S @ directions, _base(rng, samples) if robot.moving_base else None)


def _well_placed(manifold, rng, samples):
    """(samples, all joints) positions at which the independent joints place the others well."""
    placed, t = manifold.topology.dependent_columns, manifold.random_walks(rng)
    J = (
        loop_equations(manifold.topology.robot, manifold.joint_positions(t)).jacobian
        @ manifold.topology.S
        * manifold.units
    )
    s = np.linalg.svd(J[..., placed], compute_uv=False)
    quality = s[:, -1] / s[:, 0]
    good = quality > min(MIN_SINGULAR_VALUE_RATIO, np.median(quality))
    return manifold.joint_positions(_spread(t[good], samples))


def _spread(states, samples):
    """So many of the states (N, m), evenly from the first to the last."""
    return states[np.linspace(0, len(states) - 1, samples).round().astype(int)]


def position_bounds(joint):
    """(lower, upper) position that a joint may be given."""
    reach, middle = DEFAULT_RANGE[joint.prismatic], joint.initial_position
    lower, upper = joint.limits.lower, joint.limits.upper
    if np.isfinite(lower) and np.isfinite(upper):
        return lower, upper
    return max(lower, middle - reach), min(upper, middle + reach)


def _base(rng, samples):
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(rng.normal(size=(samples, 4))).as_matrix()
    return Base(poses, *rng.uniform(-2, 2, (2, samples, 6)))
