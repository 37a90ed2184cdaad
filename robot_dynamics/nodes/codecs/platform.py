"""The platforms of a parallel robot in messages: their state stands in the field base, as that of a moving base."""

import numpy as np
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.geometry import read_link_motions, require_empty, write_transform, write_twist


def has_platform_motion(request, robot):
    """Whether a request tells how the platforms of a robot on the ground move, in the place of its joints."""
    return bool(robot.platforms) and not robot.moving_base and len(request.base.points) > 0


def read_platform_motion(request, order, times, namespace, has_accelerations, at_rest=False):
    """What PlatformDynamics.solve takes beside efforts and wrenches, as a mapping.

    order: JointOrder; times: of the points [ns]; accelerated: whether accelerations of the platforms are told, and not
    asked for; at_rest: whether velocities may be left out. Positions of joints may be given: they are where the
    search for closed loops begins. Joints that no platform places have positions, velocities and accelerations of
    their own.
    """
    points, robot, platform = request.trajectory.points, order.dynamics.robot, order.dynamics.platform
    told = read_link_motions(
        request.base, times, platform.link_names, namespace, f"the platform of {robot.name!r}", at_rest
    )
    acceleration = {link: base.acceleration for link, base in told.items() if base.acceleration is not None}
    if has_accelerations and not acceleration:
        raise InvalidInputError(
            "base.points[0].accelerations has 0 entries: the acceleration of the platform is needed"
        )
    if not has_accelerations and acceleration:
        raise InvalidInputError("base.points[0].accelerations has values: it is what is asked for, leave it empty")
    other_joints = [robot.joint_numbers[name] for name in platform.other_joint_names]
    seed = _told(points, "positions", order)
    if seed is not None and np.isnan(seed).all():
        seed = None
    rates = [_told_of_others(points, field, order, other_joints) for field in ("velocities", "accelerations")]
    motion = {
        "pose": {link: base.pose for link, base in told.items()},
        "twist": {link: base.twist for link, base in told.items()},
        "acceleration": acceleration,
    }
    if len(platform.link_names) == 1:
        motion = {key: value.get(platform.link_names[0]) for key, value in motion.items()}
    return {**motion, "acceleration": motion["acceleration"] if has_accelerations else None, "seed": seed,
            "other_joints": [None, *rates]}  # fmt: skip


def read_platform_at_rest(request, order, times, namespace):
    """What PlatformDynamics.equilibrium takes beside wrenches, as a mapping: see read_platform_motion."""
    told = read_platform_motion(request, order, times, namespace, has_accelerations=False, at_rest=True)
    twists = told["twist"].values() if isinstance(told["twist"], dict) else [told["twist"]]
    if np.any([twist.any() for twist in twists]):
        raise InvalidInputError("base has velocities that are not zero: the platform is at rest here, leave them empty")
    return {name: told[name] for name in ("pose", "seed", "other_joints")}


def _told(points, field, order):
    """(N, all joints) of a field, nan for joints of which it says nothing; None where it is empty in all points."""
    columns, size = [getattr(point, field) for point in points], len(order.requested_names)
    if not any(len(column) for column in columns):
        return None
    for number, column in enumerate(columns):
        if len(column) != size:
            raise InvalidInputError(
                f"points[{number}].{field} has {len(column)} values: {size} are needed, one for each joint, or none"
            )
    everyone = np.full((len(points), len(order.dynamics.all_joint_names)), np.nan)
    everyone[:, order.numbers] = columns
    return everyone


def _told_of_others(points, field, order, other_joints):
    """(N, k) of a field for joints `others` (numbers), which no platform places; None where it is empty."""
    if not other_joints:
        for number, point in enumerate(points):
            require_empty(point, field, f"points[{number}]", "base tells how the platform moves, and so all joints")
    everyone = _told(points, field, order)
    if everyone is None:
        return None
    for place, number in enumerate(order.numbers):
        wrong = ~np.isnan(everyone[:, number])
        if number not in other_joints and wrong.any():
            raise InvalidInputError(
                f"points[{np.argmax(wrong)}].{field}[{place}] has a value: base tells how the platform moves, and so "
                f"joint {order.requested_names[place]!r}. Give nan there"
            )
    return everyone[:, other_joints]


def write_platforms(points, motion, dynamics):
    """The MultiDOFJointTrajectory of the platforms: pose, twist and acceleration of each at each point of a trajectory.

    motion: JointMotion (N, all joints).
    """
    platform = dynamics.platform
    told = [platform.pose(motion.positions), platform.twist(motion), platform.acceleration(motion)]
    if len(platform.link_names) > 1:
        told = [np.stack([values[link] for link in platform.link_names], axis=1) for values in told]
    else:
        told = [values[:, None] for values in told]
    answer = MultiDOFJointTrajectory(joint_names=list(platform.link_names))
    for point, poses, twists, accelerations in zip(points, *told, strict=True):
        rotations = to_scipy_rotation(poses[:, :3, :3]).as_quat()
        answer.points.append(
            MultiDOFJointTrajectoryPoint(
                transforms=[write_transform(pose[:3, 3], turn) for pose, turn in zip(poses, rotations, strict=True)],
                velocities=[write_twist(twist) for twist in twists],
                accelerations=[write_twist(acceleration) for acceleration in accelerations],
                time_from_start=point.time_from_start,
            )
        )
    return answer
