"""The topics that computed_torque publishes: efforts, in messages that are reused, and the state of the controller."""

from __future__ import annotations

import math
from array import array
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from rclpy.lifecycle import LifecycleNode
from rclpy.publisher import Publisher
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.nodes.qos import LATEST_ONLY_QOS

try:
    from control_msgs.msg import JointTrajectoryControllerState
except ImportError:  # an optional package
    JointTrajectoryControllerState = None

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.control.controller import Controller

QOS_OVERRIDES = QoSOverridingOptions.with_default_policies()


class ControlOutputs:
    """Publishers of ~/commands, ~/effort, ~/state and, where control_msgs is installed, ~/controller_state."""

    def __init__(self, node: LifecycleNode) -> None:
        self._clock = node.get_clock()
        self._commands = self._publisher(node, Float64MultiArray, "~/commands")
        self._effort = self._publisher(node, JointState, "~/effort")
        self._state = self._publisher(node, JointTrajectory, "~/state")
        self._controller_state: Publisher | None = None
        if JointTrajectoryControllerState is not None:
            self._controller_state = self._publisher(node, JointTrajectoryControllerState, "~/controller_state")
        self._state_published_at = -np.inf
        self.configure(())

    def _publisher(self, node: LifecycleNode, kind: type, topic: str) -> Publisher:
        return node.create_publisher(kind, topic, LATEST_ONLY_QOS, qos_overriding_options=QOS_OVERRIDES)

    @property
    def effort_topics(self) -> tuple[str, str]:
        """Names of the topics of the efforts, after remapping."""
        return self._commands.topic_name, self._effort.topic_name

    def configure(self, joints: tuple[str, ...]) -> None:
        """Make the messages for the joints of these names."""
        self._message = Float64MultiArray(data=array("d", bytes(8 * len(joints))))
        self._view: Array = np.frombuffer(self._message.data)  # of the array in the message, which is a copy
        self._named_message = JointState(name=list(joints))

    def publish_efforts(self, efforts: Array, stamp: Time | None = None, until: float = math.inf) -> bool:
        """Publish efforts (joints,), also by name if there are subscribers, and return whether all left in time.

        If this process stands still while it publishes, efforts leave when it goes on.

        Parameters
        ----------
        stamp : of the state that the efforts belong to, by which a receiver pairs the two; None or zero: the present
            time.
        until : time of `time.perf_counter` [s] from which the efforts are too old: then the rest is not published.
        """
        self._view[:] = efforts
        if perf_counter() > until:
            return False
        self._commands.publish(self._message)
        if perf_counter() > until:
            return False
        if self._effort.get_subscription_count():
            is_stamped = stamp is not None and (stamp.sec or stamp.nanosec)
            self._named_message.header.stamp = stamp if is_stamped else self._clock.now().to_msg()
            self._named_message.effort = self._message.data
            if perf_counter() > until:
                return False
            self._effort.publish(self._named_message)
        return perf_counter() <= until

    def publish_state(self, controller: Controller, time: float, rate: float) -> None:
        """Publish reference, feedback, error and output of a controller, at most `rate` times a second [1/s]."""
        if rate <= 0 or 0 <= time - self._state_published_at < 1 / rate:
            return
        self._state_published_at = time
        if self._state.get_subscription_count():
            self._state.publish(self._state_message(controller))
        if self._controller_state is not None and self._controller_state.get_subscription_count():
            self._controller_state.publish(_controller_state_message(self._state_message(controller)))

    def _state_message(self, controller: Controller) -> JointTrajectory:
        law = controller.law
        reference, feedback, error, output = (JointTrajectoryPoint() for _ in range(4))
        positions = law.q[law.joint_indices]
        velocities = law.qd[law.joint_indices]
        if not controller.no_reference_reason:
            _fill(reference, *controller.reference)
            _fill(error, controller.reference[0] - positions, controller.reference[1] - velocities)
        _fill(feedback, positions, velocities)
        output.effort = array("d", self._view.tobytes())
        message = JointTrajectory(joint_names=list(law.joints), points=[reference, feedback, error, output])
        message.header.stamp = self._clock.now().to_msg()
        return message


def _controller_state_message(state: JointTrajectory) -> JointTrajectoryControllerState:
    """Return the same numbers in the type that joint_trajectory_controller publishes."""
    reference, feedback, error, output = state.points
    return JointTrajectoryControllerState(
        header=state.header,
        joint_names=state.joint_names,
        reference=reference,
        feedback=feedback,
        error=error,
        output=output,
        speed_scaling_factor=1.0,
    )


def _fill(point: JointTrajectoryPoint, *columns: Array) -> None:
    """Write positions, velocities and accelerations, as many as there are, into a point."""
    for field, values in zip(("positions", "velocities", "accelerations"), columns, strict=False):
        setattr(point, field, array("d", values.tobytes()))
