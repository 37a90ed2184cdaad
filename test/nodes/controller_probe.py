"""A probe of computed_torque: it publishes states and references, and keeps the messages of the node."""

import threading
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Duration, Time
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from nav_msgs.msg import Odometry
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.nodes.codecs.fields import to_nanoseconds

PANDA = [f"panda_joint{k}" for k in range(1, 8)]
Q = np.array([0.1, -0.3, 0.2, -1.9, 0.1, 1.8, 0.5])
DEEP = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)


def to_time(ns):
    return Time(sec=ns // 10**9, nanosec=ns % 10**9)


def trajectory_message(names, times, positions, velocities=None, accelerations=None, start=0):
    """A JointTrajectory; start: [ns], zero for the present time."""
    message = JointTrajectory(joint_names=list(names))
    message.header.stamp = to_time(start)
    for k, seconds in enumerate(times):
        ns = round(seconds * 1e9)
        point = JointTrajectoryPoint(positions=np.asarray(positions[k], dtype=float))
        if velocities is not None:
            point.velocities = np.asarray(velocities[k], dtype=float)
        if accelerations is not None:
            point.accelerations = np.asarray(accelerations[k], dtype=float)
        point.time_from_start = Duration(sec=ns // 10**9, nanosec=ns % 10**9)
        message.points.append(point)
    return message


class BoundedList(list):
    """A list that keeps its last `most` items when it grows beyond twice as many; None: all."""

    def __init__(self, most):
        super().__init__()
        self._most = most

    def append(self, item):
        super().append(item)
        if self._most is not None and len(self) > 2 * self._most:
            del self[: -self._most]


class ControllerProbe:
    """The messages of the node with a fully qualified name, and publishers for its inputs.

    commands: [(seconds, efforts)]; efforts: [JointState]; states: [JointTrajectory]; state_stamps: [ns] of
    joint_states of any publisher; diagnostics: [(level, message, values)]. history: number of messages to keep, None
    for all; of diagnostics all are kept.
    """

    def __init__(self, target, client, states="joint_states", history=None):
        self.target, self.client = target, client
        namespace = target.rpartition("/")[0]
        self.node = rclpy.create_node("probe", namespace=namespace)
        self.joint_states = self.node.create_publisher(JointState, states, 10)
        self.odom = self.node.create_publisher(Odometry, "odom", 10)
        self.reference = self.node.create_publisher(JointTrajectory, f"{target}/reference", 10)
        self.reference_point = self.node.create_publisher(JointTrajectory, f"{target}/reference_point", 10)
        self.commands, self.efforts, self.states, self.state_stamps = (BoundedList(history) for _ in range(4))
        self.diagnostics = []
        for kind, topic, take in (
            (Float64MultiArray, f"{target}/commands", lambda m: self.commands.append((time.time(), np.array(m.data)))),
            (JointState, f"{target}/effort", self.efforts.append),
            (JointTrajectory, f"{target}/state", self.states.append),
            (JointState, states, lambda message: self.state_stamps.append(to_nanoseconds(message.header.stamp))),
            (DiagnosticArray, "/diagnostics", self._on_diagnostics),
        ):
            self.node.create_subscription(kind, topic, take, DEEP)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._spin)
        self._thread.start()

    def _spin(self):
        while not self._stop.is_set():
            try:
                self._executor.spin_once(timeout_sec=0.05)
            except ExternalShutdownException:
                return

    def _on_diagnostics(self, message):
        for status in message.status:
            if status.name.startswith(self.target + ":"):
                values = {pair.key: pair.value for pair in status.values}
                self.diagnostics.append((status.level, status.message, values))

    def close(self):
        self._stop.set()
        self._thread.join()
        self._executor.shutdown()
        self.node.destroy_node()

    def publish(self, q=Q, qd=None, names=PANDA, stamp=None):
        """Publish a state. stamp: [ns]; None: the present time."""
        message = JointState(name=list(names), position=np.asarray(q, dtype=float))
        message.velocity = np.zeros(len(q)) if qd is None else np.asarray(qd, dtype=float)
        message.header.stamp = to_time(time.time_ns() if stamp is None else stamp)
        self.joint_states.publish(message)

    def stream(self, seconds, rate=250.0, **state):
        """Publish states for a time [s], at a rate [1/s]."""
        until, following = time.monotonic() + seconds, time.monotonic()
        while following < until:
            self.publish(**state)
            following += 1 / rate
            time.sleep(max(0.0, following - time.monotonic()))

    def stream_until(self, condition, description, patience=20.0, **state):
        """Publish states until a condition holds."""
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, f"{description}: not within {patience} s; {self.diagnostics[-1:]}"
            self.stream(0.02, **state)

    def wait_until(self, condition, description, patience=20.0):
        """Wait until a condition holds, without publishing."""
        deadline = time.monotonic() + patience
        while not condition():
            assert time.monotonic() < deadline, f"{description}: not within {patience} s; {self.diagnostics[-1:]}"
            time.sleep(0.005)

    def has_diagnostic(self, text, since=0):
        return any(text in message for _, message, _ in self.diagnostics[since:])

    def stream_until_steady(self, **state):
        """Publish states until the efforts are at the end of their ramp."""

        def is_steady():
            sent = [efforts for _, efforts in self.commands[-20:]]
            alike = len(sent) == 20 and len({len(efforts) for efforts in sent}) == 1
            return alike and np.abs(sent).max() > 0 and np.ptp(sent, axis=0).max() < 1e-9

        self.stream_until(lambda: self.efforts and is_steady(), "efforts", **state)

    def change_state(self, transition):
        """Trigger a transition of the lifecycle by its id. Returns whether it succeeded."""
        request = ChangeState.Request(transition=Transition(id=transition))
        return self.client.call(ChangeState, f"{self.target}/change_state", request).success

    def set_parameters(self, **values):
        return self.client.set_parameters(self.target, values)
