"""The services as functions of a request and a Dynamics, which fill the response.

They raise RobotDynamicsError to refuse a request. `namespace` is that of the node: it may precede names of joints and
links.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal, TypeAlias

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.newton_euler.screw import BASE_ROWS
from robot_dynamics.nodes.codecs.base import read_base, read_base_point, write_base
from robot_dynamics.nodes.codecs.fields import require_empty, to_float_array, to_nanoseconds
from robot_dynamics.nodes.codecs.geometry import read_pose
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_trajectories import (
    read_accelerations,
    read_efforts,
    read_positions,
    read_velocities,
    write_trajectory,
)
from robot_dynamics.nodes.codecs.platform_messages import (
    has_platform_motion,
    read_platform_at_rest,
    read_platform_motion,
    write_platforms,
)
from robot_dynamics.nodes.codecs.wrenches import read_wrenches, write_reactions

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.codecs.joint_order import JointOrder
    from robot_dynamics.nodes.codecs.platform_messages import (
        Request,
    )
    from robot_dynamics.results import DynamicsResult
    from robot_dynamics_interfaces.srv import (
        DirectDynamics,
        DynamicsTerms,
        InverseDynamics,
        NaturalFrequencies,
        StaticEquilibrium,
    )

ResultField: TypeAlias = Literal["effort", "accelerations"]
"""Field of trajectory points that a service computes."""


def handle_inverse_dynamics(
    request: InverseDynamics.Request, response: InverseDynamics.Response, dynamics: Dynamics, namespace: str
) -> None:
    """InverseDynamics.srv: efforts from accelerations."""
    _complete_trajectory(request, response, dynamics, namespace, "effort")


def handle_direct_dynamics(
    request: DirectDynamics.Request, response: DirectDynamics.Response, dynamics: Dynamics, namespace: str
) -> None:
    """DirectDynamics.srv: accelerations from efforts."""
    _complete_trajectory(request, response, dynamics, namespace, "accelerations")


def handle_static_equilibrium(
    request: StaticEquilibrium.Request, response: StaticEquilibrium.Response, dynamics: Dynamics, namespace: str
) -> None:
    """StaticEquilibrium.srv: rest positions of the unactuated joints, and the efforts that hold the robot there."""
    by_platform = _use_platform_points(request, dynamics)
    order = _match_request_joints(request, dynamics, namespace, by_platform)
    robot = dynamics.robot
    points = request.trajectory.points
    times = _point_times(points, ("velocities", "accelerations", "effort"), "the service computes it")
    wrenches = read_wrenches(request.external_wrenches, times, robot, namespace)
    if by_platform:
        motion = read_platform_at_rest(request, order, times, namespace)
        equilibrium = dynamics.platform.equilibrium(
            motion.pose, seed=motion.seed, other_joints=motion.other_joints, external_wrenches=wrenches
        )
    else:
        base = read_base(request.base, times, robot, namespace, at_rest=True)
        positions = read_positions(points, order)
        equilibrium = dynamics.equilibrium(positions, base=base, external_wrenches=wrenches)
    rest = np.zeros((len(points), len(dynamics.all_joint_names)))
    efforts = dynamics.embed_efforts(equilibrium.efforts)
    response.trajectory = write_trajectory(request.trajectory, order, equilibrium.joint_positions, rest, rest, efforts)
    response.stable = equilibrium.stable.tolist()
    if request.reaction_wrenches:
        response.reactions = write_reactions(points, equilibrium.reactions, order)
    response.success = True


def handle_natural_frequencies(
    request: NaturalFrequencies.Request, response: NaturalFrequencies.Response, dynamics: Dynamics, namespace: str
) -> None:
    """NaturalFrequencies.srv: frequencies and mode shapes at one pose, of the joints or of the platform."""
    positions: Array | None = None
    pose: Array | None = None
    if request.joint_names or request.positions or not dynamics.robot.platforms:
        order = match_joints(request.joint_names, dynamics, namespace)
        point = JointTrajectoryPoint(positions=request.positions)
        positions = read_positions([point], order, location="request")[0]
    else:
        pose = read_pose(request.platform, "platform")
    elastodynamics = Elastodynamics(dynamics, list(request.held)) if request.held else dynamics.elastodynamics
    modes = elastodynamics.natural_frequencies(q=positions, pose=pose, count=request.count or None)
    response.frequencies = to_float_array(modes.frequencies)
    response.coordinates = list(modes.coordinates)
    response.mode_shapes = to_float_array(modes.mode_shapes)
    response.success = True


def handle_dynamics_terms(
    request: DynamicsTerms.Request, response: DynamicsTerms.Response, dynamics: Dynamics, namespace: str
) -> None:
    """DynamicsTerms.srv: mass matrix, Coriolis, gravity, friction and elastic forces at one state."""
    order = match_joints(request.joint_names, dynamics, namespace)
    state = request.state
    for field in ("accelerations", "effort"):
        require_empty(state, field, "state", "the terms do not depend on it")
    require_empty(request.base, "accelerations", "base", "the terms do not depend on it")
    positions = read_positions([state], order, location="state")
    q = positions[0]
    qd = read_velocities([state], order, q, location="state")[0]
    base = read_base_point(request.base, dynamics.robot)
    rows = order.independent_order
    names = [dynamics.joint_names[row] for row in rows]
    friction = dynamics.friction(qd, q, base=base)
    elasticity = dynamics.elasticity(q, qd)
    if base is not None:  # its six rows come first
        names = [*BASE_ROWS, *names]
        rows = np.concatenate([np.arange(6), rows + 6])
        friction = np.concatenate([np.zeros(6), friction])
        elasticity = np.concatenate([np.zeros(6), elasticity])
    response.joint_names = names
    response.inertia_matrix = to_float_array(dynamics.inertia_matrix(q)[np.ix_(rows, rows)])
    response.coriolis = to_float_array(dynamics.coriolis(q, qd, base=base)[rows])
    response.gravity = to_float_array(dynamics.gravity(q, base=base)[rows])
    response.friction = to_float_array(friction[rows])
    response.elasticity = to_float_array(elasticity[rows])
    response.success = True


def _complete_trajectory(
    request: InverseDynamics.Request | DirectDynamics.Request,
    response: InverseDynamics.Response | DirectDynamics.Response,
    dynamics: Dynamics,
    namespace: str,
    computed: ResultField,
) -> None:
    """Fill the field `computed` in the points of a request, and what goes with it."""
    by_platform = _use_platform_points(request, dynamics)
    order = _match_request_joints(request, dynamics, namespace, by_platform)
    robot = dynamics.robot
    points = request.trajectory.points
    times = _point_times(points, (computed,), "the service computes it")
    wrenches = read_wrenches(request.external_wrenches, times, robot, namespace)
    if by_platform:
        result = _solve_platform(request, order, times, namespace, wrenches, computed)
    else:
        result = _solve_joints(request, order, times, namespace, wrenches, computed)
    response.trajectory = write_trajectory(
        request.trajectory, order, *result.motion, dynamics.embed_efforts(result.efforts)
    )
    if result.base_acceleration is not None:
        response.base = write_base(request.base, result.base_acceleration, robot)
    elif robot.platforms:
        response.base = write_platforms(points, result.motion, dynamics)
    if request.reaction_wrenches:
        response.reactions = write_reactions(points, result.reactions, order)
    response.success = True


def _solve_platform(
    request: InverseDynamics.Request | DirectDynamics.Request,
    order: JointOrder,
    times: Sequence[int],
    namespace: str,
    wrenches: dict[str, Array],
    computed: ResultField,
) -> DynamicsResult:
    """Return the dynamics of a robot whose platforms have the motion in the field `base`."""
    platform = order.dynamics.platform
    motion = read_platform_motion(request, order, times, namespace, has_accelerations=computed == "effort")
    seed = motion.seed
    efforts: Array | None = None
    if computed == "accelerations":
        seed = platform.joint_positions(motion.pose, seed, motion.other_joints)
        efforts = read_efforts(request.trajectory.points, order, seed)
    return platform.solve(
        motion.pose,
        motion.twist,
        acceleration=motion.acceleration,
        efforts=efforts,
        seed=seed,
        other_joints=motion.other_joints,
        external_wrenches=wrenches,
    )


def _solve_joints(
    request: InverseDynamics.Request | DirectDynamics.Request,
    order: JointOrder,
    times: Sequence[int],
    namespace: str,
    wrenches: dict[str, Array],
    computed: ResultField,
) -> DynamicsResult:
    """Return the dynamics of a robot whose joints have the motion in the trajectory."""
    dynamics = order.dynamics
    points = request.trajectory.points
    q = read_positions(points, order)
    qd = read_velocities(points, order, q)
    accelerations: Array | None = None
    efforts: Array | None = None
    if computed == "accelerations":
        efforts = read_efforts(points, order, q)
    else:
        accelerations = read_accelerations(points, order, q, qd)
    base = read_base(request.base, times, dynamics.robot, namespace)
    return dynamics.solve(q, qd, qdd=accelerations, efforts=efforts, base=base, external_wrenches=wrenches)


def _use_platform_points(request: Request, dynamics: Dynamics) -> bool:
    """Return whether the platforms give the motion; a trajectory without points then gets those of the platforms."""
    by_platform = has_platform_motion(request, dynamics.robot)
    if by_platform and not request.trajectory.points:
        times = [point.time_from_start for point in request.base.points]
        request.trajectory.points = [JointTrajectoryPoint(time_from_start=time) for time in times]
    return by_platform


def _match_request_joints(request: Request, dynamics: Dynamics, namespace: str, by_platform: bool) -> JointOrder:
    """Return the order of the joints; if the platforms give the motion, the joints need not be named."""
    names = request.trajectory.joint_names or (dynamics.joint_names if by_platform else [])
    return match_joints(names, dynamics, namespace)


def _point_times(points: Sequence[JointTrajectoryPoint], empty_fields: Sequence[str], reason: str) -> list[int]:
    """Return time_from_start [ns] of the points of a request, after checks: at least one, `empty_fields` are empty."""
    if not points:
        raise InvalidInputError("the trajectory has no points: one at least is needed")
    for number, point in enumerate(points):
        for field in empty_fields:
            require_empty(point, field, f"points[{number}]", reason)
    return [to_nanoseconds(point.time_from_start) for point in points]
