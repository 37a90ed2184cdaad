"""What computed_torque sends: efforts in messages that are written anew each time, and the state of its control."""

import math
from array import array
from time import perf_counter

import numpy as np
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from robot_dynamics.nodes.qos import LATEST_ONLY_QOS

QOS_OVERRIDES = {"qos_overriding_options": QoSOverridingOptions.with_default_policies()}


class ControlOutputs:
    """~/commands, ~/effort and ~/state of a node."""

    def __init__(self, node):
        self._clock = node.get_clock()
        self._commands = node.create_publisher(Float64MultiArray, "~/commands", LATEST_ONLY_QOS, **QOS_OVERRIDES)
        self._effort = node.create_publisher(JointState, "~/effort", LATEST_ONLY_QOS, **QOS_OVERRIDES)
        self._state = node.create_publisher(JointTrajectory, "~/state", LATEST_ONLY_QOS, **QOS_OVERRIDES)
        self._told = -np.inf

    def configure(self, joints):
        """Make the messages for the joints of these names."""
        self._message = Float64MultiArray(data=array("d", bytes(8 * len(joints))))
        self._view = np.frombuffer(self._message.data)  # the array that the message holds, which is a copy
        self._named = JointState(name=list(joints))

    def publish_efforts(self, efforts, stamp=None, until=math.inf):
        """Publish efforts (joints,); by name as well where someone listens, stamped as the state that they answer, by
        which a receiver pairs the two; None: as now. A stamp of zero is none.

        until: when they are too old to be sent, by time.perf_counter() [s]; what has not left by then does not. Returns
        whether all has left in time: where this process stands still while it sends, efforts leave when it goes on.
        """
        self._view[:] = efforts
        if perf_counter() > until:
            return False
        self._commands.publish(self._message)
        if perf_counter() > until:
            return False
        if self._effort.get_subscription_count():
            told = stamp is not None and (stamp.sec or stamp.nanosec)
            self._named.header.stamp = stamp if told else self._clock.now().to_msg()
            self._named.effort = self._message.data
            if perf_counter() > until:
                return False
            self._effort.publish(self._named)
        return perf_counter() <= until

    def tell(self, controller, time, rate):
        """Publish reference, feedback, error and output of a Controller, at most `rate` times a second [1/s]."""
        if rate <= 0 or 0 <= time - self._told < 1 / rate:
            return
        self._told = time
        if self._state.get_subscription_count():
            self._state.publish(self._state_of(controller))

    def _state_of(self, controller):
        law, points = controller.law, [JointTrajectoryPoint() for _ in range(4)]
        feedback = law.q[law.joint_indices], law.qd[law.joint_indices]
        if not controller.no_reference_reason:
            wanted = controller.reference
            _fill(points[0], *wanted)
            _fill(points[2], wanted[0] - feedback[0], wanted[1] - feedback[1])
        _fill(points[1], *feedback)
        points[3].effort = array("d", self._view.tobytes())
        message = JointTrajectory(joint_names=list(law.joints), points=points)
        message.header.stamp = self._clock.now().to_msg()
        return message


def _fill(point, *fields):
    for name, values in zip(("positions", "velocities", "accelerations"), fields, strict=False):
        setattr(point, name, array("d", values.tobytes()))
