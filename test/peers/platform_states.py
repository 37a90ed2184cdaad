"""Random states of parallel robots in the coordinates of their platforms."""

from typing import NamedTuple

import numpy as np

from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.model.platform import COORDINATES


class PlatformStates(NamedTuple):
    """Of each platform, {link: (count, ...)}: poses (4, 4), twists and accelerations (6,), these only along what is
    free where all angles that are not free are zero; others: what PlatformDynamics takes."""

    poses: dict
    twists: dict
    accelerations: dict
    other_joints: tuple


def random_states(dynamics, count, rng, reach=0.3):
    """Platforms within their limits, the other joints within `reach` [rad or m] of where they begin."""
    found = PlatformStates({}, {}, {}, ())
    for link, platform in zip(dynamics.robot.platform_links, dynamics.robot.platforms, strict=True):
        limits = [dynamics.robot.joints[number].limits for number in platform.joints]
        begin = dynamics.initial_joint_positions[list(platform.joints)]
        low, high = np.array([(limit.lower, limit.upper) for limit in limits]).T
        free = np.array([name in platform.free for name in COORDINATES])
        x = rng.uniform(np.where(free, low, begin), np.where(free, high, begin), (count, 6))
        found.poses[link] = np.array([placement(rotation_from_roll_pitch_yaw(*turn[::-1]), shift)
                                      for shift, turn in zip(x[:, :3], x[:, 3:], strict=True)])  # fmt: skip
        along = free[[0, 1, 2, 5, 4, 3]]  # roll about x, ... yaw about z
        found.twists[link], found.accelerations[link] = rng.uniform(-1, 1, (2, count, 6)) * along
    names = dynamics.platform.other_joint_names
    begin = dynamics.initial_joint_positions[[dynamics.robot.joint_numbers[name] for name in names]]
    other_joints = rng.uniform(-1, 1, (3, count, len(names))) * [[[reach]], [[1.0]], [[1.0]]]
    other_joints[0] += begin
    unactuated = [name in dynamics.unactuated_joint_names for name in names]
    return found._replace(
        other_joints=(other_joints[0], other_joints[1], np.where(unactuated, np.nan, other_joints[2]))
    )
