"""Random motions of a robot that excite all its identifiable parameters."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.constraints.loop_equations import loop_equations
from robot_dynamics.constraints.manifold_walk import build_constraint_manifold
from robot_dynamics.inputs import Base

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.manifold_walk import ConstraintManifold
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

DEFAULT_RANGE = np.pi, 1.0  # [rad], [m] on each side of the initial position of a joint without limits
MAX_RATE = 3.0  # [rad or characteristic lengths, per second and per second²]
# Smallest to largest singular value of the Jacobian of the dependent joints; smaller ratios are near a dead point.
MIN_SINGULAR_VALUE_RATIO = 0.03


class Motions(NamedTuple):
    """Samples of motions of a robot.

    q: (N, n) positions, with loops (N, all joints); qd, qdd: (N, n) velocities and accelerations of the independent
    joints; base: states of a moving base, None if the base is fixed.
    """

    q: Array
    qd: Array
    qdd: Array
    base: Base | None


class LoopMotions(NamedTuple):
    """Samples of motions that keep the loops closed.

    q, qd, qdd: (N, all joints); directions: (N, all joints, n) independent motions; base: states of a moving base, None
    if the base is fixed.
    """

    q: Array
    qd: Array
    qdd: Array
    directions: Array
    base: Base | None


def sample_random_motions(dynamics: Dynamics, samples: int, seed: int = 0) -> Motions:
    """Sample motions within the joint limits, with rates and accelerations up to 3 [per second, per second²].

    With loops, the positions cover the range that is reached from the initial positions without passing a position at
    which the mobility changes. Positions near dead points of the independent joints are left out. Equal seeds give
    equal motions.
    """
    rng = np.random.default_rng(seed)
    robot = dynamics.robot
    n = len(dynamics.joint_names)
    if robot.loops:
        q = _sample_regular_positions(build_constraint_manifold(robot), rng, samples)
    else:
        joints = [robot.joints[robot.joint_numbers[name]] for name in dynamics.joint_names]
        lower, upper = np.array([position_bounds(joint) for joint in joints]).reshape(-1, 2).T
        q = rng.uniform(lower, upper, (samples, n))
    qd, qdd = rng.uniform(-MAX_RATE, MAX_RATE, (2, samples, n))
    return Motions(q, qd, qdd, _sample_base(rng, samples) if robot.moving_base else None)


def sample_loop_motions(robot: Robot, samples: int, seed: int = 0) -> LoopMotions:
    """Sample motions of a robot with loops along the manifold of closed positions.

    The range is that of `sample_random_motions`, but includes dead points of motors and their neighbourhood. Rates and
    accelerations along the manifold are at most 3 [rad or characteristic lengths, per second and per second²].
    """
    rng = np.random.default_rng(seed)
    manifold = build_constraint_manifold(robot)
    S = manifold.topology.S
    units = manifold.units
    t = _select_evenly(manifold.random_walks(rng), samples)
    tangent = manifold.tangent(t)
    q = manifold.joint_positions(t)
    directions = units[:, None] * tangent.basis
    rates = rng.uniform(-MAX_RATE, MAX_RATE, (2, samples, directions.shape[2], 1))
    qd = (directions @ rates[0])[..., 0] @ S.T
    drift = loop_equations(robot, q, qd).drift
    curvature = units * (tangent.pseudo_inverse @ drift[..., None])[..., 0]
    qdd = ((directions @ rates[1])[..., 0] - curvature) @ S.T
    return LoopMotions(q, qd, qdd, S @ directions, _sample_base(rng, samples) if robot.moving_base else None)


def position_bounds(joint: Joint) -> tuple[float, float]:
    """Return the lower and upper position [rad or m] of a joint; without limits, a default range."""
    reach = DEFAULT_RANGE[joint.prismatic]
    middle = joint.initial_position
    lower, upper = joint.limits.lower, joint.limits.upper
    if np.isfinite(lower) and np.isfinite(upper):
        return lower, upper
    return max(lower, middle - reach), min(upper, middle + reach)


def _sample_regular_positions(manifold: ConstraintManifold, rng: np.random.Generator, samples: int) -> Array:
    """Sample positions (samples, all joints) at which the independent joints determine the dependent ones well."""
    topology = manifold.topology
    t = manifold.random_walks(rng)
    J = loop_equations(topology.robot, manifold.joint_positions(t)).jacobian @ topology.S * manifold.units
    s = np.linalg.svd(J[..., topology.dependent_columns], compute_uv=False)
    ratio = s[:, -1] / s[:, 0]
    regular = ratio > min(MIN_SINGULAR_VALUE_RATIO, np.median(ratio))
    return manifold.joint_positions(_select_evenly(t[regular], samples))


def _select_evenly(states: Array, samples: int) -> Array:
    """Select a number of states (N, m), evenly spaced from the first to the last."""
    selected: Array = states[np.linspace(0, len(states) - 1, samples).round().astype(int)]
    return selected


def _sample_base(rng: np.random.Generator, samples: int) -> Base:
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(rng.normal(size=(samples, 4))).as_matrix()
    twist, acceleration = rng.uniform(-2, 2, (2, samples, 6))
    return Base(poses, twist, acceleration)
