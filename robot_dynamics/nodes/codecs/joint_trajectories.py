"""Points of joint trajectories in messages and as arrays. What the fields mean stands in the .srv files."""

from array import array

import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError

# how far a joint that depends on others may be from where they put it [rad or m, and per second]
AGREEMENT = 1e-6


def read_positions(points, order, place="points[{}]"):
    """Positions of trajectory points: (N, n) of the independent joints, or, of a robot with loops, (N, all joints).

    order: JointOrder. Where the message names mimic joints, their values must agree. Joints that loops place are
    searched for near the values that the message has for them; they come out where they are. place: where in the
    message the points are, for errors.
    """
    dynamics, everyone = order.dynamics, _field(points, "positions", order, place)
    independent = everyone[:, _numbers(dynamics.joint_names, order)]
    expected = dynamics.expand_positions(everyone if dynamics.robot.loops else independent)
    looped = _numbers(dynamics.dependent_joint_names, order)
    everyone[:, looped] = expected[:, looped]
    _require_agreement(everyone, expected, "positions", order, place)
    return expected if dynamics.robot.loops else independent


def read_velocities(points, order, q, place="points[{}]"):
    """Velocities (N, n) of the independent joints at positions q; those of others must agree, where they are told."""
    return _read_rates(points, "velocities", order, place, lambda rates: order.dynamics.expand_velocities(rates, q))


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
        raise InvalidInputError(
            f"{place.format(point)}.{field}: joint {order.requested_names[joint]!r} depends on others, which put it at "
            f"{expected[point, joint]:.9g}, not at {values[point, joint]:.9g}. Leave it out, or let it agree"
        )


def read_efforts(points, order, q):
    """Efforts (N, n) on the independent joints; what is given on mimic joints is counted there."""
    dynamics, everyone = order.dynamics, _field(points, "effort", order)
    looped = _numbers(dynamics.dependent_joint_names, order)
    pushed = np.argwhere(np.nan_to_num(everyone[:, looped]))
    if len(pushed):
        point, place = pushed[0]
        name, value = dynamics.dependent_joint_names[place], everyone[point, looped[place]]
        raise InvalidInputError(
            f"points[{point}].effort: joint {name!r} has {value:g}, but no motor drives it: leave it "
            "out, or give 0 or nan"
        )
    everyone[:, looped] = 0
    return dynamics.project_efforts(everyone, q)


def _field(points, field, order, place="points[{}]"):
    """Values (N, all joints) of a field, zero where the message has no value of a joint; of joints that loops place,
    nan says so too."""
    size = len(order.requested_names)
    columns = [getattr(point, field) for point in points]
    for number, column in enumerate(columns):
        if len(column) != size:
            raise InvalidInputError(
                f"{place.format(number)}.{field} has {len(column)} values: {size} are needed, one for each joint"
            )
    values = np.array(columns, dtype=float).reshape(len(points), size)
    looped = _numbers(order.dynamics.dependent_joint_names, order)
    if field in ("accelerations", "effort"):  # of joints without motor nan says what is true: it cannot be given
        values[np.isnan(values) & _without_motor(order) & ~np.isin(order.numbers, looped)] = 0
    wrong = ~(np.isfinite(values) | (np.isnan(values) & np.isin(order.numbers, looped)))
    if wrong.any():
        point, joint = np.argwhere(wrong)[0]
        found = f"{place.format(point)}.{field}[{joint}] is {values[point, joint]}"
        raise InvalidInputError(f"{found}: a finite number is needed")
    everyone = np.zeros((len(points), len(order.dynamics.all_joint_names)))
    everyone[:, looped] = np.nan
    everyone[:, order.numbers] = values
    return everyone


def _without_motor(order):
    """For each joint that is asked about, whether no motor drives it, nor the one that it depends on."""
    robot = order.dynamics.robot
    return np.array(
        [not robot.joints[robot.mimic_relations[number][0]].actuated for number in order.numbers], dtype=bool
    )


def write_trajectory(request, order, q, qd, qdd, efforts):
    """The JointTrajectory of a question, completed. q, qd, qdd, efforts: (N, all joints), in the robot's order."""
    answer = JointTrajectory(header=request.header, joint_names=order.response_names)
    columns = [np.ascontiguousarray(values[:, order.response_order]) for values in (q, qd, qdd, efforts)]
    answer.points = [
        JointTrajectoryPoint(
            positions=array("d", positions.tobytes()),
            velocities=array("d", velocities.tobytes()),
            accelerations=array("d", accelerations.tobytes()),
            effort=array("d", effort.tobytes()),
            time_from_start=point.time_from_start,
        )
        for point, positions, velocities, accelerations, effort in zip(request.points, *columns, strict=True)
    ]
    return answer
