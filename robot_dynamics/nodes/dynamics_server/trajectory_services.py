"""The services with trajectories: inverse and direct dynamics, and static equilibria."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.codecs.base import write_base_points
from robot_dynamics.nodes.codecs.joint_trajectories import write_points
from robot_dynamics.nodes.codecs.joint_values import read_positions
from robot_dynamics.nodes.codecs.platform_messages import read_platform_motion, require_rest, write_platform_points
from robot_dynamics.nodes.codecs.wrenches import write_reactions
from robot_dynamics.nodes.dynamics_server.plain_points import complete_plain_trajectory
from robot_dynamics.nodes.dynamics_server.point_requests import TrajectoryRequest, read_base
from robot_dynamics.nodes.dynamics_server.point_solution import solve_points, with_sample_of_request
from robot_dynamics.nodes.dynamics_server.point_work import first_range_of

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.dynamics_server.point_requests import TrajectoryMessage
    from robot_dynamics.nodes.dynamics_server.point_solution import ResultField
    from robot_dynamics.results import Equilibrium
    from robot_dynamics_interfaces.srv import DirectDynamics, InverseDynamics, StaticEquilibrium


def handle_inverse_dynamics(
    request: InverseDynamics.Request, response: InverseDynamics.Response, dynamics: Dynamics, namespace: str
) -> TrajectoryWork | None:
    """InverseDynamics.srv: efforts from accelerations."""
    if complete_plain_trajectory(request, response, dynamics, namespace, "effort"):
        return None
    return TrajectoryWork(request, response, dynamics, namespace, "effort")


def handle_direct_dynamics(
    request: DirectDynamics.Request, response: DirectDynamics.Response, dynamics: Dynamics, namespace: str
) -> TrajectoryWork | None:
    """DirectDynamics.srv: accelerations from efforts."""
    if complete_plain_trajectory(request, response, dynamics, namespace, "accelerations"):
        return None
    return TrajectoryWork(request, response, dynamics, namespace, "accelerations")


def handle_static_equilibrium(
    request: StaticEquilibrium.Request, response: StaticEquilibrium.Response, dynamics: Dynamics, namespace: str
) -> EquilibriumWork:
    """StaticEquilibrium.srv: rest positions of the unactuated joints, and the efforts that hold the robot there."""
    return EquilibriumWork(request, response, dynamics, namespace)


class TrajectoryWork:
    """Work of inverse or direct dynamics: it fills the field `computed` of the points, and what goes with it."""

    def __init__(
        self,
        message: InverseDynamics.Request | DirectDynamics.Request,
        response: InverseDynamics.Response | DirectDynamics.Response,
        dynamics: Dynamics,
        namespace: str,
        computed: ResultField,
    ) -> None:
        self._request = TrajectoryRequest(message, dynamics, namespace, (computed,))
        self._message = message
        self._response = response
        self._dynamics = dynamics
        self._computed: ResultField = computed
        self.count = self._request.count
        self.first_range = first_range_of(dynamics)

    def compute(self, rows: slice) -> None:
        """Complete a range of points."""
        request = self._request
        response = self._response
        solution = solve_points(request, rows, self._computed, True, self._message.reaction_wrenches)
        motion = solution.motion
        assert motion is not None
        points = request.points[rows]
        fields = (*motion, self._request.order.embed_efforts(solution.efforts))
        names = ("positions", "velocities", "accelerations", "effort")
        write_points(points, {name: request.order.to_response(v) for name, v in zip(names, fields, strict=True)})
        if solution.base_acceleration is not None:
            response.base.points += write_base_points(self._message.base.points[rows], solution.base_acceleration)
        elif self._dynamics.robot.platforms:
            response.base.points += write_platform_points(points, motion, self._dynamics)
        if self._message.reaction_wrenches and solution.reactions is not None:
            response.reactions += write_reactions(points, solution.reactions, request.order)

    def finish(self) -> None:
        """Name the joints and links."""
        _finish_trajectory(self._message, self._response, self._request)
        robot = self._dynamics.robot
        if robot.moving_base:
            self._response.base.header = self._message.base.header
            self._response.base.joint_names = self._message.base.joint_names or [robot.base_link]
        elif robot.platforms:
            self._response.base.joint_names = list(self._dynamics.platform.link_names)


class EquilibriumWork:
    """Work of static equilibria."""

    def __init__(
        self,
        message: StaticEquilibrium.Request,
        response: StaticEquilibrium.Response,
        dynamics: Dynamics,
        namespace: str,
    ) -> None:
        empty_fields = ("velocities", "accelerations", "effort")
        self._request = TrajectoryRequest(message, dynamics, namespace, empty_fields, at_rest=True)
        self._message = message
        self._response = response
        self._dynamics = dynamics
        self.count = self._request.count
        self.first_range = first_range_of(dynamics)

    def compute(self, rows: slice) -> None:
        """Complete a range of points."""
        request = self._request
        try:
            equilibrium = self._find_equilibrium(rows)
        except RobotDynamicsError as error:
            raise with_sample_of_request(error, rows.start) from error
        positions = request.order.to_response(equilibrium.joint_positions)
        efforts = request.order.to_response(request.order.embed_efforts(equilibrium.efforts))
        rest = np.zeros_like(positions)
        points = request.points[rows]
        write_points(points, {"positions": positions, "velocities": rest, "accelerations": rest, "effort": efforts})
        self._response.stable += equilibrium.stable.tolist()
        if self._message.reaction_wrenches:
            self._response.reactions += write_reactions(points, equilibrium.reactions, request.order)

    def finish(self) -> None:
        """Name the joints."""
        _finish_trajectory(self._message, self._response, self._request)

    def _find_equilibrium(self, rows: slice) -> Equilibrium:
        request = self._request
        dynamics = self._dynamics
        fields = request.fields(rows)
        wrenches = request.wrenches(rows)
        if request.by_platform:
            assert request.links is not None
            motion = read_platform_motion(fields, request.links, rows, request.order, has_accelerations=False)
            require_rest(motion)
            return dynamics.platform.equilibrium(
                motion.pose, seed=motion.seed, other_joints=motion.other_joints, external_wrenches=wrenches
            )
        base = read_base(request, rows)
        return dynamics.equilibrium(read_positions(fields, request.order), base=base, external_wrenches=wrenches)


def _finish_trajectory(
    message: TrajectoryMessage,
    response: InverseDynamics.Response | DirectDynamics.Response | StaticEquilibrium.Response,
    request: TrajectoryRequest,
) -> None:
    """The points of the request, which are complete now, become those of the response."""
    response.trajectory = JointTrajectory(header=message.trajectory.header, joint_names=request.order.response_names)
    response.trajectory.points = request.points
    response.success = True
