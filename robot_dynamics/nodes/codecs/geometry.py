"""Bodies in messages and as arrays: poses, twists, wrenches, bases. What the fields mean stands in the .srv files."""

import numpy as np
from geometry_msgs.msg import Accel, Pose, Transform, Twist, Wrench, WrenchStamped
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from robot_dynamics.dynamics import Base
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.joint_order import resolve_name

QUATERNION_NORM_TOLERANCE = 1e-3  # how far the norm of a quaternion may be from 1: it is normalised, not guessed


def require_empty(message, field, location, why):
    """Refuse a message in which a field has values that have no part in the question."""
    if len(getattr(message, field)):
        raise InvalidInputError(f"{location}.{field} has values: {why}, leave it empty")


def read_base(base, times, robot, namespace, at_rest=False):
    """The Base of a MultiDOFJointTrajectory, or None where the base of the robot is fixed.

    times: time_from_start of each point of the joint trajectory [ns]. at_rest: velocities may be left out.
    """
    if not robot.moving_base:
        return _no_base(robot, base.points or base.joint_names)
    description = f"the base of {robot.name!r}"
    return read_link_motions(base, times, (robot.base_link,), namespace, description, at_rest)[robot.base_link]


def read_link_motions(base, times, links, namespace, description, at_rest=False):
    """{link: Base} of a MultiDOFJointTrajectory that tells the motion of links, at points at `times` [ns].

    whose: what to call the links in errors.
    """
    names = [resolve_name("base link", name, links, namespace) for name in base.joint_names] or list(links)
    if sorted(names) != sorted(links):
        told = f"base.joint_names are {', '.join(names)}"
        raise InvalidInputError(f"{told}: each of {', '.join(links)} is needed once, or none of the names")
    if len(base.points) != len(times):
        raise InvalidInputError(
            f"base.points has {len(base.points)} entries: {description} moves, so its pose and twist are "
            f"needed at each of {len(times)} points"
        )
    told = [len(point.accelerations) > 0 for point in base.points]
    if any(told) and not all(told):
        number = told.index(False)
        raise InvalidInputError(f"base.points[{number}].accelerations has 0 entries: give it at all points or at none")
    for number, (point, time) in enumerate(zip(base.points, times, strict=True)):
        if to_nanoseconds(point.time_from_start) not in (0, time):
            raise InvalidInputError(
                f"base.points[{number}].time_from_start differs from that of the trajectory's point"
            )
    return {link: _base(base.points, "base.points[{}]", at_rest, k, names) for k, link in enumerate(names)}


def read_base_point(point, robot):
    """The Base of one MultiDOFJointTrajectoryPoint, or None where the base of the robot is fixed."""
    if not robot.moving_base:
        return _no_base(robot, point.transforms or point.velocities)
    base = _base([point], "base")
    return Base(base.pose[0], base.twist[0])


def _no_base(robot, given):
    """None, the base of a robot whose base is fixed; refused where the message has one all the same."""
    if given:
        raise InvalidInputError(f"the base of {robot.name!r} is fixed: leave the field base empty")


def _base(points, location, at_rest=False, entry=0, links=("the base link",)):
    """The Base of an entry of MultiDOFJointTrajectoryPoints, each of which has for each of the links one pose, one
    twist and one acceleration or none."""
    accelerated = any(len(point.accelerations) for point in points)
    moves = not at_rest or any(len(point.velocities) for point in points)
    for field in ("transforms", *(["velocities"] if moves else []), *(["accelerations"] if accelerated else [])):
        for number, point in enumerate(points):
            if len(getattr(point, field)) != len(links):
                found = f"{location.format(number)}.{field} has {len(getattr(point, field))} entries"
                needed = "one is needed" if len(links) == 1 else f"{len(links)} are needed"
                raise InvalidInputError(f"{found}: {needed}, of {', '.join(links)}")

    def twists(field):
        return _twists([getattr(point, field)[entry] for point in points], f"{location}.{field}[{entry}]")

    return Base(
        pose=_poses([point.transforms[entry] for point in points], location),
        twist=twists("velocities") if moves else np.zeros(6),
        acceleration=twists("accelerations") if accelerated else None,
    )


def _poses(transforms, location, names=("transforms[0].translation", "transforms[0].rotation")):
    """Homogeneous matrices (N, 4, 4) of geometry_msgs/Transform. names: of their fields, for errors."""
    rotations = np.array([[t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w] for t in transforms])
    poses = np.tile(np.eye(4), (len(transforms), 1, 1))
    poses[:, :3, 3] = [[t.translation.x, t.translation.y, t.translation.z] for t in transforms]
    norms = np.linalg.norm(rotations, axis=1)
    wrong = np.flatnonzero(~(np.abs(norms - 1) < QUATERNION_NORM_TOLERANCE))
    if len(wrong):
        found = f"{location.format(wrong[0])}.{names[1]} has norm {norms[wrong[0]]:.6g}"
        raise InvalidInputError(f"{found}: 1 is needed")
    poses[:, :3, :3] = Rotation.from_quat(rotations).as_matrix()
    _require_finite(poses, f"{location}.{names[0]}")
    return poses


def read_pose(pose, location):
    """Homogeneous matrix (4, 4) of a geometry_msgs/Pose; place: where in the message it is, for errors."""
    position, q = pose.position, pose.orientation
    transform = write_transform((position.x, position.y, position.z), (q.x, q.y, q.z, q.w))
    return _poses([transform], location, ("position", "orientation"))[0]


def _twists(twists, location):
    values = np.array(
        [[t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z] for t in twists], dtype=float
    )
    _require_finite(values, location)
    return values


def _require_finite(values, location):
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        raise InvalidInputError(f"{location.format(wrong[0][0])} is not finite")


def read_wrenches(stamped, times, robot, namespace):
    """{link name: (N, 6)} of geometry_msgs/WrenchStamped[], for points at `times` [ns]. Wrenches on a link add up."""
    times, wrenches = np.asarray(times), {}
    for number, wrench in enumerate(stamped):
        try:
            link = resolve_name("link", wrench.header.frame_id, robot.frames_by_name, namespace)
        except InvalidInputError as error:
            raise InvalidInputError(f"external_wrenches[{number}].header.frame_id: {error}") from None
        values = read_wrench(wrench.wrench, f"external_wrenches[{number}] on {link!r}")
        stamp = to_nanoseconds(wrench.header.stamp)
        if wrench.header.stamp.sec < 0 or wrench.header.stamp.nanosec >= 1_000_000_000:
            raise InvalidInputError(f"external_wrenches[{number}].header.stamp is no time since a start")
        acts = np.ones(len(times), bool) if stamp == 0 else times == stamp
        if not acts.any():
            raise InvalidInputError(
                f"external_wrenches[{number}] on {link!r} has stamp {stamp * 1e-9:.9g} s, and no point has that "
                "time_from_start. A zero stamp means every point"
            )
        wrenches[link] = wrenches.get(link, 0) + acts[:, None] * values
    return wrenches


def to_nanoseconds(time):
    """A Time or Duration message in ns."""
    return time.sec * 1_000_000_000 + time.nanosec


def write_base(request, accelerations, robot):
    """The MultiDOFJointTrajectory of a question, completed with accelerations (N, 6)."""
    answer = MultiDOFJointTrajectory(header=request.header, joint_names=request.joint_names or [robot.base_link])
    answer.points = [
        MultiDOFJointTrajectoryPoint(
            transforms=point.transforms,
            velocities=point.velocities,
            accelerations=[write_twist(acceleration)],
            time_from_start=point.time_from_start,
        )
        for point, acceleration in zip(request.points, accelerations, strict=True)
    ]
    return answer


def write_reactions(points, reactions, order):
    """WrenchStamped for each point: the base, then each joint of the answer. reactions: (N, 1 + all joints, 6)."""
    robot = order.dynamics.robot
    rows = [0, *(number + 1 for number in order.response_order)]
    stamped = []
    for point, wrenches in zip(points, reactions, strict=True):
        for row in rows:
            message = WrenchStamped(wrench=write_wrench(wrenches[row]))
            message.header.frame_id = robot.links[row].name
            message.header.stamp.sec = point.time_from_start.sec
            message.header.stamp.nanosec = point.time_from_start.nanosec
            stamped.append(message)
    return stamped


def read_twist(message, location):
    """(6,) of a geometry_msgs/Twist. place: what to call it in errors."""
    return _twists([message], location)[0]


def read_wrench(message, location):
    """(6,) of a geometry_msgs/Wrench. place: what to call it in errors."""
    force, torque = message.force, message.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    if not np.isfinite(values).all():
        raise InvalidInputError(f"{location} is {values}: finite numbers are needed")
    return values


def write_wrench(values):
    message = Wrench()
    message.force.x, message.force.y, message.force.z = map(float, values[:3])
    message.torque.x, message.torque.y, message.torque.z = map(float, values[3:])
    return message


def write_pose(position, quaternion):
    message = Pose()
    message.position.x, message.position.y, message.position.z = map(float, position)
    orientation = message.orientation
    orientation.x, orientation.y, orientation.z, orientation.w = map(float, quaternion)
    return message


def write_accel(values):
    return _linear_angular(Accel(), values)


def write_transform(position, quaternion):
    message = Transform()
    message.translation.x, message.translation.y, message.translation.z = map(float, position)
    message.rotation.x, message.rotation.y, message.rotation.z, message.rotation.w = map(float, quaternion)
    return message


def write_twist(values):
    return _linear_angular(Twist(), values)


def _linear_angular(message, values):
    message.linear.x, message.linear.y, message.linear.z = map(float, values[:3])
    message.angular.x, message.angular.y, message.angular.z = map(float, values[3:])
    return message
