"""The topic collision of computed_torque, such as contact_monitor publishes it, and the reaction to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from rclpy.node import Node
from std_msgs.msg import Bool

from robot_dynamics.nodes.qos import LATCHED_QOS

if TYPE_CHECKING:
    from robot_dynamics.control.modes import CollisionAction
    from robot_dynamics.nodes.computed_torque.control_loop import ControlLoop


class CollisionInput:
    """Subscription of collision (Bool, latched).

    Parameters
    ----------
    node : Node
    loop : callable
        Returns the control loop; None while the node is not configured.
    action : callable
        Returns the reaction that is chosen.
    """

    def __init__(
        self, node: Node, loop: Callable[[], ControlLoop | None], action: Callable[[], CollisionAction]
    ) -> None:
        self._logger = node.get_logger()
        self._loop = loop
        self._action = action
        self._is_collision = False
        self._subscription = node.create_subscription(Bool, "collision", self._on_collision, LATCHED_QOS)

    def update(self) -> None:
        """React to a collision that has begun, and end the reaction to one that is over."""
        loop = self._loop()
        if loop is None or not loop.is_active:
            return
        action = self._action() if self._is_collision else "none"
        if action == loop.controller.collision:
            return
        if action == "none":
            loop.controller.end_collision()
            self._logger.info("the collision is over: references are accepted")
        else:
            loop.controller.react_to_collision(loop.now(), action)
            self._logger.warning(f"collision: {action}; references are refused until it is over")

    def _on_collision(self, message: Bool) -> None:
        self._is_collision = message.data
        self.update()
