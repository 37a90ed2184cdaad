"""Points of joint trajectories as messages and as arrays. The .srv files define the fields."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray
    from robot_dynamics.nodes.codecs.joint_order import JointOrder

# accepted difference of a dependent joint from the value that the other joints determine [rad or m, and per second]
DEPENDENT_JOINT_TOLERANCE = 1e-6
LOCATION = "points[{}]"  # of a point in a message, for errors

Points = Sequence[JointTrajectoryPoint]


def read_positions(points: Points, order: JointOrder, location: str = LOCATION) -> Array:
    """Return positions: (N, n) of the independent joints, or (N, all joints) of a robot with loops.

    Values of mimic joints must agree with those of the joints that they follow. Values of joints that loops place are
    starting values of the closure solver. Raises InvalidInputError.
    """
    dynamics = order.dynamics
    values = _read_field(points, "positions", order, location)
    independent = values[:, _numbers(dynamics.joint_names, order)]
    expected = dynamics.expand_positions(values if dynamics.robot.loops else independent)
    dependent = _numbers(dynamics.dependent_joint_names, order)
    values[:, dependent] = expected[:, dependent]
    _require_agreement(values, expected, "positions", order, location)
    return expected if dynamics.robot.loops else independent


def read_velocities(points: Points, order: JointOrder, q: Array, location: str = LOCATION) -> Array:
    """Return velocities (N, n) of the independent joints at positions q; those of dependent joints must agree."""

    def expand(velocities: Array) -> Array:
        return order.dynamics.expand_velocities(velocities, q)

    return _read_rates(points, "velocities", order, location, expand)


def read_accelerations(points: Points, order: JointOrder, q: Array, qd: Array, location: str = LOCATION) -> Array:
    """Return accelerations (N, n) of the independent joints; those of dependent joints must agree."""

    def expand(accelerations: Array) -> Array:
        return order.dynamics.expand_accelerations(accelerations, q, qd)

    return _read_rates(points, "accelerations", order, location, expand)


def read_efforts(points: Points, order: JointOrder, q: Array) -> Array:
    """Return efforts (N, n) on the independent joints; efforts on mimic joints are projected onto them."""
    dynamics = order.dynamics
    values = _read_field(points, "effort", order)
    dependent = _numbers(dynamics.dependent_joint_names, order)
    nonzero = np.argwhere(np.nan_to_num(values[:, dependent]))
    if len(nonzero):
        point, index = nonzero[0]
        name = dynamics.dependent_joint_names[index]
        raise InvalidInputError(
            f"points[{point}].effort: joint {name!r} has {values[point, dependent[index]]:g}, but no motor drives it: "
            "leave it out, or give 0 or nan"
        )
    values[:, dependent] = 0
    return dynamics.project_efforts(values, q)


def write_trajectory(
    request: JointTrajectory, order: JointOrder, q: Array, qd: Array, qdd: Array, efforts: Array
) -> JointTrajectory:
    """Return the trajectory of a request, completed. q, qd, qdd, efforts: (N, all joints), in the robot's order."""
    message = JointTrajectory(header=request.header, joint_names=order.response_names)
    columns = [np.ascontiguousarray(values[:, order.response_order]) for values in (q, qd, qdd, efforts)]
    message.points = [
        JointTrajectoryPoint(
            positions=array("d", positions.tobytes()),
            velocities=array("d", velocities.tobytes()),
            accelerations=array("d", accelerations.tobytes()),
            effort=array("d", effort.tobytes()),
            time_from_start=point.time_from_start,
        )
        for point, positions, velocities, accelerations, effort in zip(request.points, *columns, strict=True)
    ]
    return message


def _read_rates(
    points: Points, field: str, order: JointOrder, location: str, expand: Callable[[Array], Array]
) -> Array:
    """Return (N, n) of velocities or accelerations; `expand` computes those of all joints, which must agree."""
    values = _read_field(points, field, order, location)
    independent = values[:, _numbers(order.dynamics.joint_names, order)]
    _require_agreement(values, expand(independent), field, order, location)
    return independent


def _numbers(names: Sequence[str], order: JointOrder) -> list[int]:
    return [order.dynamics.robot.joint_numbers[name] for name in names]


def _require_agreement(values: Array, expected: Array, field: str, order: JointOrder, location: str) -> None:
    """Refuse values (N, all joints) of joints in the message that differ from the expected ones; nan is accepted."""
    requested = values[:, order.numbers]
    expected = expected[:, order.numbers]
    disagree = np.abs(requested - expected) > DEPENDENT_JOINT_TOLERANCE * np.maximum(1, np.abs(requested))
    if disagree.any():
        point, joint = np.argwhere(disagree)[0]
        raise InvalidInputError(
            f"{location.format(point)}.{field}: joint {order.requested_names[joint]!r} depends on others, which put it "
            f"at {expected[point, joint]:.9g}, not at {requested[point, joint]:.9g}. Leave it out, or give that value"
        )


def _read_field(points: Points, field: str, order: JointOrder, location: str = LOCATION) -> Array:
    """Return values (N, all joints) of a field; joints that are not in the message have zero, or nan if loops place
    them, for which nan is also accepted in the message."""
    size = len(order.requested_names)
    columns = [getattr(point, field) for point in points]
    for number, column in enumerate(columns):
        if len(column) != size:
            raise InvalidInputError(
                f"{location.format(number)}.{field} has {len(column)} values: {size} are needed, one for each joint"
            )
    requested = np.array(columns, dtype=float).reshape(len(points), size)
    dependent = _numbers(order.dynamics.dependent_joint_names, order)
    is_dependent = np.isin(order.numbers, dependent)
    if field in ("accelerations", "effort"):  # nan of unactuated joints means that there is no value to give
        requested[np.isnan(requested) & _is_unactuated(order) & ~is_dependent] = 0
    invalid = ~(np.isfinite(requested) | (np.isnan(requested) & is_dependent))
    if invalid.any():
        point, joint = np.argwhere(invalid)[0]
        raise InvalidInputError(
            f"{location.format(point)}.{field}[{joint}] is {requested[point, joint]}: a finite number is needed"
        )
    values = np.zeros((len(points), len(order.dynamics.all_joint_names)))
    values[:, dependent] = np.nan
    values[:, order.numbers] = requested
    return values


def _is_unactuated(order: JointOrder) -> BoolArray:
    """Return for each joint of the request whether neither it nor the joint that it depends on has a motor."""
    robot = order.dynamics.robot
    return np.array(
        [not robot.joints[robot.mimic_relations[number][0]].actuated for number in order.numbers], dtype=bool
    )
