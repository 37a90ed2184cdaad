"""The node joint_state_completer: joint_states in; the states of all joints with loops closed, and markers out."""

from __future__ import annotations

import time
from array import array
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos_overriding_options import QoSOverridingOptions
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from robot_dynamics.nodes.codecs.fields import to_float_array
from robot_dynamics.nodes.codecs.wrenches import read_wrench, resolve_link
from robot_dynamics.nodes.diagnostics import Diagnostics, DurationStatistics
from robot_dynamics.nodes.guarded_callbacks import refusal_reason
from robot_dynamics.nodes.joint_state_completer.completion import StateCompletion
from robot_dynamics.nodes.joint_state_completer.health import CompleterStatus, completer_health
from robot_dynamics.nodes.joint_state_completer.markers import RobotMarkers, delete_all_markers
from robot_dynamics.nodes.joint_state_completer.parameters import PARAMETERS
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.joint_state_completer.completion import CompleteState

QOS_OVERRIDES = QoSOverridingOptions.with_default_policies()
WRENCH_LIFETIME = 1.0  # [s] of the machine for which a wrench that is not repeated is shown


class JointStateCompleter(Node):
    """Completes joint_states with the passive joints of loops and platforms: robot_state_publisher then shows a closed
    robot, with the URDF that `robot-dynamics convert ROBOT robot.urdf --lossy` writes.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: joint_state_completer --ros-args -p robot_file:=delta. A URDF has no loops: with one on
    the topic nothing is closed.

    ~/joint_states (JointState) has all joints, with the stamp of the message. ~/markers (MarkerArray) shows centres of
    mass, joint efforts, and wrenches on links that come on ~/external_wrench (WrenchStamped, frame_id the link).
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("joint_state_completer", **arguments)
        self._completion: StateCompletion | None = None
        self._markers: RobotMarkers | None = None
        self._wrenches: dict[str, tuple[float, Array]] = {}  # with the time of the machine [s] of their receipt
        self._received_at = -np.inf  # [s] of the machine
        self._markers_published_at = -np.inf
        self._published = 0
        self._refused = 0
        self._ignored = 0
        self._last_refusal = ""
        self._durations = DurationStatistics()
        declare_parameters(self, PARAMETERS)
        self._values = read_parameters(self, PARAMETERS)
        self._joint_state = JointState()
        self._locked_positions = np.zeros(0)
        self._joint_states = self.create_publisher(
            JointState, "~/joint_states", 10, qos_overriding_options=QOS_OVERRIDES
        )
        self._marker_publisher = self.create_publisher(MarkerArray, "~/markers", 10)
        self._robot = RobotSource(self, on_new_robot=self._on_new_robot)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._input_subscriptions = [
            self.create_subscription(
                JointState,
                "joint_states",
                self._on_joint_states,
                INPUT_STREAM_QOS,
                qos_overriding_options=QOS_OVERRIDES,
            ),
            self.create_subscription(WrenchStamped, "~/external_wrench", self._on_wrench, 10),
        ]
        self._diagnostics = Diagnostics(self, "completion", self._report)

    # Robot and parameters

    def _on_new_robot(self, dynamics: Dynamics) -> None:
        self._completion = StateCompletion(dynamics, self.get_namespace())
        self._wrenches.clear()
        locked = dynamics.robot.locked_joints
        self._joint_state = JointState(name=[*dynamics.all_joint_names, *(joint.name for joint in locked)])
        self._locked_positions = np.array([joint.position for joint in locked])
        self._restart_markers()

    def _restart_markers(self) -> None:
        """Remove all markers; the next ones are of the present robot and parameters."""
        if self._markers is not None:
            self._marker_publisher.publish(delete_all_markers())
        if self._completion is not None:
            self._markers = RobotMarkers(self._completion.dynamics, self._values)

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        return try_parameter_change(lambda: validate_changes(PARAMETERS, parameters))

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        changes = validate_changes(PARAMETERS, parameters)
        self._values = {**self._values, **changes}
        if any(name == "frame_prefix" or name.startswith("markers.") for name in changes):
            self._restart_markers()

    # Inputs and outputs

    def _on_joint_states(self, message: JointState) -> None:
        began = time.perf_counter()
        self._received_at = time.monotonic()
        completion = self._completion
        if completion is None:
            return
        try:
            state = completion.complete(message, self._values["use_passive_positions"])
            if state is None:
                self._ignored += 1
                return
            self._publish_state(message.header.stamp, message.header.frame_id, state)
            self._publish_markers(message.header.stamp, completion.dynamics, state)
        except Exception as error:
            self._refuse("joint_states", error)
            return
        self._durations.add(time.perf_counter() - began)
        self._diagnostics.publish_if_changed("")

    def _on_wrench(self, message: WrenchStamped) -> None:
        if self._completion is None:
            return
        try:
            robot = self._completion.dynamics.robot
            link = resolve_link(message.header.frame_id, robot, self.get_namespace(), "header.frame_id")
            wrench = read_wrench(message.wrench, f"external_wrench on {link!r}")
        except Exception as error:
            self._refuse("~/external_wrench", error)
        else:
            self._wrenches[link] = time.monotonic(), wrench

    def _refuse(self, topic: str, error: Exception) -> None:
        self._refused += 1
        self._last_refusal = refusal_reason(self.get_logger(), topic, error)
        self.get_logger().warning(f"refused: {self._last_refusal}", throttle_duration_sec=1.0)
        self._diagnostics.publish_if_changed(self._last_refusal)

    def _publish_state(self, stamp: Time, frame_id: str, state: CompleteState) -> None:
        message = self._joint_state
        message.header.stamp = stamp
        message.header.frame_id = frame_id
        message.position = to_float_array(np.append(state.positions, self._locked_positions))
        velocities = state.velocities
        at_rest = np.zeros_like(self._locked_positions)
        message.velocity = array("d") if velocities is None else to_float_array(np.append(velocities, at_rest))
        self._joint_states.publish(message)
        self._published += 1

    def _publish_markers(self, stamp: Time, dynamics: Dynamics, state: CompleteState) -> None:
        """Publish markers if they are due and there are subscribers."""
        rate = self._values["markers.rate"]
        now = time.monotonic()
        if self._markers is None or not rate or now - self._markers_published_at < 1 / rate:
            return
        if not self._marker_publisher.get_subscription_count():
            return
        self._markers_published_at = now
        wrenches = {
            link: wrench
            for link, (received_at, wrench) in self._wrenches.items()
            if now - received_at <= WRENCH_LIFETIME
        }
        self._marker_publisher.publish(self._markers.message(stamp, self._shown_efforts(dynamics, state), wrenches))

    def _shown_efforts(self, dynamics: Dynamics, state: CompleteState) -> Array:
        """Return the efforts (n,) that arrows show, nan where there are none.

        Those of gravity depend on the pose of a moving base, which is not known here.
        """
        selected = self._values["markers.efforts"]
        if selected == "measured":
            return state.efforts
        if selected == "gravity" and not dynamics.robot.moving_base and dynamics.joint_names:
            return dynamics.gravity(state.positions)
        return np.full(len(dynamics.joint_names), np.nan)

    # Diagnostics

    def _report(self, elapsed: float) -> tuple[Level, str, str, Values]:
        completion = self._completion
        unknown = tuple(completion.unknown_names) if completion is not None else ()
        status = CompleterStatus(
            topic=self.resolve_topic_name("joint_states"),
            standstill=time.monotonic() - self._received_at,
            timeout=self._values["state_timeout"],
            published=self._published,
            refused=self._refused,
            ignored=self._ignored,
            refusal=self._last_refusal,
            unknown_names=unknown,
        )
        values = {
            "messages refused since the last report": self._refused,
            "last refusal": self._last_refusal,
            "messages without joints of the robot": self._ignored,
            "unknown joints": ", ".join(unknown),
            "assembly mode chosen anew": completion.new_modes if completion is not None else 0,
            **self._durations.take("completion", elapsed),
        }
        self._published = self._refused = self._ignored = 0
        return *completer_health(self._robot, status), self._robot.name, values


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(JointStateCompleter, arguments, executor=make_events_executor)
