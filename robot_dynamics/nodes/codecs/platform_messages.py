"""The platforms of a parallel robot in messages: the field `base` has their motion, as that of a moving base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics.array_types import Array
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.base import read_link_motions
from robot_dynamics.nodes.codecs.fields import require_empty
from robot_dynamics.nodes.codecs.geometry import write_transform, write_twist
from robot_dynamics_interfaces.srv import DirectDynamics, InverseDynamics, StaticEquilibrium

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.codecs.joint_order import JointOrder
    from robot_dynamics.results import JointMotion

Request: TypeAlias = InverseDynamics.Request | DirectDynamics.Request | StaticEquilibrium.Request

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


def has_platform_motion(request: Request, robot: Robot) -> bool:
    """Return whether a request gives the motion of the platforms of a robot on the ground, in place of its joints."""
    return bool(robot.platforms) and not robot.moving_base and len(request.base.points) > 0


def read_platform_motion(
    request: Request,
    order: JointOrder,
    times: Sequence[int],
    namespace: str,
    has_accelerations: bool,
    at_rest: bool = False,
) -> PlatformMotion:
    """Return the motion of the platforms at points at `times` [ns].

    has_accelerations: whether accelerations of the platforms are inputs, and not computed. at_rest: velocities may be
    left out. Positions of joints are starting values of the closure solver. Joints that no platform determines have
    positions, velocities and accelerations of their own. Raises InvalidInputError.
    """
    points = request.trajectory.points
    robot = order.dynamics.robot
    platform = order.dynamics.platform
    description = f"the platform of {robot.name!r}"
    motions = read_link_motions(request.base, times, platform.link_names, namespace, description, at_rest)
    accelerations = {
        link: np.asarray(base.acceleration) for link, base in motions.items() if base.acceleration is not None
    }
    if has_accelerations and not accelerations:
        raise InvalidInputError(
            "base.points[0].accelerations has 0 entries: the acceleration of the platform is needed"
        )
    if not has_accelerations and accelerations:
        raise InvalidInputError("base.points[0].accelerations has values: they are computed, leave it empty")
    other_joints = [robot.joint_numbers[name] for name in platform.other_joint_names]
    seed = _read_field(points, "positions", order)
    if seed is not None and np.isnan(seed).all():
        seed = None
    poses = {link: np.asarray(base.pose) for link, base in motions.items()}
    twists = {link: np.asarray(base.twist) for link, base in motions.items()}
    return PlatformMotion(
        pose=_of_platforms(poses, platform.link_names),
        twist=_of_platforms(twists, platform.link_names),
        acceleration=_of_platforms(accelerations, platform.link_names) if has_accelerations else None,
        seed=seed,
        other_joints=(
            None,
            _read_other_joints(points, "velocities", order, other_joints),
            _read_other_joints(points, "accelerations", order, other_joints),
        ),
    )


def read_platform_at_rest(request: Request, order: JointOrder, times: Sequence[int], namespace: str) -> PlatformMotion:
    """Return the poses of platforms at rest, as `read_platform_motion`; velocities that are not zero are refused."""
    motion = read_platform_motion(request, order, times, namespace, has_accelerations=False, at_rest=True)
    twists = motion.twist.values() if isinstance(motion.twist, dict) else [motion.twist]
    if np.any([twist.any() for twist in twists]):
        raise InvalidInputError("base has velocities that are not zero: the platform is at rest here, leave them empty")
    return motion


def write_platforms(
    points: Sequence[JointTrajectoryPoint], motion: JointMotion, dynamics: Dynamics
) -> MultiDOFJointTrajectory:
    """Return the trajectory of the platforms: pose, twist and acceleration of each at each point.

    motion: of all joints, (N, all joints).
    """
    platform = dynamics.platform
    links = platform.link_names
    poses = _stack_platforms(platform.pose(motion.positions), links)
    twists = _stack_platforms(platform.twist(motion), links)
    accelerations = _stack_platforms(platform.acceleration(motion), links)
    message = MultiDOFJointTrajectory(joint_names=list(links))
    for k, point in enumerate(points):
        quaternions = to_scipy_rotation(poses[k, :, :3, :3]).as_quat()
        message.points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[
                    write_transform(pose[:3, 3], quaternion)
                    for pose, quaternion in zip(poses[k], quaternions, strict=True)
                ],
                velocities=[write_twist(twist) for twist in twists[k]],
                accelerations=[write_twist(acceleration) for acceleration in accelerations[k]],
                time_from_start=point.time_from_start,
            )
        )
    return message


def _of_platforms(values: dict[str, Array], links: Sequence[str]) -> OfPlatforms:
    return values[links[0]] if len(links) == 1 else values


def _stack_platforms(values: OfPlatforms, links: Sequence[str]) -> Array:
    """Return (N, platforms, ...) of values of each platform."""
    if isinstance(values, dict):
        return np.stack([values[link] for link in links], axis=1)
    return values[:, None]


def _read_field(points: Sequence[JointTrajectoryPoint], field: str, order: JointOrder) -> Array | None:
    """Return (N, all joints) of a field, nan for joints that it leaves out; None if it is empty in all points."""
    columns = [getattr(point, field) for point in points]
    size = len(order.requested_names)
    if not any(len(column) for column in columns):
        return None
    for number, column in enumerate(columns):
        if len(column) != size:
            raise InvalidInputError(
                f"points[{number}].{field} has {len(column)} values: {size} are needed, one for each joint, or none"
            )
    values = np.full((len(points), len(order.dynamics.all_joint_names)), np.nan)
    values[:, order.numbers] = columns
    return values


def _read_other_joints(
    points: Sequence[JointTrajectoryPoint], field: str, order: JointOrder, other_joints: Sequence[int]
) -> Array | None:
    """Return (N, k) of a field for the joints (numbers) that no platform determines; None if it is empty."""
    if not other_joints:
        for number, point in enumerate(points):
            reason = "base has the motion of the platform, which determines all joints"
            require_empty(point, field, f"points[{number}]", reason)
    values = _read_field(points, field, order)
    if values is None:
        return None
    for index, number in enumerate(order.numbers):
        has_value = ~np.isnan(values[:, number])
        if number not in other_joints and has_value.any():
            raise InvalidInputError(
                f"points[{np.argmax(has_value)}].{field}[{index}] has a value: base has the motion of the platform, "
                f"which determines joint {order.requested_names[index]!r}. Give nan there"
            )
    return values[:, other_joints]
