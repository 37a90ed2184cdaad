"""Random states of parallel robots in the coordinates of their platforms."""

from typing import NamedTuple

import numpy as np

from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.model.platform import COORDINATES


class PlatformStates(NamedTuple):
    """{link: (count, ...)} of each platform: poses (4, 4), twists and accelerations (6,), along free coordinates where
    all other angles are zero; other_joints: argument of PlatformDynamics."""

    poses: dict
    twists: dict
    accelerations: dict
    other_joints: tuple


def random_states(dynamics, count, rng, reach=0.3):
    """Return platforms within their limits, the other joints within `reach` [rad or m] of their initial positions."""
    states = PlatformStates({}, {}, {}, ())
    for link, platform in zip(dynamics.robot.platform_links, dynamics.robot.platforms, strict=True):
        limits = [dynamics.robot.joints[number].limits for number in platform.joints]
        initial = dynamics.initial_joint_positions[list(platform.joints)]
        low, high = np.array([(limit.lower, limit.upper) for limit in limits]).T
        free = np.array([name in platform.free for name in COORDINATES])
        x = rng.uniform(np.where(free, low, initial), np.where(free, high, initial), (count, 6))
        states.poses[link] = np.array([placement(rotation_from_roll_pitch_yaw(*turn[::-1]), shift)
                                      for shift, turn in zip(x[:, :3], x[:, 3:], strict=True)])  # fmt: skip
        along = free[[0, 1, 2, 5, 4, 3]]  # roll about x, ... yaw about z
        states.twists[link], states.accelerations[link] = rng.uniform(-1, 1, (2, count, 6)) * along
    names = dynamics.platform.other_joint_names
    initial = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in names]]
    other_joints = rng.uniform(-1, 1, (3, count, len(names))) * [[[reach]], [[1.0]], [[1.0]]]
    other_joints[0] += initial
    unactuated = [name in dynamics.unactuated_joint_names for name in names]
    return states._replace(
        other_joints=(other_joints[0], other_joints[1], np.where(unactuated, np.nan, other_joints[2]))
    )
