"""Maps over poses of a platform: what its legs reach, how well the motors hold it there, and what it takes of them."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.parallel.platform_dynamics import check_coordinate, coordinates_from_pose, pose_from_coordinates

COORDINATE_UNITS = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "pitch": "rad", "roll": "rad"}
BATCH_SIZE = 500  # poses that are computed at once
MAX_CONDITION_NUMBER = 1e6  # beyond which efforts are noise


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
    fixed_coordinates: dict
    reachable: np.ndarray
    within_limits: np.ndarray
    condition_number: np.ndarray
    efforts: np.ndarray
    positions: np.ndarray
    joint_names: tuple

    @property
    def is_nonsingular(self):
        """(...) whether the motors hold the platform there: reached, and not singular."""
        return self.condition_number < MAX_CONDITION_NUMBER


def pose_map(dynamics, axes, fixed_coordinates=None, acceleration=None, progress=None):
    """The PoseMap of a parallel robot over a grid.

    axes: {coordinate: values} of the grid, such as {"x": linspace(-0.1, 0.1, 41)}; at: {coordinate: value} of the
    others, where the robot begins if left out; acceleration: (6,) of the platform, in its own frame; progress: is
    called with the share that is done.

    Raises QuestionError for coordinates that the platform has not, or that its legs do not leave free, and for a
    coordinate in both.
    """
    joined = evaluate_over_grid(
        dynamics, axes, fixed_coordinates, lambda poses: _part(dynamics, poses, acceleration), progress
    )
    return PoseMap(dict(axes), _others(dynamics, axes, fixed_coordinates), *joined, dynamics.joint_names)


def evaluate_over_grid(dynamics, axes, fixed_coordinates, evaluate, progress=None):
    """Arrays over a grid, (..., *) each, of what a function gives for some of its poses (N, 4, 4), (N, *) each.

    axes, at and progress: as for `pose_map`.
    """
    platform = dynamics.platform
    if len(platform.link_names) > 1:
        raise InvalidInputError(
            f"{dynamics.robot.name!r} has platforms {', '.join(platform.link_names)}: a map is of one alone"
        )
    start, fixed_coordinates = _start(dynamics), _others(dynamics, axes, fixed_coordinates)
    grid = np.meshgrid(*axes.values(), indexing="ij")
    x = np.tile(list(start.values()), (grid[0].size, 1))
    for name, values in (*fixed_coordinates.items(), *zip(axes, map(np.ravel, grid), strict=True)):
        x[:, COORDINATES.index(name)] = values
    parts = []
    for first in range(0, len(x), BATCH_SIZE):
        parts.append(evaluate(pose_from_coordinates(x[first : first + BATCH_SIZE])))
        if progress is not None:
            progress(min(1.0, (first + BATCH_SIZE) / len(x)))
    return [np.concatenate(values).reshape(*grid[0].shape, *values[0].shape[1:]) for values in zip(*parts, strict=True)]


def _start(dynamics):
    """{coordinate: value} where the robot begins."""
    start = coordinates_from_pose(dynamics.platform.pose(dynamics.initial_joint_positions))
    return dict(zip(COORDINATES, start.tolist(), strict=True))


def _others(dynamics, axes, fixed_coordinates):
    """{coordinate: value} of the free coordinates that do not vary, checked."""
    fixed_coordinates, free = fixed_coordinates or {}, dynamics.platform.free
    for name in (*axes, *fixed_coordinates):
        check_coordinate(name, free)
        if name in axes and name in fixed_coordinates:
            raise InvalidInputError(
                f"{name} of the platform varies over the grid: it cannot stay at {fixed_coordinates[name]:g}"
            )
    start = _start(dynamics)
    return {name: fixed_coordinates.get(name, start[name]) for name in free if name not in axes}


def _part(dynamics, poses, acceleration):
    """(closes, reached, condition, efforts, positions) of some poses (N, 4, 4)."""
    q, reachable = dynamics.platform.reach(poses)
    motors = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    limits = [dynamics.robot.joints[number].limits for number in motors]
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    within_limits = reachable & np.all((lower <= q[:, motors]) & (q[:, motors] <= upper), axis=-1)
    condition_number, efforts = np.full(len(poses), np.nan), np.full((len(poses), len(motors)), np.nan)
    positions = np.where(within_limits[:, None], q[:, motors], np.nan)
    if within_limits.any():
        condition_number[within_limits] = dynamics.platform.condition_number(q[within_limits])
    held = np.flatnonzero(condition_number < MAX_CONDITION_NUMBER)
    if len(held):
        efforts[held] = dynamics.platform.inverse(poses[held], None, acceleration, seed=q[held])
    return reachable, within_limits, condition_number, efforts, positions
