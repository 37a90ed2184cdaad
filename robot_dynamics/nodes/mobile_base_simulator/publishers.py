"""The topics that mobile_base_simulator publishes."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import AccelStamped
from nav_msgs.msg import Odometry
from rclpy.node import Node
from rclpy.publisher import Publisher
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from robot_dynamics.nodes.clocks import CLOCK_TOPIC
from robot_dynamics.nodes.mobile_base_simulator.outputs import (
    acceleration_message,
    joint_state_message,
    odometry_message,
    transform_message,
)
from robot_dynamics.nodes.qos import LATEST_ONLY_QOS

if TYPE_CHECKING:
    from robot_dynamics.nodes.mobile_base_simulator.inputs import SimulatorInputs, StepInputs
    from robot_dynamics.nodes.parameters import ParameterValues
    from robot_dynamics.simulation import Simulation

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # odom has the same data
    TFMessage = None


class SimulatorPublishers:
    """Publishers of joint_states, odom, /tf, /clock and ~/base_acceleration.

    Parameters
    ----------
    values : parameters of the node, which may change later.
    stamp : returns the time for the header of a message.

    Attributes
    ----------
    published_at : time of the machine [s] at which the state was published last.
    publication_count : how often the present state has been published.
    """

    def __init__(self, node: Node, values: ParameterValues, stamp: Callable[[], Time]) -> None:
        self._node = node
        self._values = values
        self._stamp = stamp
        self._joint_states = node.create_publisher(JointState, "joint_states", 10)
        self._odom = node.create_publisher(Odometry, "odom", LATEST_ONLY_QOS)
        self._acceleration = node.create_publisher(AccelStamped, "~/base_acceleration", LATEST_ONLY_QOS)
        self._clock: Publisher | None = None
        self.update_clock_publisher()
        self._tf = None if TFMessage is None else node.create_publisher(TFMessage, "/tf", 100)
        self._joint_state = JointState()
        self.published_at = -np.inf
        self.publication_count = 0
        self.restart()

    def restart(self) -> None:
        """Start the noise again, and publish the base with the next state."""
        self._random = np.random.default_rng(self._values["seed"])
        self._base_published_at = -np.inf  # [s] by the Simulation

    def update_clock_publisher(self) -> None:
        """Create or destroy the publisher of /clock: a silent one would pass for a second clock."""
        if self._values["publish_clock"] and self._clock is None:
            self._clock = self._node.create_publisher(Clock, CLOCK_TOPIC, LATEST_ONLY_QOS)
        elif not self._values["publish_clock"] and self._clock is not None:
            self._node.destroy_publisher(self._clock)
            self._clock = None

    def publish_state(
        self, simulation: Simulation, inputs: SimulatorInputs, stamp: Time, step_inputs: Callable[[], StepInputs]
    ) -> None:
        """Publish the state, and the motion of the base if it is due.

        step_inputs: returns the inputs that ~/base_acceleration is computed of.
        """
        values = self._values
        noise = values["noise.position"], values["noise.velocity"], self._random
        self._joint_state = joint_state_message(simulation, inputs.efforts, noise, stamp)
        self.publish_joint_states_again()
        state = simulation.state
        rate = values["odom_rate"]
        if simulation.base == "fixed" or not rate:
            return
        if state.time - self._base_published_at < 1 / rate - simulation.step / 2:
            return
        self._base_published_at = state.time
        odom_frame = values["odom_frame"]
        base_frame = values["base_frame"] or simulation.robot.base_link
        self._odom.publish(odometry_message(state, stamp, odom_frame, base_frame))
        if self._tf is not None:
            self._tf.publish(TFMessage(transforms=[transform_message(state, stamp, odom_frame, base_frame)]))
        if self._acceleration.get_subscription_count():
            acceleration, _ = simulation.accelerations(**step_inputs())
            self._acceleration.publish(acceleration_message(acceleration, stamp, base_frame))

    def publish_joint_states_again(self) -> None:
        """Publish the time, and the last state as it was measured."""
        self.published_at = time.monotonic()
        self.publication_count += 1
        stamp = self._stamp()
        if self._clock is not None:
            self._clock.publish(Clock(clock=stamp))
        self._joint_state.header.stamp = stamp
        self._joint_states.publish(self._joint_state)
