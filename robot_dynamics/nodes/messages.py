"""The one conversion between messages and arrays. What the fields mean stands in the .srv files."""

from array import array

import numpy as np
from geometry_msgs.msg import Accel, Pose, Transform, Twist, Wrench, WrenchStamped
from scipy.spatial.transform import Rotation
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from robot_dynamics.dynamics import Base
from robot_dynamics.errors import QuestionError
from robot_dynamics.nodes.names import resolve

# how far a joint that depends on others may be from where they put it [rad or m, and per second]
AGREEMENT = 1e-6
UNIT_QUATERNION = 1e-3  # how far the norm of a quaternion may be from 1: it is normalised, not guessed


def read_positions(points, order, place="points[{}]"):
    """Positions of trajectory points: (N, n) of the independent joints, or, of a robot with loops, (N, all joints).

    order: JointOrder. Where the message names mimic joints, their values must agree. Joints that loops place are
    searched for near the values that the message has for them; they come out where they are. place: where in the
    message the points are, for errors.
    """
    dynamics, everyone = order.dynamics, _field(points, "positions", order, place)
    independent = everyone[:, _numbers(dynamics.joint_names, order)]
    expected = dynamics.expand(everyone if dynamics.robot.loops else independent)
    looped = _numbers(dynamics.looped_joint_names, order)
    everyone[:, looped] = expected[:, looped]
    _require_agreement(everyone, expected, "positions", order, place)
    return expected if dynamics.robot.loops else independent


def read_velocities(points, order, q, place="points[{}]"):
    """Velocities (N, n) of the independent joints at positions q; those of others must agree, where they are told."""
    return _read_rates(points, "velocities", order, place, lambda rates: order.dynamics.expand_rates(rates, q))


def read_accelerations(points, order, q, qd, place="points[{}]"):
    """Accelerations (N, n) of the independent joints, as `read_velocities`."""
    return _read_rates(
        points, "accelerations", order, place, lambda rates: order.dynamics.expand_accelerations(rates, q, qd)
    )


def _read_rates(points, field, order, place, expand):
    everyone = _field(points, field, order, place)
    independent = everyone[:, _numbers(order.dynamics.joint_names, order)]
    _require_agreement(everyone, expand(independent), field, order, place)
    return independent


def _numbers(names, order):
    return [order.dynamics.robot.joint_numbers[name] for name in names]


def _require_agreement(everyone, expected, field, order, place):
    """Refuse values (N, all joints) that are not as others have it; what the message left out is nan, or not asked."""
    values, expected = everyone[:, order.numbers], expected[:, order.numbers]
    disagree = np.abs(values - expected) > AGREEMENT * np.maximum(1, np.abs(values))
    if disagree.any():
        point, joint = np.argwhere(disagree)[0]
        raise QuestionError(
            f"{place.format(point)}.{field}: joint {order.asked[joint]!r} depends on others, which put it at "
            f"{expected[point, joint]:.9g}, not at {values[point, joint]:.9g}. Leave it out, or let it agree"
        )


def read_efforts(points, order, q):
    """Efforts (N, n) on the independent joints; what is given on mimic joints is counted there."""
    dynamics, everyone = order.dynamics, _field(points, "effort", order)
    looped = _numbers(dynamics.looped_joint_names, order)
    pushed = np.argwhere(np.nan_to_num(everyone[:, looped]))
    if len(pushed):
        point, place = pushed[0]
        name, value = dynamics.looped_joint_names[place], everyone[point, looped[place]]
        raise QuestionError(
            f"points[{point}].effort: joint {name!r} has {value:g}, but no motor drives it: leave it "
            "out, or give 0 or nan"
        )
    everyone[:, looped] = 0
    return dynamics.gather_efforts(everyone, q)


def _field(points, field, order, place="points[{}]"):
    """Values (N, all joints) of a field, zero where the message has no value of a joint; of joints that loops place,
    nan says so too."""
    size = len(order.asked)
    columns = [getattr(point, field) for point in points]
    for number, column in enumerate(columns):
        if len(column) != size:
            raise QuestionError(
                f"{place.format(number)}.{field} has {len(column)} values: {size} are needed, one for each joint"
            )
    values = np.array(columns, dtype=float).reshape(len(points), size)
    looped = _numbers(order.dynamics.looped_joint_names, order)
    if field in ("accelerations", "effort"):  # of joints without motor nan says what is true: it cannot be given
        values[np.isnan(values) & _without_motor(order) & ~np.isin(order.numbers, looped)] = 0
    wrong = ~(np.isfinite(values) | (np.isnan(values) & np.isin(order.numbers, looped)))
    if wrong.any():
        point, joint = np.argwhere(wrong)[0]
        found = f"{place.format(point)}.{field}[{joint}] is {values[point, joint]}"
        raise QuestionError(f"{found}: a finite number is needed")
    everyone = np.zeros((len(points), len(order.dynamics.all_joint_names)))
    everyone[:, looped] = np.nan
    everyone[:, order.numbers] = values
    return everyone


def _without_motor(order):
    """For each joint that is asked about, whether no motor drives it, nor the one that it depends on."""
    robot = order.dynamics.robot
    return np.array([not robot.joints[robot.leaders[number][0]].actuated for number in order.numbers], dtype=bool)


def require_empty(message, field, place, why):
    """Refuse a message in which a field has values that have no part in the question."""
    if len(getattr(message, field)):
        raise QuestionError(f"{place}.{field} has values: {why}, leave it empty")


def read_base(base, times, robot, namespace, at_rest=False):
    """The Base of a MultiDOFJointTrajectory, or None where the base of the robot is fixed.

    times: time_from_start of each point of the joint trajectory [ns]. at_rest: velocities may be left out.
    """
    if not robot.moving_base:
        return _no_base(robot, base.points or base.joint_names)
    whose = f"the base of {robot.name!r}"
    return read_points(base, times, (robot.base_link,), namespace, whose, at_rest)[robot.base_link]


def read_points(base, times, links, namespace, whose, at_rest=False):
    """{link: Base} of a MultiDOFJointTrajectory that tells the motion of links, at points at `times` [ns].

    whose: what to call the links in errors.
    """
    names = [resolve("base link", name, links, namespace) for name in base.joint_names] or list(links)
    if sorted(names) != sorted(links):
        told = f"base.joint_names are {', '.join(names)}"
        raise QuestionError(f"{told}: each of {', '.join(links)} is needed once, or none of the names")
    if len(base.points) != len(times):
        raise QuestionError(
            f"base.points has {len(base.points)} entries: {whose} moves, so its pose and twist are "
            f"needed at each of {len(times)} points"
        )
    told = [len(point.accelerations) > 0 for point in base.points]
    if any(told) and not all(told):
        number = told.index(False)
        raise QuestionError(f"base.points[{number}].accelerations has 0 entries: give it at all points or at none")
    for number, (point, time) in enumerate(zip(base.points, times, strict=True)):
        if nanoseconds(point.time_from_start) not in (0, time):
            raise QuestionError(f"base.points[{number}].time_from_start differs from that of the trajectory's point")
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
        raise QuestionError(f"the base of {robot.name!r} is fixed: leave the field base empty")


def _base(points, place, at_rest=False, entry=0, links=("the base link",)):
    """The Base of an entry of MultiDOFJointTrajectoryPoints, each of which has for each of the links one pose, one
    twist and one acceleration or none."""
    accelerated = any(len(point.accelerations) for point in points)
    moves = not at_rest or any(len(point.velocities) for point in points)
    for field in ("transforms", *(["velocities"] if moves else []), *(["accelerations"] if accelerated else [])):
        for number, point in enumerate(points):
            if len(getattr(point, field)) != len(links):
                found = f"{place.format(number)}.{field} has {len(getattr(point, field))} entries"
                needed = "one is needed" if len(links) == 1 else f"{len(links)} are needed"
                raise QuestionError(f"{found}: {needed}, of {', '.join(links)}")

    def twists(field):
        return _twists([getattr(point, field)[entry] for point in points], f"{place}.{field}[{entry}]")

    return Base(
        pose=_poses([point.transforms[entry] for point in points], place),
        twist=twists("velocities") if moves else np.zeros(6),
        acceleration=twists("accelerations") if accelerated else None,
    )


def _poses(transforms, place, names=("transforms[0].translation", "transforms[0].rotation")):
    """Homogeneous matrices (N, 4, 4) of geometry_msgs/Transform. names: of their fields, for errors."""
    rotations = np.array([[t.rotation.x, t.rotation.y, t.rotation.z, t.rotation.w] for t in transforms])
    poses = np.tile(np.eye(4), (len(transforms), 1, 1))
    poses[:, :3, 3] = [[t.translation.x, t.translation.y, t.translation.z] for t in transforms]
    norms = np.linalg.norm(rotations, axis=1)
    wrong = np.flatnonzero(~(np.abs(norms - 1) < UNIT_QUATERNION))
    if len(wrong):
        found = f"{place.format(wrong[0])}.{names[1]} has norm {norms[wrong[0]]:.6g}"
        raise QuestionError(f"{found}: 1 is needed")
    poses[:, :3, :3] = Rotation.from_quat(rotations).as_matrix()
    _require_finite(poses, f"{place}.{names[0]}")
    return poses


def read_pose(pose, place):
    """Homogeneous matrix (4, 4) of a geometry_msgs/Pose; place: where in the message it is, for errors."""
    position, q = pose.position, pose.orientation
    transform = write_transform((position.x, position.y, position.z), (q.x, q.y, q.z, q.w))
    return _poses([transform], place, ("position", "orientation"))[0]


def _twists(twists, place):
    values = np.array(
        [[t.linear.x, t.linear.y, t.linear.z, t.angular.x, t.angular.y, t.angular.z] for t in twists], dtype=float
    )
    _require_finite(values, place)
    return values


def _require_finite(values, place):
    wrong = np.argwhere(~np.isfinite(values))
    if len(wrong):
        raise QuestionError(f"{place.format(wrong[0][0])} is not finite")


def read_wrenches(stamped, times, robot, namespace):
    """{link name: (N, 6)} of geometry_msgs/WrenchStamped[], for points at `times` [ns]. Wrenches on a link add up."""
    times, wrenches = np.asarray(times), {}
    for number, wrench in enumerate(stamped):
        try:
            link = resolve("link", wrench.header.frame_id, robot.frames_by_name, namespace)
        except QuestionError as error:
            raise QuestionError(f"external_wrenches[{number}].header.frame_id: {error}") from None
        values = read_wrench(wrench.wrench, f"external_wrenches[{number}] on {link!r}")
        stamp = nanoseconds(wrench.header.stamp)
        if wrench.header.stamp.sec < 0 or wrench.header.stamp.nanosec >= 1_000_000_000:
            raise QuestionError(f"external_wrenches[{number}].header.stamp is no time since a start")
        acts = np.ones(len(times), bool) if stamp == 0 else times == stamp
        if not acts.any():
            raise QuestionError(
                f"external_wrenches[{number}] on {link!r} has stamp {stamp * 1e-9:.9g} s, and no point has that "
                "time_from_start. A zero stamp means every point"
            )
        wrenches[link] = wrenches.get(link, 0) + acts[:, None] * values
    return wrenches


def nanoseconds(time):
    """A Time or Duration message in ns."""
    return time.sec * 1_000_000_000 + time.nanosec


def write_trajectory(question, order, q, qd, qdd, efforts):
    """The JointTrajectory of a question, completed. q, qd, qdd, efforts: (N, all joints), in the robot's order."""
    answer = JointTrajectory(header=question.header, joint_names=order.answered_names)
    columns = [np.ascontiguousarray(values[:, order.answered]) for values in (q, qd, qdd, efforts)]
    answer.points = [
        JointTrajectoryPoint(
            positions=array("d", positions.tobytes()),
            velocities=array("d", velocities.tobytes()),
            accelerations=array("d", accelerations.tobytes()),
            effort=array("d", effort.tobytes()),
            time_from_start=point.time_from_start,
        )
        for point, positions, velocities, accelerations, effort in zip(question.points, *columns, strict=True)
    ]
    return answer


def write_base(question, accelerations, robot):
    """The MultiDOFJointTrajectory of a question, completed with accelerations (N, 6)."""
    answer = MultiDOFJointTrajectory(header=question.header, joint_names=question.joint_names or [robot.base_link])
    answer.points = [
        MultiDOFJointTrajectoryPoint(
            transforms=point.transforms,
            velocities=point.velocities,
            accelerations=[write_twist(acceleration)],
            time_from_start=point.time_from_start,
        )
        for point, acceleration in zip(question.points, accelerations, strict=True)
    ]
    return answer


def write_reactions(points, reactions, order):
    """WrenchStamped for each point: the base, then each joint of the answer. reactions: (N, 1 + all joints, 6)."""
    robot = order.dynamics.robot
    rows = [0, *(number + 1 for number in order.answered)]
    stamped = []
    for point, wrenches in zip(points, reactions, strict=True):
        for row in rows:
            message = WrenchStamped(wrench=write_wrench(wrenches[row]))
            message.header.frame_id = robot.links[row].name
            message.header.stamp.sec = point.time_from_start.sec
            message.header.stamp.nanosec = point.time_from_start.nanosec
            stamped.append(message)
    return stamped


def read_twist(message, place):
    """(6,) of a geometry_msgs/Twist. place: what to call it in errors."""
    return _twists([message], place)[0]


def read_wrench(message, place):
    """(6,) of a geometry_msgs/Wrench. place: what to call it in errors."""
    force, torque = message.force, message.torque
    values = np.array([force.x, force.y, force.z, torque.x, torque.y, torque.z])
    if not np.isfinite(values).all():
        raise QuestionError(f"{place} is {values}: finite numbers are needed")
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
