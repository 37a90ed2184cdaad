"""A probe of joint_state_completer: it publishes states and wrenches, and keeps the messages of the node."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import WrenchStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

QOS = QoSProfile(depth=2000, reliability=ReliabilityPolicy.RELIABLE)  # as robot_state_publisher


class CompleterProbe:
    """The messages of the node with a fully qualified name, received by a ServiceClient.

    states: JointState messages; markers: MarkerArray messages; diagnostics: [(level, message, values)].
    wrench_topic: in the namespace of the node, where it is remapped.
    """

    def __init__(self, name, client, wrench_topic=None):
        self.name, self.client, node = name, client, client.node
        namespace = name.rpartition("/")[0]
        self.states, self.markers, self.diagnostics = [], [], []
        self._subscriptions = [
            node.create_subscription(JointState, f"{name}/joint_states", self.states.append, QOS),
            node.create_subscription(MarkerArray, f"{name}/markers", self.markers.append, QOS),
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, QOS),
        ]
        self._joint_states = node.create_publisher(JointState, f"{namespace}/joint_states", 2000)
        self._wrenches = node.create_publisher(
            WrenchStamped, f"{namespace}/{wrench_topic}" if wrench_topic else f"{name}/external_wrench", 10
        )
        for publisher in (self._joint_states, self._wrenches):
            self.wait_until(publisher.get_subscription_count, f"a subscriber of {publisher.topic_name}")
        for topic in (f"{name}/joint_states", f"{name}/markers"):
            self.wait_until(lambda topic=topic: node.count_publishers(topic), f"a publisher of {topic}")

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name.startswith(self.name + ":"):
                self.diagnostics.append(
                    (status.level, status.message, {pair.key: pair.value for pair in status.values})
                )

    def wait_until(self, condition, description, patience=60.0):
        for _ in range(round(patience / 0.02)):
            if condition():
                return
            self.client.spin(0.02)
        raise AssertionError(f"not within {patience} s: {description}; {self.diagnostics[-1:]}")

    def wait_for_diagnostic(self, level, text):
        """Wait for a status that comes from now on."""
        begin = len(self.diagnostics)
        self.wait_until(
            lambda: any(status[0] == level and text in status[1] for status in self.diagnostics[begin:]),
            f"a status {level} with {text!r}",
        )

    def send(self, stamp, names, positions, velocities=(), efforts=()):
        """Publish joint_states with a stamp [ns]."""
        message = JointState(name=list(names), position=list(map(float, positions)))
        message.velocity = list(map(float, velocities))
        message.effort = list(map(float, efforts))
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        self._joint_states.publish(message)

    def complete(self, stamp, names, positions, velocities=(), efforts=()):
        """Publish joint_states, and return the complete state of the same stamp."""
        for _ in range(20):  # the first messages are lost while the middleware discovers
            self.send(stamp, names, positions, velocities, efforts)
            for _ in range(50):
                self.client.spin(0.02)
                for state in reversed(self.states):
                    if stamp_of(state) == stamp:
                        return state
        raise AssertionError(f"no complete state; {self.diagnostics[-1:]}")

    def mark(self, stamp, names, positions, efforts=()):
        """Publish joint_states until markers of their stamp come, and return these."""
        for _ in range(600):  # the node may not have discovered the subscriber yet
            self.send(stamp, names, positions, efforts=efforts)
            self.client.spin(0.05)
            for message in reversed(self.markers):
                if message.markers and stamp_of(message.markers[0]) == stamp:
                    return message.markers
        raise AssertionError(f"no markers; {self.diagnostics[-1:]}")

    def send_wrench(self, link, wrench):
        message = WrenchStamped()
        message.header.frame_id = link
        force, torque = message.wrench.force, message.wrench.torque
        force.x, force.y, force.z, torque.x, torque.y, torque.z = map(float, wrench)
        self._wrenches.publish(message)


def stamp_of(message):
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def values_by_name(message, field="position"):
    return dict(zip(message.name, np.array(getattr(message, field)), strict=True))
