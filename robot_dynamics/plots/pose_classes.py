"""Classes of the poses of a map, and what a map draws at those in reach."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.parallel.pose_map import PoseMap

POSE_CLASSES = {
    "in reach": "#4c9f70",
    "singular: the motors do not hold it": "#c1272d",
    "motors beyond their limits": "#dddddd",
    "out of reach of the legs": "#a6a6a6",
}
POSE_CLASS_COLOURS = list(POSE_CLASSES.values())
HATCHES = ("", "xxxx", "///", "....")
"""Of the classes, which differ by them in a picture without colours."""


def pose_classes(result: PoseMap) -> Array:
    """Return the index in POSE_CLASSES of each pose."""
    return np.select([result.is_nonsingular, result.within_limits, result.reachable], [0.0, 1.0, 2.0], 3.0)


def largest_efforts(result: PoseMap, robot: Robot | None) -> tuple[Array, str]:
    """Return the largest effort of any motor at each pose, nan where there is none, and its unit."""
    kinds = () if robot is None else [robot.joints[robot.joint_numbers[name]].prismatic for name in result.joint_names]
    unit = "N or N m" if robot is None or any(kinds) != all(kinds) else "N" if all(kinds) else "N m"
    efforts = np.abs(np.where(result.is_nonsingular[..., None], result.efforts, 0)).max(axis=-1)
    return np.where(result.is_nonsingular, efforts, np.nan), unit
