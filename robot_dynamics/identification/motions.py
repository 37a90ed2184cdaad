"""Random motions of a robot that show all that can be seen of its parameters."""

from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.errors import SingularModelError
from robot_dynamics.question import Base

ATTEMPTS = 50  # random positions for each one at which loops close
REACH = np.pi, 1.0  # [rad], [m] to both sides of the initial position of a joint without limits
STRIDE = 0.2  # [rad or characteristic lengths] from one closed configuration to the next


class Motions(NamedTuple):
    """Samples q (N, n) or, with loops, (N, all joints), qd, qdd (N, n); base: a Base or None."""

    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    base: Base | None


def random_motions(dynamics, samples, seed=0):
    """Motions within joint limits, rates and accelerations up to 3 [per second, per second²]. The same for a seed.

    Raises SingularModelError where the loops close at hardly any of such positions.
    """
    chance = np.random.default_rng(seed)
    robot, n = dynamics.robot, len(dynamics.joint_names)
    joints = [robot.joints[robot.joint_numbers[name]] for name in dynamics.joint_names]
    bounds = np.array([position_bounds(joint) for joint in joints]).reshape(-1, 2)
    q = _walk(dynamics, bounds, samples, chance) if robot.loops else chance.uniform(*bounds.T, (samples, n))
    qd, qdd = chance.uniform(-3, 3, (2, samples, n))
    return Motions(q, qd, qdd, _base(chance, samples) if robot.moving_base else None)


def _walk(dynamics, bounds, samples, chance):
    """(samples, all joints): random positions that close the loops, each one a stride from the one before it."""
    joints = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    here = dynamics.closed_positions
    stride = STRIDE * np.where([dynamics.robot.joints[number].prismatic for number in joints],
                               dynamics.robot.characteristic_length, 1.0)  # fmt: skip
    found, refused = [], None
    for _ in range(ATTEMPTS * samples):
        there = here.copy()
        there[joints] = np.clip(chance.uniform(*bounds.T), here[joints] - stride, here[joints] + stride)
        try:
            here = dynamics.expand(there)
            found.append(here)
        except SingularModelError as error:
            refused = error
        if len(found) == samples:
            return np.array(found)
    raise SingularModelError(f"hardly any random positions within the joint limits close the loops: {refused}")


def position_bounds(joint):
    """(lower, upper) position that a joint may be given."""
    reach, middle = REACH[joint.prismatic], joint.initial_position
    lower, upper = joint.limits.lower, joint.limits.upper
    if np.isfinite(lower) and np.isfinite(upper):
        return lower, upper
    return max(lower, middle - reach), min(upper, middle + reach)


def _base(chance, samples):
    poses = np.tile(np.eye(4), (samples, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(chance.normal(size=(samples, 4))).as_matrix()
    return Base(poses, *chance.uniform(-2, 2, (2, samples, 6)))
