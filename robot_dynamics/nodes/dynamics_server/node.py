"""The node dynamics_server: inverse and direct dynamics, static equilibria, natural frequencies and the terms of the
model as services."""

import traceback

from rclpy.node import Node

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.dynamics_server.services import (
    handle_direct_dynamics,
    handle_dynamics_terms,
    handle_inverse_dynamics,
    handle_natural_frequencies,
    handle_static_equilibrium,
)
from robot_dynamics.nodes.processes import run_node
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics_interfaces.srv import (
    DirectDynamics,
    DynamicsTerms,
    InverseDynamics,
    NaturalFrequencies,
    StaticEquilibrium,
)

SERVICES = (
    (InverseDynamics, "inverse_dynamics", handle_inverse_dynamics),
    (DirectDynamics, "direct_dynamics", handle_direct_dynamics),
    (DynamicsTerms, "dynamics_terms", handle_dynamics_terms),
    (StaticEquilibrium, "static_equilibrium", handle_static_equilibrium),
    (NaturalFrequencies, "natural_frequencies", handle_natural_frequencies),
)


class DynamicsServer(Node):
    """Serves ~/inverse_dynamics, ~/direct_dynamics, ~/dynamics_terms, ~/static_equilibrium and ~/natural_frequencies
    for a robot.

    The robot is named by parameter robot_file (a path, or a robot that ships) or robot_description (a text), else taken
    from the topic robot_description: dynamics_server --ros-args -p robot_file:=panda

    A request that cannot be answered gets success false and the reason; the node goes on. Every second it tells on
    /diagnostics which robot it serves, how many requests were answered and refused, and why the last was refused.
    """

    def __init__(self, **arguments):
        super().__init__("dynamics_server", **arguments)
        self._robot = RobotSource(self)
        self._answered = self._refused = 0
        self._last_refusal = ""
        self._served = [
            self.create_service(kind, f"~/{name}", self._serve(name, answer)) for kind, name, answer in SERVICES
        ]
        self._diagnostics = Diagnostics(self, "robot", self._report)

    def _serve(self, name, answer):
        def serve(request, response):
            try:
                answer(request, response, self._robot.dynamics, self.get_namespace())
                response.message = self._robot.reliability_warning
                self._answered += 1
                return response
            except RobotDynamicsError as error:
                reason = str(error)
            except Exception as error:  # a fault of ours must not take the node, and all that depends on it, down
                self.get_logger().error(traceback.format_exc())
                reason = f"internal error, please report it: {error!r}"
            self._refused += 1
            self._last_refusal = f"{name}: {reason}"
            self.get_logger().warning(f"request refused: {self._last_refusal}", throttle_duration_sec=1.0)
            return type(response)(success=False, message=reason)

        return serve

    def _report(self, _elapsed):
        values = {
            "requests answered": self._answered,
            "requests refused": self._refused,
            "last refusal": self._last_refusal,
        }
        return *self._robot.health(), self._robot.name, values


def main(arguments=None):
    run_node(DynamicsServer, arguments)
