"""The services for a single state as functions of a request and a Dynamics, which fill the response.

They raise RobotDynamicsError to refuse a request. `namespace` is that of the node: it may precede names of joints and
links.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from trajectory_msgs.msg import JointTrajectoryPoint

from robot_dynamics.flexible.elastodynamics import Elastodynamics
from robot_dynamics.nodes.codecs.base import read_base_point
from robot_dynamics.nodes.codecs.fields import require_empty, to_float_array
from robot_dynamics.nodes.codecs.geometry import read_pose
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_trajectories import PointFields
from robot_dynamics.nodes.codecs.joint_values import read_positions, read_velocities
from robot_dynamics.nodes.dynamics_server.plain_points import complete_plain_terms
from robot_dynamics.nodes.dynamics_server.point_terms import TERMS, compute_terms, term_names, term_rows

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics_interfaces.srv import DynamicsTerms, NaturalFrequencies


def handle_natural_frequencies(
    request: NaturalFrequencies.Request, response: NaturalFrequencies.Response, dynamics: Dynamics, namespace: str
) -> None:
    """NaturalFrequencies.srv: frequencies and mode shapes at one pose, of the joints or of the platform."""
    positions: Array | None = None
    pose: Array | None = None
    if request.joint_names or request.positions or not dynamics.robot.platforms:
        order = match_joints(request.joint_names, dynamics, namespace)
        point = JointTrajectoryPoint(positions=request.positions)
        positions = read_positions(PointFields([point], location="request"), order)[0]
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
    if not request.base.transforms and not request.base.velocities:
        if complete_plain_terms(response, order, TERMS, state.positions, state.velocities):
            return
    fields = PointFields([state], location="state")
    positions = read_positions(fields, order)
    q = positions[0]
    qd = read_velocities(fields, order, positions)[0]
    base = read_base_point(request.base, dynamics.robot)
    rows = term_rows(order)
    terms = compute_terms(dynamics, TERMS, q, qd, base)
    matrix = terms.pop("inertia_matrix")
    response.joint_names = term_names(order)
    response.inertia_matrix = to_float_array(matrix[rows[:, None], rows])
    for term, values in terms.items():
        setattr(response, term, to_float_array(values[rows]))
    response.success = True
