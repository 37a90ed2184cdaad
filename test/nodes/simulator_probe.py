"""A probe of mobile_base_simulator: it keeps the messages of the node, and publishes its inputs."""

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import AccelStamped, Twist, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory


class SimulatorProbe:
    """The messages of the node with a fully qualified name, received by a ServiceClient.

    joint_states, odom, clock, accelerations: lists of messages; diagnostics: [(level, message, values)]. stamped:
    whether cmd_vel is TwistStamped.
    """

    def __init__(self, name, client, stamped=False):
        self.name, self.client, node = name, client, client.node
        namespace = name.rpartition("/")[0]
        self.joint_states, self.odom, self.clock, self.accelerations, self.diagnostics = [], [], [], [], []
        self._subscriptions = [
            node.create_subscription(kind, topic, callback, 2000)
            for kind, topic, callback in (
                (JointState, f"{namespace}/joint_states", self.joint_states.append),
                (Odometry, f"{namespace}/odom", self.odom.append),
                (Clock, "/clock", self.clock.append),
                (AccelStamped, f"{name}/base_acceleration", self.accelerations.append),
                (DiagnosticArray, "/diagnostics", self._on_diagnostics),
            )
        ]
        self._out = {
            topic: node.create_publisher(kind, topic, 10)
            for kind, topic in (
                (Float64MultiArray, f"{name}/commands"),
                (JointState, f"{name}/effort"),
                (TwistStamped if stamped else Twist, f"{namespace}/cmd_vel"),
                (WrenchStamped, f"{name}/external_wrench"),
                (JointTrajectory, f"{name}/reference"),
            )
        }
        for topic, publisher in self._out.items():
            self.wait_until(lambda publisher=publisher: publisher.get_subscription_count(), f"a subscriber of {topic}")

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name.startswith(self.name + ":"):
                values = {pair.key: pair.value for pair in status.values}
                self.diagnostics.append((status.level, status.message, values))

    def wait_until(self, condition, description, patience=30.0):
        for _ in range(round(patience / 0.02)):
            if condition():
                return
            self.client.spin(0.02)
        raise AssertionError(f"not within {patience} s: {description}; {self.diagnostics[-1:]}")

    def has_diagnostic(self, text):
        return any(text in " ".join([message, *values.values()]) for _, message, values in self.diagnostics)

    def publish(self, topic, message):
        self._out[topic if topic in self._out else f"{self.name}/{topic}"].publish(message)

    def send_efforts(self, efforts):
        self.publish("commands", Float64MultiArray(data=np.asarray(efforts, dtype=float).tolist()))

    def call_trigger(self, service):
        return self.client.call(Trigger, f"{self.name}/{service}", Trigger.Request())

    def set_paused(self, paused):
        return self.client.call(SetBool, f"{self.name}/pause", SetBool.Request(data=paused))

    def make_steps(self, count):
        """Make steps, one by one, and receive the state after each."""
        for _ in range(count):
            received_count = len(self.joint_states)
            response = self.call_trigger("step")
            assert response.success, response.message
            self.wait_until(
                lambda received_count=received_count: len(self.joint_states) > received_count, "the state after a step"
            )
        return self.joint_states[-1]


def seconds(stamp):
    return stamp.sec + stamp.nanosec * 1e-9
