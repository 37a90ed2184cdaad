"""Maps over poses of a platform: what its legs reach, how well the motors hold it there, and what it takes of them."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import QuestionError
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.platform import check_coordinate, coordinates, pose_of

UNITS = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "pitch": "rad", "roll": "rad"}
TOGETHER = 500  # poses that are computed at once
WORST_CONDITION = 1e6  # beyond which efforts are noise


@dataclass(frozen=True, eq=False)
class PoseMap:
    """axes: {coordinate: (k,) values [m or rad]}, in the order of the dimensions of what follows; at: {coordinate:
    value} of the others that the legs leave free.

    closes: (...) whether the legs reach the pose; reached: (...) and that with their motors within their limits;
    condition: (...) of the motors' hold, nan where it is not reached; efforts: (..., n) [N m or N] that hold the
    platform there, or give it the acceleration asked for; nan where it is not reached or singular; positions: (..., n)
    of the motors' joints.
    """

    axes: dict
    at: dict
    closes: np.ndarray
    reached: np.ndarray
    condition: np.ndarray
    efforts: np.ndarray
    positions: np.ndarray
    joint_names: tuple

    @property
    def held(self):
        """(...) whether the motors hold the platform there: reached, and not singular."""
        return self.condition < WORST_CONDITION


def pose_map(dynamics, axes, at=None, acceleration=None, progress=None):
    """The PoseMap of a parallel robot over a grid.

    axes: {coordinate: values} of the grid, such as {"x": linspace(-0.1, 0.1, 41)}; at: {coordinate: value} of the
    others, where the robot begins if left out; acceleration: (6,) of the platform, in its own frame; progress: is
    called with the share that is done.

    Raises QuestionError for coordinates that the platform has not, or that its legs do not leave free, and for a
    coordinate in both.
    """
    joined = over_grid(dynamics, axes, at, lambda poses: _part(dynamics, poses, acceleration), progress)
    return PoseMap(dict(axes), _others(dynamics, axes, at), *joined, dynamics.joint_names)


def over_grid(dynamics, axes, at, part, progress=None):
    """Arrays over a grid, (..., *) each, of what a function gives for some of its poses (N, 4, 4), (N, *) each.

    axes, at and progress: as for `pose_map`.
    """
    platform = dynamics.platform
    if len(platform.links) > 1:
        raise QuestionError(f"{dynamics.robot.name!r} has platforms {', '.join(platform.links)}: a map is of one alone")
    start, at = _start(dynamics), _others(dynamics, axes, at)
    grid = np.meshgrid(*axes.values(), indexing="ij")
    x = np.tile(list(start.values()), (grid[0].size, 1))
    for name, values in (*at.items(), *zip(axes, map(np.ravel, grid), strict=True)):
        x[:, COORDINATES.index(name)] = values
    parts = []
    for first in range(0, len(x), TOGETHER):
        parts.append(part(pose_of(x[first : first + TOGETHER])))
        if progress is not None:
            progress(min(1.0, (first + TOGETHER) / len(x)))
    return [np.concatenate(values).reshape(*grid[0].shape, *values[0].shape[1:]) for values in zip(*parts, strict=True)]


def _start(dynamics):
    """{coordinate: value} where the robot begins."""
    start = coordinates(dynamics.platform.pose(dynamics.closed_positions))
    return dict(zip(COORDINATES, start.tolist(), strict=True))


def _others(dynamics, axes, at):
    """{coordinate: value} of the free coordinates that do not vary, checked."""
    at, free = at or {}, dynamics.platform.free
    for name in (*axes, *at):
        check_coordinate(name, free)
        if name in axes and name in at:
            raise QuestionError(f"{name} of the platform varies over the grid: it cannot stay at {at[name]:g}")
    start = _start(dynamics)
    return {name: at.get(name, start[name]) for name in free if name not in axes}


def _part(dynamics, poses, acceleration):
    """(closes, reached, condition, efforts, positions) of some poses (N, 4, 4)."""
    q, closes = dynamics.platform.reach(poses)
    motors = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    limits = [dynamics.robot.joints[number].limits for number in motors]
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    reached = closes & np.all((lower <= q[:, motors]) & (q[:, motors] <= upper), axis=-1)
    condition, efforts = np.full(len(poses), np.nan), np.full((len(poses), len(motors)), np.nan)
    positions = np.where(reached[:, None], q[:, motors], np.nan)
    if reached.any():
        condition[reached] = dynamics.platform.condition(q[reached])
    held = np.flatnonzero(condition < WORST_CONDITION)
    if len(held):
        efforts[held] = dynamics.platform.inverse(poses[held], None, acceleration, seed=q[held])
    return closes, reached, condition, efforts, positions
