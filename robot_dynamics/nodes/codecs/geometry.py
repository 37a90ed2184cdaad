"""Poses, twists and accelerations of one body as messages and as arrays.

A pose is a homogeneous matrix (4, 4); a twist or an acceleration is (6,), linear before angular.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np
from geometry_msgs.msg import Accel, Pose, Transform, Twist, Vector3
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.fields import require_finite

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array

QUATERNION_NORM_TOLERANCE = 1e-3  # accepted difference of the norm of a quaternion from 1; within it, it is normalised


def read_poses(
    transforms: Sequence[Transform],
    location: str,
    fields: tuple[str, str] = ("transforms[0].translation", "transforms[0].rotation"),
    first: int = 0,
) -> Array:
    """Return homogeneous matrices (N, 4, 4) of geometry_msgs/Transform.

    location: format of the number of a transform; fields: names of position and orientation; first: number of the
    first transform; all are for errors. Raises InvalidInputError.
    """
    quaternions = np.array([[t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w] for t in transforms])
    positions = np.array([[t.translation.x, t.translation.y, t.translation.z] for t in transforms])
    return to_matrices(positions, quaternions, (f"{location}.{fields[0]}", f"{location}.{fields[1]}"), first)


def to_matrices(positions: Array, quaternions: Array, locations: tuple[str, str], first: int = 0) -> Array:
    """Return homogeneous matrices (N, 4, 4) of positions (N, 3) and quaternions (N, 4) x, y, z, w.

    locations: formats of the number of a pose for its position and its quaternion; first: number of the first pose;
    both are for errors. Raises InvalidInputError.
    """
    poses: Array = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    norms = np.linalg.norm(quaternions, axis=1)
    invalid = np.flatnonzero(~(np.abs(norms - 1) < QUATERNION_NORM_TOLERANCE))
    if len(invalid):
        row = int(invalid[0])
        raise InvalidInputError(f"{locations[1].format(first + row)} has norm {norms[row]:.6g}: 1 is needed")
    poses[:, :3, :3] = Rotation.from_quat(quaternions).as_matrix()
    require_finite(poses, locations[0], first)
    return poses


def read_pose(pose: Pose, location: str) -> Array:
    """Return the homogeneous matrix (4, 4) of a geometry_msgs/Pose; `location` is its name in errors."""
    position = pose.position
    orientation = pose.orientation
    transform = write_transform(
        (position.x, position.y, position.z), (orientation.x, orientation.y, orientation.z, orientation.w)
    )
    matrix: Array = read_poses([transform], location, ("position", "orientation"))[0]
    return matrix


def read_twists(twists: Sequence[Twist], location: str, first: int = 0) -> Array:
    """Return (N, 6) of geometry_msgs/Twist.

    location: format of the number of a twist; first: number of the first twist; both are for errors.
    """
    values = np.array(
        [[t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z] for t in twists], dtype=float
    )
    require_finite(values, location, first)
    return values


def read_twist(message: Twist, location: str) -> Array:
    """Return (6,) of a geometry_msgs/Twist; `location` is its name in errors."""
    twist: Array = read_twists([message], location)[0]
    return twist


def write_pose(position: ArrayLike, quaternion: ArrayLike) -> Pose:
    """Return the geometry_msgs/Pose of a position (3,) and a quaternion x, y, z, w."""
    message = Pose()
    message.position.x, message.position.y, message.position.z = _floats(position)
    orientation = message.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = _floats(quaternion)
    return message


def write_transform(position: ArrayLike, quaternion: ArrayLike) -> Transform:
    """Return the geometry_msgs/Transform of a position (3,) and a quaternion x, y, z, w."""
    message = Transform()
    message.translation.x, message.translation.y, message.translation.z = _floats(position)
    rotation = message.rotation
    rotation.x, rotation.y, rotation.z, rotation.w = _floats(quaternion)
    return message


def write_twist(values: ArrayLike) -> Twist:
    """Return the geometry_msgs/Twist of (6,)."""
    return _fill_linear_angular(Twist(), values)


def write_accel(values: ArrayLike) -> Accel:
    """Return the geometry_msgs/Accel of (6,)."""
    return _fill_linear_angular(Accel(), values)


class _LinearAngular(Protocol):
    linear: Vector3
    angular: Vector3


LinearAngular = TypeVar("LinearAngular", bound=_LinearAngular)


def _fill_linear_angular(message: LinearAngular, values: ArrayLike) -> LinearAngular:
    linear = message.linear
    angular = message.angular
    linear.x, linear.y, linear.z, angular.x, angular.y, angular.z = _floats(values)
    return message


def _floats(values: ArrayLike) -> list[float]:
    floats: list[float] = np.asarray(values, dtype=float).tolist()
    return floats
