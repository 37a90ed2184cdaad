"""The services with flat arrays: inverse and direct dynamics, and the terms of the model, at many points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError, RobotDynamicsError, describe_unknown_name
from robot_dynamics.nodes.codecs.fields import to_float_array
from robot_dynamics.nodes.codecs.joint_order import match_joints
from robot_dynamics.nodes.codecs.joint_values import read_positions, read_velocities
from robot_dynamics.nodes.codecs.platform_messages import platform_rows
from robot_dynamics.nodes.dynamics_server.plain_points import complete_plain_batch, complete_plain_terms
from robot_dynamics.nodes.dynamics_server.point_requests import FlatPointRequest, read_base
from robot_dynamics.nodes.dynamics_server.point_solution import solve_points, with_sample_of_request
from robot_dynamics.nodes.dynamics_server.point_terms import TERMS, compute_terms, term_names, term_rows
from robot_dynamics.nodes.dynamics_server.point_work import first_range_of

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.dynamics_server.point_solution import PointSolution, ResultField
    from robot_dynamics_interfaces.srv import DirectDynamicsBatch, DynamicsTermsBatch, InverseDynamicsBatch


def handle_inverse_dynamics_batch(
    request: InverseDynamicsBatch.Request, response: InverseDynamicsBatch.Response, dynamics: Dynamics, namespace: str
) -> BatchWork | None:
    """InverseDynamicsBatch.srv: efforts from accelerations."""
    if complete_plain_batch(request, response, dynamics, namespace, "effort"):
        return None
    return BatchWork(request, response, dynamics, namespace, "effort")


def handle_direct_dynamics_batch(
    request: DirectDynamicsBatch.Request, response: DirectDynamicsBatch.Response, dynamics: Dynamics, namespace: str
) -> BatchWork | None:
    """DirectDynamicsBatch.srv: accelerations from efforts."""
    if complete_plain_batch(request, response, dynamics, namespace, "accelerations"):
        return None
    return BatchWork(request, response, dynamics, namespace, "accelerations")


def handle_dynamics_terms_batch(
    request: DynamicsTermsBatch.Request, response: DynamicsTermsBatch.Response, dynamics: Dynamics, namespace: str
) -> TermsWork | None:
    """DynamicsTermsBatch.srv: mass matrices, Coriolis, gravity, friction and elastic forces."""
    terms = _read_term_names(request.terms)
    if request.count == 1 and not request.base_poses and not request.base_twists:
        order = match_joints(request.joint_names, dynamics, namespace)
        if complete_plain_terms(response, order, terms, request.positions, request.velocities):
            return None
    return TermsWork(request, response, dynamics, namespace, terms)


class ArrayFields:
    """Arrays that become fields of a response: each range adds its rows."""

    def __init__(self) -> None:
        self._ranges: dict[str, list[Array]] = {}

    def add(self, field: str, rows: Array) -> None:
        """Add rows (k, ...) to a field."""
        self._ranges.setdefault(field, []).append(rows)

    def write(self, response: object) -> None:
        """Set the fields of the response."""
        for field, ranges in self._ranges.items():
            setattr(response, field, to_float_array(ranges[0] if len(ranges) == 1 else np.concatenate(ranges)))


class BatchWork:
    """Work of inverse or direct dynamics with flat arrays."""

    def __init__(
        self,
        message: InverseDynamicsBatch.Request | DirectDynamicsBatch.Request,
        response: InverseDynamicsBatch.Response | DirectDynamicsBatch.Response,
        dynamics: Dynamics,
        namespace: str,
        computed: ResultField,
    ) -> None:
        self._request = FlatPointRequest(message, dynamics, namespace)
        self._message = message
        self._response = response
        self._dynamics = dynamics
        self._computed: ResultField = computed
        self._arrays = ArrayFields()
        self.count = self._request.count
        self.first_range = first_range_of(dynamics)

    def compute(self, rows: slice) -> None:
        """Compute a range of points."""
        message = self._message
        computes_efforts = self._computed == "effort"
        needs_motion = message.motion or not computes_efforts
        solution = solve_points(self._request, rows, self._computed, needs_motion, message.reaction_wrenches)
        if computes_efforts:
            self._add_joint_field("efforts", self._request.order.embed_efforts(solution.efforts))
        if solution.motion is not None:
            if not computes_efforts or message.motion:
                self._add_joint_field("accelerations", solution.motion.accelerations)
            if message.motion:
                self._add_joint_field("positions", solution.motion.positions)
                self._add_joint_field("velocities", solution.motion.velocities)
        self._add_links(solution)
        if solution.reactions is not None and message.reaction_wrenches:
            bodies = [0, *(number + 1 for number in self._request.order.response_order)]
            self._arrays.add("reactions", solution.reactions[:, bodies])

    def finish(self) -> None:
        """Write the arrays, and name the joints and links."""
        response = self._response
        robot = self._dynamics.robot
        order = self._request.order
        self._arrays.write(response)
        response.joint_names = order.response_names
        if robot.moving_base:
            response.base_links = [robot.base_link]
        elif self._message.motion and robot.platforms:
            response.base_links = list(self._dynamics.platform.link_names)
        if self._message.reaction_wrenches:
            response.reaction_links = [
                robot.links[0].name,
                *(robot.links[number + 1].name for number in order.response_order),
            ]
        response.success = True

    def _add_joint_field(self, field: str, values: Array) -> None:
        """Add values (k, all joints) in the order of the response."""
        self._arrays.add(field, self._request.order.to_response(values))

    def _add_links(self, solution: PointSolution) -> None:
        """Add the acceleration of a moving base, or on request the motion of the platforms."""
        if solution.base_acceleration is not None:
            self._arrays.add("base_accelerations", solution.base_acceleration)
        elif self._message.motion and solution.motion is not None and self._dynamics.robot.platforms:
            positions, quaternions, twists, accelerations = platform_rows(solution.motion, self._dynamics)
            self._arrays.add("base_poses", np.concatenate([positions, quaternions], axis=-1))
            self._arrays.add("base_twists", twists)
            self._arrays.add("base_accelerations", accelerations)


class TermsWork:
    """Work of the terms of the dynamic model."""

    def __init__(
        self,
        message: DynamicsTermsBatch.Request,
        response: DynamicsTermsBatch.Response,
        dynamics: Dynamics,
        namespace: str,
        terms: Sequence[str],
    ) -> None:
        self._request = FlatPointRequest(message, dynamics, namespace)
        self._terms = terms
        self._response = response
        self._dynamics = dynamics
        self._arrays = ArrayFields()
        self._rows = term_rows(self._request.order)
        self._names = term_names(self._request.order)
        self.count = self._request.count
        self.first_range = first_range_of(dynamics)

    def compute(self, rows: slice) -> None:
        """Compute a range of points."""
        try:
            self._compute(rows)
        except RobotDynamicsError as error:
            raise with_sample_of_request(error, rows.start) from error

    def finish(self) -> None:
        """Write the arrays, and name their columns."""
        self._arrays.write(self._response)
        self._response.joint_names = self._names
        self._response.success = True

    def _compute(self, rows: slice) -> None:
        request = self._request
        dynamics = self._dynamics
        fields = request.fields(rows)
        q = read_positions(fields, request.order)
        qd = read_velocities(fields, request.order, q)
        base = read_base(request, rows)
        for term, values in compute_terms(dynamics, self._terms, q, qd, base).items():
            is_matrix = term == "inertia_matrix"
            self._arrays.add(term, values[:, self._rows[:, None], self._rows] if is_matrix else values[:, self._rows])


def _read_term_names(names: Sequence[str]) -> Sequence[str]:
    """Return the terms to compute, each once. Raises InvalidInputError for an unknown term."""
    for name in names:
        if name not in TERMS:
            raise InvalidInputError(f"terms: {describe_unknown_name('term', name, TERMS)}")
    return tuple(dict.fromkeys(names)) or TERMS
