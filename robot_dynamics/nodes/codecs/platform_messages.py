"""The platforms of a parallel robot in messages: the field `base` has their motion, as that of a moving base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from robot_dynamics.array_types import Array
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.geometry import write_transform, write_twist
from robot_dynamics.nodes.codecs.joint_values import read_optional_field

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.codecs.base import LinkMotions
    from robot_dynamics.nodes.codecs.joint_order import JointOrder
    from robot_dynamics.nodes.codecs.joint_values import JointFields
    from robot_dynamics.results import JointMotion

OfPlatforms: TypeAlias = Array | dict[str, Array]
"""An array of the only platform, or {link: array} of many."""


@dataclass(frozen=True, eq=False)
class PlatformMotion:
    """Arguments of PlatformDynamics that a request gives.

    Attributes
    ----------
    pose : (N, 4, 4) of each platform.
    twist, acceleration : (N, 6) of each platform; acceleration None if it is computed.
    seed : (N, all joints), nan for joints without a value; None if the request has no positions.
    other_joints : positions, velocities and accelerations (N, k) of the joints that no platform determines, or None.
    """

    pose: OfPlatforms
    twist: OfPlatforms
    acceleration: OfPlatforms | None
    seed: Array | None
    other_joints: tuple[Array | None, Array | None, Array | None]


def read_platform_motion(
    fields: JointFields, motions: LinkMotions, rows: slice, order: JointOrder, has_accelerations: bool
) -> PlatformMotion:
    """Return the motion of the platforms at a range of points.

    has_accelerations: whether accelerations of the platforms are inputs, and not computed. Positions of joints are
    starting values of the closure solver. Joints that no platform determines have positions, velocities and
    accelerations of their own. Raises InvalidInputError.
    """
    if has_accelerations and not motions.has_acceleration:
        raise InvalidInputError(
            f"{motions.acceleration_location} has 0 entries: the acceleration of the platform is needed"
        )
    if not has_accelerations and motions.has_acceleration:
        raise InvalidInputError(f"{motions.acceleration_location} has values: they are computed, leave it empty")
    robot = order.dynamics.robot
    platform = order.dynamics.platform
    bases = motions.read(rows)
    other_joints = [robot.joint_numbers[name] for name in platform.other_joint_names]
    seed = read_optional_field(fields, "positions", order)
    if seed is not None and np.isnan(seed).all():
        seed = None
    poses = {link: np.asarray(base.pose) for link, base in bases.items()}
    twists = {link: np.asarray(base.twist) for link, base in bases.items()}
    accelerations = {link: np.asarray(base.acceleration) for link, base in bases.items()} if has_accelerations else {}
    return PlatformMotion(
        pose=_of_platforms(poses, platform.link_names),
        twist=_of_platforms(twists, platform.link_names),
        acceleration=_of_platforms(accelerations, platform.link_names) if has_accelerations else None,
        seed=seed,
        other_joints=(
            None,
            _read_other_joints(fields, "velocities", order, other_joints),
            _read_other_joints(fields, "accelerations", order, other_joints),
        ),
    )


def require_rest(motion: PlatformMotion) -> None:
    """Refuse the motion of platforms with velocities that are not zero. Raises InvalidInputError."""
    twists = motion.twist.values() if isinstance(motion.twist, dict) else [motion.twist]
    if np.any([twist.any() for twist in twists]):
        raise InvalidInputError("base has velocities that are not zero: the platform is at rest here, leave them empty")


def platform_rows(motion: JointMotion, dynamics: Dynamics) -> tuple[Array, Array, Array, Array]:
    """Return the motion of the platforms (N, platforms, ...) in a motion of all joints (N, all joints).

    Positions (3) and quaternions (4) x, y, z, w; twists (6); accelerations (6).
    """
    platform = dynamics.platform
    links = platform.link_names
    poses = _stack_platforms(platform.pose(motion.positions), links)
    quaternions = to_scipy_rotation(poses[..., :3, :3].reshape(-1, 3, 3)).as_quat().reshape(*poses.shape[:2], 4)
    twists = _stack_platforms(platform.twist(motion), links)
    accelerations = _stack_platforms(platform.acceleration(motion), links)
    return poses[..., :3, 3], quaternions, twists, accelerations


def write_platform_points(
    points: Sequence[JointTrajectoryPoint], motion: JointMotion, dynamics: Dynamics
) -> list[MultiDOFJointTrajectoryPoint]:
    """Return pose, twist and acceleration of each platform at each point; motion: of all joints, (N, all joints)."""
    positions, quaternions, twists, accelerations = platform_rows(motion, dynamics)
    return [
        MultiDOFJointTrajectoryPoint(
            transforms=[
                write_transform(position, quaternion)
                for position, quaternion in zip(positions[k], quaternions[k], strict=True)
            ],
            velocities=[write_twist(twist) for twist in twists[k]],
            accelerations=[write_twist(acceleration) for acceleration in accelerations[k]],
            time_from_start=point.time_from_start,
        )
        for k, point in enumerate(points)
    ]


def _of_platforms(values: dict[str, Array], links: Sequence[str]) -> OfPlatforms:
    return values[links[0]] if len(links) == 1 else values


def _stack_platforms(values: OfPlatforms, links: Sequence[str]) -> Array:
    """Return (N, platforms, ...) of values of each platform."""
    if isinstance(values, dict):
        return np.stack([values[link] for link in links], axis=1)
    return values[:, None]


def _read_other_joints(fields: JointFields, field: str, order: JointOrder, other_joints: Sequence[int]) -> Array | None:
    """Return (N, k) of a field for the joints (numbers) that no platform determines; None if it is empty."""
    if not other_joints:
        fields.require_empty(field, "base has the motion of the platform, which determines all joints")
    values = read_optional_field(fields, field, order)
    if values is None:
        return None
    for index, number in enumerate(order.numbers):
        has_value = ~np.isnan(values[:, number])
        if number not in other_joints and has_value.any():
            raise InvalidInputError(
                f"{fields.locate(field, int(np.argmax(has_value)), index)} has a value: base has the motion of the "
                f"platform, which determines joint {order.requested_names[index]!r}. Give nan there"
            )
    return values[:, other_joints]
