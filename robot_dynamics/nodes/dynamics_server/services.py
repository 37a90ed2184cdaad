"""The services as functions: a request and a Dynamics in, a response filled. To refuse they raise."""

from array import array

import numpy as np
from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.dynamics import BASE_ROWS
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.nodes.codecs.geometry import (
    read_base,
    read_base_point,
    read_pose,
    read_wrenches,
    require_empty,
    to_nanoseconds,
    write_base,
    write_reactions,
)
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_trajectories import (
    read_accelerations,
    read_efforts,
    read_positions,
    read_velocities,
    write_trajectory,
)
from robot_dynamics.nodes.codecs.platform import (
    has_platform_motion,
    read_platform_at_rest,
    read_platform_motion,
    write_platforms,
)


def handle_inverse_dynamics(request, response, dynamics, namespace):
    """InverseDynamics.srv: efforts from accelerations."""
    return _complete(request, response, dynamics, namespace, given="accelerations", asked="effort")


def handle_direct_dynamics(request, response, dynamics, namespace):
    """DirectDynamics.srv: accelerations from efforts."""
    return _complete(request, response, dynamics, namespace, given="effort", asked="accelerations")


def _complete(request, response, dynamics, namespace, given, asked):
    by_platform, order = _asked_by(request, dynamics, namespace)
    robot, points = dynamics.robot, request.trajectory.points
    times = _times(points, (asked,), "it is what is asked for")
    wrenches = read_wrenches(request.external_wrenches, times, robot, namespace)
    if by_platform:
        told = read_platform_motion(request, order, times, namespace, given == "accelerations")
        if given == "effort":
            told["seed"] = dynamics.platform.joint_positions(told["pose"], told["seed"], told["other_joints"])
            told["efforts"] = read_efforts(points, order, told["seed"])
        answer = dynamics.platform.solve(**told, external_wrenches=wrenches)
    else:
        q = read_positions(points, order)
        qd = read_velocities(points, order, q)
        if given == "effort":
            told = {"efforts": read_efforts(points, order, q)}
        else:
            told = {"qdd": read_accelerations(points, order, q, qd)}
        base = read_base(request.base, times, robot, namespace)
        answer = dynamics.solve(q, qd, **told, base=base, external_wrenches=wrenches)
    response.trajectory = write_trajectory(
        request.trajectory,
        order,
        *answer.motion,
        dynamics.embed_efforts(answer.efforts),
    )
    if robot.moving_base:
        response.base = write_base(request.base, answer.base_acceleration, robot)
    elif robot.platforms:
        response.base = write_platforms(points, answer.motion, dynamics)
    if request.reaction_wrenches:
        response.reactions = write_reactions(points, answer.reactions, order)
    response.success = True
    return response


def _asked_by(request, dynamics, namespace):
    """(whether the platform tells where the robot is, JointOrder): then joints need not be named, nor have points."""
    by_platform = has_platform_motion(request, dynamics.robot)
    if by_platform and not request.trajectory.points:
        told = [point.time_from_start for point in request.base.points]
        request.trajectory.points = [JointTrajectoryPoint(time_from_start=time) for time in told]
    names = request.trajectory.joint_names or (dynamics.joint_names if by_platform else [])
    return by_platform, match_joints(names, dynamics, namespace)


def _times(points, left_empty, why):
    """time_from_start [ns] of the points of a question: one at least, in which the fields `left_empty` are."""
    if not points:
        raise InvalidInputError("the trajectory has no points: one at least is needed")
    for number, point in enumerate(points):
        for field in left_empty:
            require_empty(point, field, f"points[{number}]", why)
    return [to_nanoseconds(point.time_from_start) for point in points]


def handle_static_equilibrium(request, response, dynamics, namespace):
    """StaticEquilibrium.srv: where joints without motor come to rest, and the efforts that hold the others."""
    by_platform, order = _asked_by(request, dynamics, namespace)
    robot, points = dynamics.robot, request.trajectory.points
    times = _times(points, ("velocities", "accelerations", "effort"), "it is part of the answer")
    wrenches = read_wrenches(request.external_wrenches, times, robot, namespace)
    if by_platform:
        told = read_platform_at_rest(request, order, times, namespace)
        found = dynamics.platform.equilibrium(**told, external_wrenches=wrenches)
    else:
        base = read_base(request.base, times, robot, namespace, at_rest=True)
        found = dynamics.equilibrium(read_positions(points, order), base=base, external_wrenches=wrenches)
    rest = np.zeros((len(points), len(dynamics.all_joint_names)))
    efforts = dynamics.embed_efforts(found.efforts)
    response.trajectory = write_trajectory(request.trajectory, order, found.joint_positions, rest, rest, efforts)
    response.stable = found.stable.tolist()
    if request.reaction_wrenches:
        response.reactions = write_reactions(points, found.reactions, order)
    response.success = True
    return response


def handle_natural_frequencies(request, response, dynamics, namespace):
    """NaturalFrequencies.srv: frequencies and modes at one pose, told by joints or by the platform."""
    if request.joint_names or request.positions or not dynamics.robot.platforms:
        order = match_joints(request.joint_names, dynamics, namespace)
        point = JointTrajectoryPoint(positions=request.positions)
        where = {"q": read_positions([point], order, location="request")[0]}
    else:
        where = {"pose": read_pose(request.platform, "platform")}
    elastodynamics = Elastodynamics(dynamics, list(request.held)) if request.held else dynamics.elastodynamics
    found = elastodynamics.natural_frequencies(**where, count=request.count or None)
    response.frequencies = array("d", found.frequencies.tobytes())
    response.coordinates = list(found.coordinates)
    response.mode_shapes = array("d", np.ascontiguousarray(found.mode_shapes).tobytes())
    response.success = True
    return response


def handle_dynamics_terms(request, response, dynamics, namespace):
    """DynamicsTerms.srv: A, Coriolis, gravity, friction and elasticity at one state."""
    order = match_joints(request.joint_names, dynamics, namespace)
    state, base = request.state, request.base
    for location, message, fields in (
        ("state", state, ("accelerations", "effort")),
        ("base", base, ("accelerations",)),
    ):
        for field in fields:
            require_empty(message, field, location, "the terms do not depend on it")
    q = read_positions([state], order, location="state")
    q, qd = q[0], read_velocities([state], order, q, location="state")[0]
    moving = read_base_point(base, dynamics.robot)
    rows = order.independent_order
    names = [dynamics.joint_names[row] for row in rows]
    friction, elasticity = dynamics.friction(qd, q), dynamics.elasticity(q, qd)
    if moving is not None:
        names, rows = [*BASE_ROWS, *names], np.concatenate([np.arange(6), rows + 6])
        friction, elasticity = (np.concatenate([np.zeros(6), term]) for term in (friction, elasticity))
    response.joint_names = names
    response.inertia_matrix = array("d", dynamics.inertia_matrix(q)[np.ix_(rows, rows)].tobytes())
    response.coriolis = array("d", dynamics.coriolis(q, qd, base=moving)[rows].tobytes())
    response.gravity = array("d", dynamics.gravity(q, base=moving)[rows].tobytes())
    response.friction = array("d", friction[rows].tobytes())
    response.elasticity = array("d", elasticity[rows].tobytes())
    response.success = True
    return response
