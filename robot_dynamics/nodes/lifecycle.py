"""A lifecycle node that survives transitions which are not possible in its state."""

from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode

RCLError = rclpy_implementation.RCLError


class RobustLifecycleNode(LifecycleNode):
    """A LifecycleNode that refuses an impossible transition; that of rclpy 7.1 ends with an exception."""

    def _LifecycleNodeMixin__on_change_state(self, request: Any, response: Any) -> Any:  # the name-mangled service
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)  # type: ignore[misc]  # see above
        except RCLError as error:
            self.get_logger().error(f"transition refused: {error}")
            response.success = False
            return response
