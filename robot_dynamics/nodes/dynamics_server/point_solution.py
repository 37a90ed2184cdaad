"""The dynamics at a range of the points of a request: by compiled models where these give all that the response has."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.codecs.joint_values import read_accelerations, read_efforts, read_positions, read_velocities
from robot_dynamics.nodes.codecs.platform_messages import read_platform_motion
from robot_dynamics.nodes.dynamics_server.point_requests import read_base
from robot_dynamics.results import JointMotion

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.inputs import Base
    from robot_dynamics.nodes.codecs.joint_order import JointOrder
    from robot_dynamics.nodes.dynamics_server.point_requests import PointRequest
    from robot_dynamics.results import DynamicsResult

ResultField: TypeAlias = Literal["effort", "accelerations"]
"""Field of points that a service computes."""


@dataclass(frozen=True, eq=False)
class PointSolution:
    """Results at N points. What was not requested is None.

    Attributes
    ----------
    efforts, accelerations : (N, n) of the independent joints.
    motion : of all joints.
    base_acceleration : (N, 6), None if the base is fixed.
    reactions : (N, 1 + all joints, 6).
    """

    efforts: Array
    accelerations: Array
    motion: JointMotion | None
    base_acceleration: Array | None
    reactions: Array | None


def solve_points(
    request: PointRequest, rows: slice, computed: ResultField, with_motion: bool, with_reactions: bool
) -> PointSolution:
    """Return the efforts or accelerations at a range of points.

    with_motion, with_reactions: whether the response has the motion of all joints, and the reactions. Raises
    RobotDynamicsError with the number of the point in the request.
    """
    try:
        if request.by_platform:
            return _of_result(_solve_platform(request, rows, computed))
        return _solve_joints(request, rows, computed, with_motion, with_reactions)
    except RobotDynamicsError as error:
        raise with_sample_of_request(error, rows.start) from error


def with_sample_of_request(error: RobotDynamicsError, first: int) -> RobotDynamicsError:
    """Return an error whose text has sample numbers of a request, of one with those of a range from `first` on.

    Codecs name points; models name samples of the arrays that they are called with.
    """
    if not first:
        return error
    return type(error)(re.sub(r"\bsample (\d+)\b", lambda match: f"sample {int(match[1]) + first}", str(error)))


def _solve_platform(request: PointRequest, rows: slice, computed: ResultField) -> DynamicsResult:
    """Return the dynamics of a robot whose platforms have the motion in `links`."""
    assert request.links is not None
    fields = request.fields(rows)
    platform = request.order.dynamics.platform
    motion = read_platform_motion(fields, request.links, rows, request.order, has_accelerations=computed == "effort")
    seed = motion.seed
    efforts: Array | None = None
    if computed == "accelerations":
        seed = platform.joint_positions(motion.pose, seed, motion.other_joints)
        efforts = read_efforts(fields, request.order, seed)
    return platform.solve(
        motion.pose,
        motion.twist,
        acceleration=motion.acceleration,
        efforts=efforts,
        seed=seed,
        other_joints=motion.other_joints,
        external_wrenches=request.wrenches(rows),
    )


def _solve_joints(
    request: PointRequest, rows: slice, computed: ResultField, with_motion: bool, with_reactions: bool
) -> PointSolution:
    """Return the dynamics of a robot whose joints have the motion in the fields of the request."""
    order = request.order
    dynamics = order.dynamics
    fields = request.fields(rows)
    q = read_positions(fields, order)
    qd = read_velocities(fields, order, q)
    accelerations: Array | None = None
    efforts: Array | None = None
    if computed == "accelerations":
        efforts = read_efforts(fields, order, q)
    else:
        accelerations = read_accelerations(fields, order, q, qd)
    base = read_base(request, rows)
    wrenches = request.wrenches(rows)
    is_free = base is not None and base.acceleration is None
    has_more_motion = dynamics.robot.loops or dynamics.unactuated_joint_names
    if with_reactions or is_free or (with_motion and has_more_motion):
        return _of_result(
            dynamics.solve(q, qd, qdd=accelerations, efforts=efforts, base=base, external_wrenches=wrenches)
        )
    arrays = {"q": q, "qd": qd, "qdd": accelerations, "efforts": efforts}
    arguments = {name: values for name, values in arrays.items() if values is not None}
    result = _evaluate(dynamics, computed, arguments, base, wrenches)
    efforts = result if efforts is None else efforts
    accelerations = result if accelerations is None else accelerations
    return PointSolution(
        efforts,
        accelerations,
        _expand_motion(order, q, qd, accelerations) if with_motion else None,
        None if base is None else np.asarray(base.acceleration),
        None,
    )


def _evaluate(
    dynamics: Dynamics,
    computed: ResultField,
    arguments: dict[str, Array],
    base: Base | None,
    wrenches: dict[str, Array],
) -> Array:
    """Return efforts or accelerations (N, n); a single point as a sample, which has less overhead than a batch."""
    model = dynamics.inverse if computed == "effort" else dynamics.direct
    is_single = base is None and len(arguments["q"]) == 1
    if is_single:
        arguments = {name: values[0] for name, values in arguments.items()}
        wrenches = {link: values[0] if values.ndim == 2 else values for link, values in wrenches.items()}
    result = model(**arguments, base=base, external_wrenches=wrenches or None)
    return result[None] if is_single else result


def _expand_motion(order: JointOrder, q: Array, qd: Array, qdd: Array) -> JointMotion:
    """Return the motion of all joints of a robot without loops."""
    dynamics = order.dynamics
    if order.are_all_independent:
        return JointMotion(q, qd, qdd)
    return JointMotion(dynamics.expand_positions(q), dynamics.expand_velocities(qd), dynamics.expand_accelerations(qdd))


def _of_result(result: DynamicsResult) -> PointSolution:
    return PointSolution(
        result.efforts, result.accelerations, result.motion, result.base_acceleration, result.reactions
    )
