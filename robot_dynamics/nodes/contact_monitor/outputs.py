"""The topics that contact_monitor publishes."""

from __future__ import annotations

from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus, KeyValue
from geometry_msgs.msg import WrenchStamped
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool

from robot_dynamics.nodes.codecs.fields import to_float_array
from robot_dynamics.nodes.codecs.wrenches import write_wrench
from robot_dynamics.nodes.diagnostics import ERROR, OK
from robot_dynamics.nodes.qos import LATCHED_QOS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.monitoring.collision_detector import CollisionEvent

QOS_OVERRIDES = QoSOverridingOptions.with_default_policies()
EVENT_QOS = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""A late subscriber receives the last 100 events."""


class MonitorOutputs:
    """Publishes external efforts and wrenches, the decision, and events.

    Parameters
    ----------
    node : Node
    """

    def __init__(self, node: Node) -> None:
        self._torque = JointState()
        self._torques = node.create_publisher(JointState, "~/external_torque", 10, qos_overriding_options=QOS_OVERRIDES)
        self._wrenches = node.create_publisher(
            WrenchStamped, "~/external_wrench", 10, qos_overriding_options=QOS_OVERRIDES
        )
        self._base_wrenches = node.create_publisher(WrenchStamped, "~/external_base_wrench", 10)
        self._collisions = node.create_publisher(Bool, "~/collision", LATCHED_QOS)
        self._events = node.create_publisher(DiagnosticStatus, "~/event", EVENT_QOS)
        self._name = node.get_fully_qualified_name()
        self._collision: bool | None = None

    def publish_torques(self, stamp: Time, names: tuple[str, ...], efforts: Array) -> None:
        """Publish external efforts (n,) of the joints."""
        message = self._torque
        if len(message.name) != len(names) or tuple(message.name) != names:
            message.name = list(names)
        message.header.stamp = stamp
        message.effort = to_float_array(efforts)
        self._torques.publish(message)

    @property
    def has_wrench_subscribers(self) -> bool:
        """Whether a node subscribes to the wrench at the frame."""
        return self._wrenches.get_subscription_count() > 0

    def publish_wrench(self, stamp: Time, frame: str, wrench: Array) -> None:
        """Publish the wrench (6,) at the frame of the parameter."""
        self._wrenches.publish(_stamped(stamp, frame, wrench))

    def publish_base_wrench(self, stamp: Time, frame: str, wrench: Array) -> None:
        """Publish the wrench (6,) on a moving base."""
        self._base_wrenches.publish(_stamped(stamp, frame, wrench))

    def publish_collision(self, is_collision: bool) -> None:
        """Publish whether there is a collision, if that has changed."""
        if is_collision != self._collision:
            self._collision = is_collision
            self._collisions.publish(Bool(data=is_collision))

    def publish_beginning(
        self, robot: str, event: CollisionEvent, efforts: Array, bounds: Array, names: tuple[str, ...]
    ) -> None:
        """Publish the beginning of a collision; efforts, bounds: (n,) of all joints at that sample."""
        values = {"stamp [s]": f"{event.stamp * 1e-9:.9f}", "joint": event.joint}
        for name, effort, bound in zip(names, efforts, bounds, strict=True):
            values[f"external effort of {name}"] = f"{effort:.6g}"
            values[f"threshold of {name}"] = f"{bound:.6g}"
        self._publish_event(robot, ERROR, str(event), values)

    def publish_end(self, robot: str, stamp: int, reason: str) -> None:
        """Publish the end of a collision at a time [ns]."""
        self._publish_event(robot, OK, reason, {"stamp [s]": f"{stamp * 1e-9:.9f}"})

    def _publish_event(self, robot: str, level: bytes, text: str, values: dict[str, str]) -> None:
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        self._events.publish(
            DiagnosticStatus(
                name=f"{self._name}: collision", level=level, message=text, hardware_id=robot, values=pairs
            )
        )


def _stamped(stamp: Time, frame: str, wrench: Array) -> WrenchStamped:
    message = WrenchStamped(wrench=write_wrench(wrench))
    message.header.stamp = stamp
    message.header.frame_id = frame
    return message
