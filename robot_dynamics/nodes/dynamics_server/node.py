"""The node dynamics_server: inverse and direct dynamics, static equilibria, natural frequencies and the terms of the
model as services."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from rclpy.node import Node

from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.dynamics_server.services import (
    handle_direct_dynamics,
    handle_dynamics_terms,
    handle_inverse_dynamics,
    handle_natural_frequencies,
    handle_static_equilibrium,
)
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import run_node
from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DynamicsTerms,
    InverseDynamics,
    NaturalFrequencies,
    StaticEquilibrium,
)

if TYPE_CHECKING:
    from robot_dynamics.nodes.diagnostics import Level, Values

SERVICES = (
    (InverseDynamics, "inverse_dynamics", handle_inverse_dynamics),
    (DirectDynamics, "direct_dynamics", handle_direct_dynamics),
    (DynamicsTerms, "dynamics_terms", handle_dynamics_terms),
    (StaticEquilibrium, "static_equilibrium", handle_static_equilibrium),
    (NaturalFrequencies, "natural_frequencies", handle_natural_frequencies),
)


class DynamicsServer(Node):
    """Provides the services ~/inverse_dynamics, ~/direct_dynamics, ~/dynamics_terms, ~/static_equilibrium and
    ~/natural_frequencies of a robot.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: dynamics_server --ros-args -p robot_file:=panda

    The response to an invalid request has success false and the reason; the node goes on. Every second /diagnostics
    has the name of the robot, the numbers of answered and refused requests, and the reason of the last refusal.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("dynamics_server", **arguments)
        self._robot = RobotSource(self)
        self._answered = 0
        self._refused = 0
        self._last_refusal = ""
        self._service_handles = [
            self.create_service(kind, f"~/{name}", self._callback(name, handle)) for kind, name, handle in SERVICES
        ]
        self._diagnostics = Diagnostics(self, "robot", self._report)

    def _callback(self, name: str, handle: Callable[..., Any]) -> Callable[[Any, Any], Any]:
        """Return the callback of a service: `handle` fills the response, or raises the reason of a refusal."""

        def callback(request: Any, response: Any) -> Any:
            try:
                handle(request, response, self._robot.dynamics, self.get_namespace())
            except Exception as error:
                reason = failure_reason(self.get_logger(), error)
            else:
                response.message = self._robot.reliability_warning
                self._answered += 1
                return response
            self._refused += 1
            self._last_refusal = f"{name}: {reason}"
            self.get_logger().warning(f"request refused: {self._last_refusal}", throttle_duration_sec=1.0)
            return type(response)(success=False, message=reason)

        return callback

    def _report(self, _elapsed: float) -> tuple[Level, str, str, Values]:
        values = {
            "requests answered": self._answered,
            "requests refused": self._refused,
            "last refusal": self._last_refusal,
        }
        return *self._robot.health(), self._robot.name, values


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(DynamicsServer, arguments)
