"""Values of joints at the points of a request, checked, as arrays in the order of the robot.

The .srv files define the fields. How a message holds them is in `joint_trajectories` and `flat_points`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.nodes.codecs.joint_order import JointOrder

# accepted difference of a dependent joint from the value that the other joints determine [rad or m, and per second]
DEPENDENT_JOINT_TOLERANCE = 1e-6


class JointFields(Protocol):
    """The fields positions, velocities, accelerations and effort at N points of a message."""

    def read(self, field: str, size: int, optional: bool = False) -> Array:
        """Return values (N, size) of a field, in the order of the message. Raises InvalidInputError.

        optional: whether errors say that the field may be empty.
        """
        ...

    def is_empty(self, field: str) -> bool:
        """Return whether no point has values of a field."""
        ...

    def require_empty(self, field: str, reason: str) -> None:
        """Raise InvalidInputError with a reason if a point has values of a field."""
        ...

    def locate(self, field: str, point: int, joint: int | None = None) -> str:
        """Return the place of a point, or of a joint in it, for errors."""
        ...


def read_positions(fields: JointFields, order: JointOrder) -> Array:
    """Return positions: (N, n) of the independent joints, or (N, all joints) of a robot with loops.

    Values of mimic joints must agree with those of the joints that they follow. Values of joints that loops place are
    starting values of the closure solver. Raises InvalidInputError.
    """
    dynamics = order.dynamics
    requested = _read_field(fields, "positions", order)
    if order.has_independent_only and not dynamics.robot.loops:
        return order.select_independent(requested)
    values = _of_all_joints(requested, order)
    independent = values[:, order.independent]
    expected = dynamics.expand_positions(values if dynamics.robot.loops else independent)
    values[:, order.dependent] = expected[:, order.dependent]
    _require_agreement(values, expected, "positions", order, fields)
    return expected if dynamics.robot.loops else independent


def read_velocities(fields: JointFields, order: JointOrder, q: Array) -> Array:
    """Return velocities (N, n) of the independent joints at positions q; those of dependent joints must agree."""

    def expand(velocities: Array) -> Array:
        return order.dynamics.expand_velocities(velocities, q)

    return _read_rates(fields, "velocities", order, expand)


def read_accelerations(fields: JointFields, order: JointOrder, q: Array, qd: Array) -> Array:
    """Return accelerations (N, n) of the independent joints; those of dependent joints must agree."""

    def expand(accelerations: Array) -> Array:
        return order.dynamics.expand_accelerations(accelerations, q, qd)

    return _read_rates(fields, "accelerations", order, expand)


def read_efforts(fields: JointFields, order: JointOrder, q: Array) -> Array:
    """Return efforts (N, n) on the independent joints; efforts on mimic joints are projected onto them."""
    requested = _read_field(fields, "effort", order)
    if order.has_independent_only:
        return order.select_independent(requested)
    dynamics = order.dynamics
    values = _of_all_joints(requested, order)
    nonzero = np.argwhere(np.nan_to_num(values[:, order.dependent]))
    if len(nonzero):
        point, index = nonzero[0]
        name = dynamics.dependent_joint_names[index]
        raise InvalidInputError(
            f"{fields.locate('effort', point)}: joint {name!r} has {values[point, order.dependent[index]]:g}, but no "
            "motor drives it: leave it out, or give 0 or nan"
        )
    values[:, order.dependent] = 0
    return dynamics.project_efforts(values, q)


def read_optional_field(fields: JointFields, field: str, order: JointOrder) -> Array | None:
    """Return (N, all joints) of a field, nan for joints that it leaves out; None if it is empty in all points."""
    if fields.is_empty(field):
        return None
    requested = fields.read(field, len(order.requested_names), optional=True)
    values = np.full((len(requested), len(order.dynamics.all_joint_names)), np.nan)
    values[:, order.numbers] = requested
    return values


def _read_rates(fields: JointFields, field: str, order: JointOrder, expand: Callable[[Array], Array]) -> Array:
    """Return (N, n) of velocities or accelerations; `expand` computes those of all joints, which must agree."""
    requested = _read_field(fields, field, order)
    if order.has_independent_only:
        return order.select_independent(requested)
    values = _of_all_joints(requested, order)
    independent = values[:, order.independent]
    _require_agreement(values, expand(independent), field, order, fields)
    return independent


def _of_all_joints(requested: Array, order: JointOrder) -> Array:
    """Return values (N, all joints); joints that are not in the message have zero, or nan if loops place them."""
    values = np.zeros((len(requested), len(order.dynamics.all_joint_names)))
    values[:, order.dependent] = np.nan
    values[:, order.numbers] = requested
    return values


def _require_agreement(values: Array, expected: Array, field: str, order: JointOrder, fields: JointFields) -> None:
    """Refuse values (N, all joints) of joints in the message that differ from the expected ones; nan is accepted."""
    requested = values[:, order.numbers]
    expected = expected[:, order.numbers]
    disagree = np.abs(requested - expected) > DEPENDENT_JOINT_TOLERANCE * np.maximum(1, np.abs(requested))
    if disagree.any():
        point, joint = np.argwhere(disagree)[0]
        raise InvalidInputError(
            f"{fields.locate(field, point)}: joint {order.requested_names[joint]!r} depends on others, which put it "
            f"at {expected[point, joint]:.9g}, not at {requested[point, joint]:.9g}. Leave it out, or give that value"
        )


def _read_field(fields: JointFields, field: str, order: JointOrder) -> Array:
    """Return finite values (N, joints of the message) of a field; joints that loops place may have nan."""
    requested = fields.read(field, len(order.requested_names))
    if math.isfinite(np.vdot(requested, requested)):  # so are all terms of the sum; one number is checked faster
        return requested
    is_finite = np.isfinite(requested)
    if is_finite.all():
        return requested
    is_dependent = np.isin(order.numbers, order.dependent)
    if field in ("accelerations", "effort"):  # nan of unactuated joints means that there is no value to give
        requested = np.where(np.isnan(requested) & order.is_unactuated & ~is_dependent, 0.0, requested)
        is_finite = np.isfinite(requested)
    invalid = ~(is_finite | (np.isnan(requested) & is_dependent))
    if invalid.any():
        point, joint = np.argwhere(invalid)[0]
        raise InvalidInputError(
            f"{fields.locate(field, point, joint)} is {requested[point, joint]}: a finite number is needed"
        )
    return requested
