"""Maps over poses of a platform: what its legs reach, how well the motors hold it there, and what it takes of them."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import QuestionError, unknown_name
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.platform import coordinates, pose_of

TOGETHER = 500  # poses that are computed at once
WORST_CONDITION = 1e6  # beyond which efforts are noise


@dataclass(frozen=True, eq=False)
class PoseMap:
    """axes: {coordinate: (k,) values [m or rad]}, in the order of the dimensions of what follows.

    reached: (...) whether the legs reach the pose, their motors within their limits; condition: (...) of the motors'
    hold, nan where it is not reached; efforts: (..., n) [N m or N] that hold the platform there, or give it the
    acceleration asked for; nan where it is not reached or singular; positions: (..., n) of the motors' joints.
    """

    axes: dict
    reached: np.ndarray
    condition: np.ndarray
    efforts: np.ndarray
    positions: np.ndarray
    joint_names: tuple


def pose_map(dynamics, axes, at=None, acceleration=None, progress=None):
    """The PoseMap of a parallel robot over a grid.

    axes: {coordinate: values} of the grid, such as {"x": linspace(-0.1, 0.1, 41)}; at: {coordinate: value} of the
    others, where the robot begins if left out; acceleration: (6,) of the platform, in its own frame; progress: is
    called with the share that is done.

    Raises QuestionError for coordinates that the platform has not.
    """
    platform = dynamics.platform
    for name in (*axes, *(at or {})):
        if name not in COORDINATES:
            raise QuestionError(unknown_name("coordinate of a platform", name, COORDINATES))
    start = coordinates(platform.pose(dynamics.closed_positions))
    grid = np.meshgrid(*axes.values(), indexing="ij")
    x = np.tile(start, (grid[0].size, 1))
    for name, value in {
        **(at or {}),
        **{name: values.ravel() for name, values in zip(axes, grid, strict=True)},
    }.items():
        x[:, COORDINATES.index(name)] = value
    parts = []
    for first in range(0, len(x), TOGETHER):
        parts.append(_part(dynamics, pose_of(x[first : first + TOGETHER]), acceleration))
        if progress is not None:
            progress(min(1.0, (first + TOGETHER) / len(x)))
    joined = (
        np.concatenate(values).reshape(*grid[0].shape, *values[0].shape[1:]) for values in zip(*parts, strict=True)
    )
    return PoseMap(dict(axes), *joined, dynamics.joint_names)


def _part(dynamics, poses, acceleration):
    """(reached, condition, efforts, positions) of some poses (N, 4, 4)."""
    q, reached = dynamics.platform.reach(poses)
    motors = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    limits = [dynamics.robot.joints[number].limits for number in motors]
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    reached = reached & np.all((lower <= q[:, motors]) & (q[:, motors] <= upper), axis=-1)
    condition, efforts = np.full(len(poses), np.nan), np.full((len(poses), len(motors)), np.nan)
    positions = np.where(reached[:, None], q[:, motors], np.nan)
    if reached.any():
        condition[reached] = dynamics.platform.condition(q[reached])
    held = np.flatnonzero(condition < WORST_CONDITION)
    if len(held):
        efforts[held] = dynamics.platform.inverse(poses[held], None, acceleration, seed=q[held])
    return reached, condition, efforts, positions
