"""The services for the kinematics of frames, and for centre of mass, momentum and energy, at a single state.

They raise RobotDynamicsError to refuse a request. `namespace` is that of the node: it may precede names of joints and
links.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from geometry_msgs.msg import Point, Vector3

from robot_dynamics.joint_space.frame_kinematics import concatenated_rates, products
from robot_dynamics.joint_space.frame_states import FrameStates
from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.base import read_base_point
from robot_dynamics.nodes.codecs.fields import require_empty, to_float_array
from robot_dynamics.nodes.codecs.geometry import write_accel, write_pose, write_twist
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_trajectories import PointFields
from robot_dynamics.nodes.codecs.joint_values import read_positions, read_velocities
from robot_dynamics.nodes.codecs.wrenches import resolve_link, write_wrench
from robot_dynamics.nodes.dynamics_server.point_terms import term_names, term_rows
from robot_dynamics.nodes.dynamics_server.point_work import StepWork

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.inputs import Base
    from robot_dynamics.joint_space.frame_kinematics import Axes
    from robot_dynamics_interfaces.srv import FrameKinematics, WholeBody


class _State(NamedTuple):
    """The state of a request: arguments of Dynamics, and the columns of matrices in the order of the request."""

    q: Array
    qd: Array
    base: Base | None
    columns: IntArray
    column_names: list[str]


def handle_frame_kinematics(
    request: FrameKinematics.Request, response: FrameKinematics.Response, dynamics: Dynamics, namespace: str
) -> StepWork:
    """FrameKinematics.srv: poses, twists, Jacobians and bias accelerations of frames at one state."""
    state = _read_state(request, dynamics, namespace)
    robot = dynamics.robot
    named = [resolve_link(name, robot, namespace, f"frames[{k}]") for k, name in enumerate(request.frames)]
    frames = named or list(robot.frames_by_name)
    axes: Axes = "world" if request.world_axes else "frame"
    states = FrameStates(dynamics, state.q, state.qd, axes, state.base)
    jacobians: list[Array] = []

    def add(name: str) -> None:
        frame = states.of(name)
        response.poses.append(write_pose(frame.pose[:3, 3], to_scipy_rotation(frame.pose[:3, :3]).as_quat()))
        response.twists.append(write_twist(frame.twist))
        response.bias_accelerations.append(write_accel(frame.bias_acceleration))
        jacobians.append(frame.jacobian[:, state.columns])

    def complete() -> None:
        response.jacobians = to_float_array(np.array(jacobians))
        response.frames = list(request.frames) or frames
        response.joint_names = state.column_names
        response.success = True

    return StepWork([*(partial(add, name) for name in frames), complete])


def handle_whole_body(
    request: WholeBody.Request, response: WholeBody.Response, dynamics: Dynamics, namespace: str
) -> StepWork:
    """WholeBody.srv: centre of mass, momentum and energy at one state."""
    q, qd, base, columns, response.joint_names = _read_state(request, dynamics, namespace)
    body = dynamics.whole_body

    def add_momentum() -> None:
        response.mass = body.mass
        matrix = body.centroidal_momentum_matrix(q, base=base)
        momentum = products(matrix, concatenated_rates(dynamics, qd, base))
        response.centre_of_mass_velocity = _fill(Vector3(), momentum[:3] / body.mass)
        response.linear_momentum = _fill(Vector3(), momentum[:3])
        response.angular_momentum = _fill(Vector3(), momentum[3:])
        response.momentum_matrix = to_float_array(matrix[:, columns])

    def add_centre() -> None:
        response.centre_of_mass = _fill(Point(), body.centre_of_mass(q, base=base))

    def add_bias() -> None:
        response.momentum_bias = write_wrench(body.centroidal_momentum_bias(q, qd, base=base))

    def add_kinetic_energy() -> None:
        response.kinetic_energy = float(body.kinetic_energy(q, qd, base=base))

    def add_potential_energy() -> None:
        response.gravitational_energy = float(body.gravitational_energy(q, base=base))
        response.elastic_energy = float(body.elastic_energy(q))
        response.success = True

    return StepWork([add_centre, add_momentum, add_bias, add_kinetic_energy, add_potential_energy])


def _read_state(request: FrameKinematics.Request | WholeBody.Request, dynamics: Dynamics, namespace: str) -> _State:
    """Return the checked state of a request. Raises InvalidInputError."""
    order = match_joints(request.joint_names, dynamics, namespace)
    for field in ("accelerations", "effort"):
        require_empty(request.state, field, "state", "the response does not depend on it")
    require_empty(request.base, "accelerations", "base", "the response does not depend on it")
    fields = PointFields([request.state], location="state")
    positions = read_positions(fields, order)
    qd = np.zeros(len(dynamics.joint_names))
    if len(request.state.velocities):
        qd = read_velocities(fields, order, positions)[0]
    base = read_base_point(request.base, dynamics.robot, at_rest=True)
    return _State(positions[0], qd, base, term_rows(order), term_names(order))


def _fill(message: Vector3 | Point, values: Array) -> Vector3 | Point:
    """Return the message with the components (3,)."""
    message.x, message.y, message.z = values.tolist()
    return message
