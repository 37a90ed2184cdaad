"""Requests with one point, of robots on a fixed base whose joints are all independent.

They need no more than the arrays of the request and one call of the model. Requests that have more, or are invalid,
are left to `point_solution`, which has the reasons of refusals.
"""

from __future__ import annotations

from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.codecs.fields import to_float_array
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.dynamics_server.point_terms import compute_terms

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.codecs.joint_order import JointOrder
    from robot_dynamics.nodes.dynamics_server.point_solution import ResultField
    from robot_dynamics_interfaces.srv import (
        DirectDynamics,
        DirectDynamicsBatch,
        DynamicsTerms,
        DynamicsTermsBatch,
        InverseDynamics,
        InverseDynamicsBatch,
    )


def complete_plain_batch(
    message: InverseDynamicsBatch.Request | DirectDynamicsBatch.Request,
    response: InverseDynamicsBatch.Response | DirectDynamicsBatch.Response,
    dynamics: Dynamics,
    namespace: str,
    computed: ResultField,
) -> bool:
    """Fill the response to a request with flat arrays. Return whether that was possible.

    computed: the field of the result, "effort" or "accelerations".
    """
    if message.count != 1 or message.motion or message.reaction_wrenches or _has_more(message):
        return False
    order = match_joints(message.joint_names, dynamics, namespace)
    drive = message.accelerations if computed == "effort" else message.efforts
    result = _solve(order, message.positions, message.velocities, drive, computed)
    if result is None:
        return False
    response.joint_names = order.response_names
    setattr(response, "efforts" if computed == "effort" else "accelerations", result)
    response.success = True
    return True


def complete_plain_trajectory(
    message: InverseDynamics.Request | DirectDynamics.Request,
    response: InverseDynamics.Response | DirectDynamics.Response,
    dynamics: Dynamics,
    namespace: str,
    computed: ResultField,
) -> bool:
    """Fill the response to a request with a trajectory. Return whether that was possible.

    computed: the field of the result, "effort" or "accelerations".
    """
    trajectory = message.trajectory
    points = trajectory.points
    if len(points) != 1 or message.reaction_wrenches or message.external_wrenches:
        return False
    if message.base.points or message.base.joint_names or len(getattr(points[0], computed)):
        return False
    order = match_joints(trajectory.joint_names, dynamics, namespace)
    point = points[0]
    drive = point.accelerations if computed == "effort" else point.effort
    result = _solve(order, point.positions, point.velocities, drive, computed)
    if result is None:
        return False
    setattr(point, computed, result)
    response.trajectory = JointTrajectory(header=trajectory.header, joint_names=order.response_names, points=points)
    response.success = True
    return True


def complete_plain_terms(
    response: DynamicsTerms.Response | DynamicsTermsBatch.Response,
    order: JointOrder,
    terms: Sequence[str],
    positions: array[float],
    velocities: array[float],
) -> bool:
    """Fill the response with terms of the dynamic model at one point. Return whether that was possible.

    positions, velocities: (n,) of the n joints of the message [rad or m; rad/s or m/s].
    """
    size = len(order.requested_names)
    if not order.is_plain or len(positions) != size or len(velocities) != size:
        return False
    q = order.select_independent(np.frombuffer(positions))
    qd = order.select_independent(np.frombuffer(velocities))
    if not (np.isfinite(q).all() and np.isfinite(qd).all()):  # a term need not depend on both
        return False
    try:
        values = compute_terms(order.dynamics, terms, q, qd, None)
    except RobotDynamicsError:
        return False
    for term, rows in values.items():
        if term == "inertia_matrix":
            rows = order.to_response(order.to_response(rows).T).T
        else:
            rows = order.to_response(rows)
        setattr(response, term, to_float_array(rows))
    response.joint_names = order.response_names
    response.success = True
    return True


def _has_more(message: InverseDynamicsBatch.Request | DirectDynamicsBatch.Request) -> bool:
    """Return whether a request has wrenches, or the motion of a base."""
    if message.wrench_links or message.external_wrenches or message.base_links:
        return True
    return bool(message.base_poses or message.base_twists or getattr(message, "base_accelerations", ()))


def _solve(
    order: JointOrder,
    positions: array[float],
    velocities: array[float],
    drive: array[float],
    computed: ResultField,
) -> array[float] | None:
    """Return efforts or accelerations of the joints in the order of the message; None if the request needs more.

    positions, velocities: (n,) of the n joints of the message; drive: (n,) their accelerations, or efforts.
    """
    size = len(order.requested_names)
    if not order.is_plain or len(positions) != size or len(velocities) != size or len(drive) != size:
        return None
    model = order.dynamics.inverse if computed == "effort" else order.dynamics.direct
    try:
        result = model(*(order.select_independent(np.frombuffer(values)) for values in (positions, velocities, drive)))
    except RobotDynamicsError:
        return None
    return to_float_array(order.to_response(result))
