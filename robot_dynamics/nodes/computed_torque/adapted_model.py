"""The model that computed_torque adapts, for others: as a description on a topic, and back to the beginning."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING

from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.qos import LATCHED_QOS

if TYPE_CHECKING:
    from robot_dynamics.control.adaptive_law import AdaptiveLaw
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.computed_torque.control_loop import ControlLoop
    from robot_dynamics.nodes.diagnostics import Values


class AdaptedModel:
    """Services ~/publish_adapted_description and ~/reset_adaptation (Trigger), topic ~/adapted_description (String).

    Parameters
    ----------
    node : Node
    loop : callable
        Returns the control loop; None while the node is not configured.
    worker : ThreadPoolExecutor
        Writes descriptions, beside the efforts.
    """

    def __init__(self, node: Node, loop: Callable[[], ControlLoop | None], worker: ThreadPoolExecutor) -> None:
        self._logger = node.get_logger()
        self._loop = loop
        self._worker = worker
        self._publisher = node.create_publisher(String, "~/adapted_description", LATCHED_QOS)
        self._services = [
            node.create_service(Trigger, "~/publish_adapted_description", self._on_publish),
            node.create_service(Trigger, "~/reset_adaptation", self._on_reset),
        ]

    def diagnostics(self) -> Values:
        """Return whether parameters are adapted, and how far they are from the description."""
        loop = self._loop()
        adaptive = None if loop is None else loop.law.adaptive
        if loop is None or adaptive is None:
            return {}
        return {
            "adaptation": loop.controller.adaptation,
            "largest change of a parameter": f"{adaptive.parameters.largest_ratio:.3f} times",
        }

    def _adaptive_law(self) -> AdaptiveLaw:
        loop = self._loop()
        if loop is None:
            raise InvalidInputError("the node is not configured")
        if loop.law.adaptive is None:
            raise InvalidInputError("nothing is adapted: configure the node with mode adaptive_computed_torque")
        return loop.law.adaptive

    def _on_publish(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        def respond() -> str:
            self._worker.submit(self._publish, self._adaptive_law().adapted_robot())
            return f"the description follows on {self._publisher.topic_name}"

        return self._complete(response, respond)

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        def respond() -> str:
            self._adaptive_law().parameters.reset()
            loop = self._loop()
            assert loop is not None, "it has the law"
            loop.controller.apply(loop.controller.settings)  # efforts go to those of the description without a jump
            return "the parameters are those of the description"

        return self._complete(response, respond)

    def _complete(self, response: Trigger.Response, respond: Callable[[], str]) -> Trigger.Response:
        try:
            response.message = respond()
            response.success = True
        except Exception as error:
            response.message = failure_reason(self._logger, error)
            response.success = False
        return response

    def _publish(self, robot: Robot) -> None:
        """Write and publish a description, in the thread of the worker."""
        try:
            self._publisher.publish(String(data=write_mdh_yaml(robot)))
        except Exception as error:
            self._logger.error(f"the adapted description is not published: {failure_reason(self._logger, error)}")
