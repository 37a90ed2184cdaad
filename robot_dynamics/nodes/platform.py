"""The platform of a parallel robot in messages: its state stands in the field base, as that of a moving base does."""

import numpy as np
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics.errors import QuestionError
from robot_dynamics.nodes.messages import read_points, read_positions, require_empty, write_transform, write_twist


def is_asked_by_platform(request, robot):
    """Whether a request tells how the platform of a robot on the ground moves, in the place of its joints."""
    return robot.platform is not None and not robot.moving_base and len(request.base.points) > 0


def read_platform_motion(request, order, times, namespace, accelerated):
    """(q, qd, qdd): positions (N, all joints), rates and accelerations (N, n) of the independent joints.

    order: JointOrder; times: of the points [ns]; accelerated: whether the acceleration of the platform is told, and not
    asked for. Positions of all joints may be given: they are where the search for closed loops begins.
    """
    dynamics, points = order.dynamics, request.trajectory.points
    robot = dynamics.robot
    platform = robot.links[robot.platform.link].name
    for number, point in enumerate(points):
        for field in ("velocities", "accelerations"):
            require_empty(point, field, f"points[{number}]", "base tells how the platform moves, and so all joints")
    told = read_points(request.base, times, platform, namespace, f"the platform of {robot.name!r}")
    if accelerated and told.acceleration is None:
        raise QuestionError("base.points[0].accelerations has 0 entries: the acceleration of the platform is needed")
    if not accelerated and told.acceleration is not None:
        raise QuestionError("base.points[0].accelerations has values: it is what is asked for, leave it empty")
    seed = None
    if any(len(point.positions) for point in points):
        seed = read_positions(points, order)
    q, qd, qdd = dynamics.platform.motion(told.pose, told.twist, told.acceleration, seed)
    independent = [robot.joint_numbers[name] for name in dynamics.joint_names]
    driven = [robot.joints[number].actuated for number in independent]
    return q, qd[:, independent], np.where(driven, qdd[:, independent], 0.0)


def write_platform(points, motion, dynamics):
    """The MultiDOFJointTrajectory of the platform: pose, twist and acceleration at each point of a trajectory.

    motion: JointMotion (N, all joints).
    """
    platform, robot = dynamics.platform, dynamics.robot
    poses = platform.pose(motion.positions)
    rotations = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    columns = zip(points, poses, rotations, platform.twist(motion), platform.acceleration(motion), strict=True)
    answer = MultiDOFJointTrajectory(joint_names=[robot.links[robot.platform.link].name])
    answer.points = [
        MultiDOFJointTrajectoryPoint(
            transforms=[write_transform(pose[:3, 3], rotation)],
            velocities=[write_twist(twist)],
            accelerations=[write_twist(acceleration)],
            time_from_start=point.time_from_start,
        )
        for point, pose, rotation, twist, acceleration in columns
    ]
    return answer
