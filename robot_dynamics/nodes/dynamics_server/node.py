"""The node dynamics_server: inverse and direct dynamics, the terms of the model, kinematics of frames, momentum and
energy, derivatives, static equilibria and natural frequencies as services."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.dynamics_server.batch_services import (
    handle_direct_dynamics_batch,
    handle_dynamics_terms_batch,
    handle_inverse_dynamics_batch,
)
from robot_dynamics.nodes.dynamics_server.kinematic_services import handle_frame_kinematics, handle_whole_body
from robot_dynamics.nodes.dynamics_server.linearization_service import handle_linearize
from robot_dynamics.nodes.dynamics_server.parameters import PARAMETERS
from robot_dynamics.nodes.dynamics_server.point_work import require_point_count
from robot_dynamics.nodes.dynamics_server.request_turns import RequestTurns
from robot_dynamics.nodes.dynamics_server.services import handle_dynamics_terms, handle_natural_frequencies
from robot_dynamics.nodes.dynamics_server.trajectory_services import (
    handle_direct_dynamics,
    handle_inverse_dynamics,
    handle_static_equilibrium,
)
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.middleware import large_messages
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.process_memory import keep_free_memory
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node
from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DirectDynamicsBatch,
    DynamicsTerms,
    DynamicsTermsBatch,
    FrameKinematics,
    InverseDynamics,
    InverseDynamicsBatch,
    Linearize,
    NaturalFrequencies,
    StaticEquilibrium,
    WholeBody,
)

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.dynamics_server.point_work import Handler

SERVICES: tuple[tuple[type, str, Handler], ...] = (
    (InverseDynamics, "inverse_dynamics", handle_inverse_dynamics),
    (InverseDynamicsBatch, "inverse_dynamics_batch", handle_inverse_dynamics_batch),
    (DirectDynamics, "direct_dynamics", handle_direct_dynamics),
    (DirectDynamicsBatch, "direct_dynamics_batch", handle_direct_dynamics_batch),
    (DynamicsTerms, "dynamics_terms", handle_dynamics_terms),
    (DynamicsTermsBatch, "dynamics_terms_batch", handle_dynamics_terms_batch),
    (FrameKinematics, "frame_kinematics", handle_frame_kinematics),
    (WholeBody, "whole_body", handle_whole_body),
    (Linearize, "linearize", handle_linearize),
    (StaticEquilibrium, "static_equilibrium", handle_static_equilibrium),
    (NaturalFrequencies, "natural_frequencies", handle_natural_frequencies),
)


class DynamicsServer(Node):
    """Provides the services ~/inverse_dynamics, ~/direct_dynamics, ~/dynamics_terms, ~/frame_kinematics, ~/whole_body,
    ~/linearize, ~/static_equilibrium and ~/natural_frequencies of a robot; the first three also with flat arrays, as
    ~/inverse_dynamics_batch and so on.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: dynamics_server --ros-args -p robot_file:=panda

    The response to an invalid request has success false and the reason; the node goes on. Long requests are computed in
    turns, so that short ones of other clients do not wait for them. Every second /diagnostics has the name of the
    robot, the numbers of answered, refused and unfinished requests, and the reason of the last refusal.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("dynamics_server", **arguments)
        declare_parameters(self, PARAMETERS)
        values = read_parameters(self, PARAMETERS)
        self._max_points: int = values["max_points"]
        self._robot = RobotSource(self)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._answered = 0
        self._refused = 0
        self._last_refusal = ""
        self._namespace: str = self.get_namespace()
        self._last_warning: tuple[Dynamics | None, str] = (None, "")  # of the robot that it is of
        self._turns = RequestTurns(self, values["request_timeout"])
        self._service_handles = [
            self._turns.create_service(kind, f"~/{name}", partial(self._respond, name, handle))
            for kind, name, handle in SERVICES
        ]
        self._diagnostics = Diagnostics(self, "robot", self._report)

    def _respond(self, name: str, handle: Handler, request: Any, response: Any) -> Any:
        """Callback of a service: return the response, or the PendingRequest of a long request."""
        complete = partial(self._complete, name, response, self._warning())
        try:
            work = handle(request, response, self._robot.dynamics, self._namespace)
            if work is None:
                return complete("")
            require_point_count(work, self._max_points)
            return self._turns.start(work, complete)
        except Exception as error:
            return complete(failure_reason(self.get_logger(), error))

    def _warning(self) -> str:
        """Return the warning of the responses for the present robot, empty for most robots."""
        dynamics = self._robot.dynamics if self._robot.name else None
        if self._last_warning[0] is not dynamics:
            self._last_warning = dynamics, self._robot.reliability_warning
        return self._last_warning[1]

    def _complete(self, name: str, response: Any, warning: str, reason: str) -> Any:
        """Return a response with a warning, or the refusal of its request for a reason."""
        if not reason:
            response.message = warning
            self._answered += 1
            return response
        self._refused += 1
        self._last_refusal = f"{name}: {reason}"
        self.get_logger().warning(f"request refused: {self._last_refusal}", throttle_duration_sec=1.0)
        return type(response)(success=False, message=reason)

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        return try_parameter_change(lambda: validate_changes(PARAMETERS, parameters))

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        changes = validate_changes(PARAMETERS, parameters)
        self._max_points = changes.get("max_points", self._max_points)
        self._turns.request_timeout = changes.get("request_timeout", self._turns.request_timeout)

    def _report(self, _elapsed: float) -> tuple[Level, str, str, Values]:
        values = {
            "requests answered": self._answered,
            "requests refused": self._refused,
            "requests unfinished": len(self._turns),
            "last refusal": self._last_refusal,
        }
        return *self._robot.health(), self._robot.name, values


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    keep_free_memory()
    run_node(DynamicsServer, arguments, make_events_executor, large_messages)
