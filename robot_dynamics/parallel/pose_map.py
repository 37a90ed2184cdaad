"""Maps over poses of a platform: reach of the legs, condition number, efforts and motor positions."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, cast

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.platform import COORDINATES
from robot_dynamics.notebook_display import notebook_html
from robot_dynamics.parallel.platform_motion import check_coordinate, coordinates_from_pose, pose_from_coordinates

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike, BoolArray, ScalarArray
    from robot_dynamics.dynamics import Dynamics

COORDINATE_UNITS = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "pitch": "rad", "roll": "rad"}
BATCH_SIZE = 500  # poses that are computed at once
MAX_CONDITION_NUMBER = 1e6  # above it, efforts are rounding errors


@dataclass(frozen=True, eq=False)
class PoseMap:
    """Properties of a parallel robot over a grid of poses; `pose_map` returns it.

    Attributes
    ----------
    axes : dict of str to array_like, shape (k,)
        Coordinates of the grid [m or rad], in the order of the dimensions (...) below.
    fixed_coordinates : dict of str to float
        The other free coordinates [m or rad].
    reachable : ndarray of bool, shape (...)
        Whether the legs reach the pose.
    within_limits : ndarray of bool, shape (...)
        Whether the legs reach the pose with the motors within their position limits.
    condition_number : (...)
        Condition number between motors and free coordinates; nan where not `within_limits`.
    efforts : (..., n)
        Efforts [N m or N] of the requested acceleration; nan where not `within_limits` or singular.
    positions : (..., n)
        Positions of the motors [rad or m]; nan where not `within_limits`.
    joint_names : tuple of str
        The n motors.
    """

    _repr_html_ = notebook_html

    axes: dict[str, ArrayLike]
    fixed_coordinates: dict[str, float]
    reachable: BoolArray
    within_limits: BoolArray
    condition_number: Array
    efforts: Array
    positions: Array
    joint_names: tuple[str, ...]

    @property
    def is_nonsingular(self) -> BoolArray:
        """(...) whether the motors hold the platform: the pose is within limits and not singular."""
        return self.condition_number < MAX_CONDITION_NUMBER


def pose_map(
    dynamics: Dynamics,
    axes: Mapping[str, ArrayLike],
    fixed_coordinates: Mapping[str, float] | None = None,
    acceleration: ArrayLike | None = None,
    progress: Callable[[float], object] | None = None,
) -> PoseMap:
    """Compute reach, condition number and efforts of a parallel robot over a grid of poses.

    Parameters
    ----------
    dynamics : Dynamics
        Of a robot with one platform.
    axes : mapping of str to array_like, shape (k,)
        Values of the coordinates of the grid [m or rad], such as ``{"x": linspace(-0.1, 0.1, 41)}``.
    fixed_coordinates : mapping of str to float, optional
        Values of the other free coordinates. Default: those of the initial positions.
    acceleration : array_like, shape (6,), optional
        Acceleration of the platform in its frame [m/s², rad/s²]. Default: at rest.
    progress : callable, optional
        Called with the completed fraction, 0 to 1.

    Returns
    -------
    PoseMap

    Raises
    ------
    InvalidInputError
        The robot has no platform or several; a coordinate is unknown, not free, or both varied and fixed.
    """
    reachable, within_limits, condition_number, efforts, positions = evaluate_over_grid(
        dynamics,
        axes,
        fixed_coordinates,
        lambda poses: _evaluate_poses(dynamics, poses, acceleration),
        progress,
    )
    fixed = complete_coordinates(dynamics, axes, fixed_coordinates)
    return PoseMap(
        dict(axes), fixed, reachable, within_limits, condition_number, efforts, positions, dynamics.joint_names
    )


def check_dynamics(dynamics: Dynamics) -> None:
    """Refuse what is no Dynamics, such as a Robot. Raises InvalidInputError."""
    if not hasattr(dynamics, "robot"):
        raise InvalidInputError(f"a map is of Dynamics(robot), not of {dynamics!r:.60}")


def evaluate_over_grid(
    dynamics: Dynamics,
    axes: Mapping[str, ArrayLike],
    fixed_coordinates: Mapping[str, float] | None,
    evaluate: Callable[[Array], Sequence[ScalarArray]],
    progress: Callable[[float], object] | None = None,
) -> list[ScalarArray]:
    """Return arrays (*grid, ...) of a function that gives arrays (N, ...) of poses (N, 4, 4).

    axes, fixed_coordinates and progress: as for `pose_map`.
    """
    check_dynamics(dynamics)
    platform = dynamics.platform
    if len(platform.link_names) > 1:
        raise InvalidInputError(
            f"{dynamics.robot.name!r} has platforms {', '.join(platform.link_names)}: a map is of one alone"
        )
    initial = _initial_coordinates(dynamics)
    fixed = complete_coordinates(dynamics, axes, fixed_coordinates)
    grid = np.meshgrid(*axes.values(), indexing="ij")
    x = np.tile(list(initial.values()), (grid[0].size, 1))
    for name, value in fixed.items():
        x[:, COORDINATES.index(name)] = value
    for name, values in zip(axes, grid, strict=True):
        x[:, COORDINATES.index(name)] = values.ravel()
    batches = []
    for first in range(0, len(x), BATCH_SIZE):
        batches.append(evaluate(pose_from_coordinates(x[first : first + BATCH_SIZE])))
        if progress is not None:
            progress(min(1.0, (first + BATCH_SIZE) / len(x)))
    return [
        np.concatenate(arrays).reshape(*grid[0].shape, *arrays[0].shape[1:]) for arrays in zip(*batches, strict=True)
    ]


def _initial_coordinates(dynamics: Dynamics) -> dict[str, float]:
    """Return the coordinates of the platform at the initial positions."""
    pose = cast(Array, dynamics.platform.pose(dynamics.initial_joint_positions))  # of one platform
    return dict(zip(COORDINATES, coordinates_from_pose(pose).tolist(), strict=True))


def complete_coordinates(
    dynamics: Dynamics, axes: Mapping[str, ArrayLike], fixed_coordinates: Mapping[str, float] | None
) -> dict[str, float]:
    """Return the values of all free coordinates that do not vary, checked."""
    fixed = fixed_coordinates or {}
    free = cast("tuple[str, ...]", dynamics.platform.free)  # of one platform
    for name in (*axes, *fixed):
        check_coordinate(name, free)
        if name in axes and name in fixed:
            raise InvalidInputError(f"{name} of the platform varies over the grid: it cannot stay at {fixed[name]:g}")
    initial = _initial_coordinates(dynamics)
    return {name: fixed.get(name, initial[name]) for name in free if name not in axes}


def _evaluate_poses(dynamics: Dynamics, poses: Array, acceleration: ArrayLike | None) -> tuple[ScalarArray, ...]:
    """Return reachable, within_limits, condition_number, efforts and positions of poses (N, 4, 4)."""
    q, reachable = dynamics.platform.reach(poses)
    motors = [dynamics.robot.joint_numbers[name] for name in dynamics.joint_names]
    limits = [dynamics.robot.joints[number].limits for number in motors]
    lower, upper = np.array([(limit.lower, limit.upper) for limit in limits]).T
    within_limits = reachable & np.all((lower <= q[:, motors]) & (q[:, motors] <= upper), axis=-1)
    condition_number = np.full(len(poses), np.nan)
    efforts = np.full((len(poses), len(motors)), np.nan)
    positions = np.where(within_limits[:, None], q[:, motors], np.nan)
    if within_limits.any():
        condition_number[within_limits] = dynamics.platform.condition_number(q[within_limits])
    nonsingular = np.flatnonzero(condition_number < MAX_CONDITION_NUMBER)
    if len(nonsingular):
        efforts[nonsingular] = dynamics.platform.inverse(poses[nonsingular], None, acceleration, seed=q[nonsingular])
    return reachable, within_limits, condition_number, efforts, positions
