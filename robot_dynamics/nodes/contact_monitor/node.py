"""The node contact_monitor: joint_states in; external torques, the wrench at a frame, and collisions out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_dynamics.errors import InvalidInputError, RobotDynamicsError
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.contact_monitor.health import MonitorStatus, joint_parts, monitor_health, wrench_figures
from robot_dynamics.nodes.contact_monitor.monitoring_setup import build_monitoring
from robot_dynamics.nodes.contact_monitor.outputs import QOS_OVERRIDES, MonitorOutputs
from robot_dynamics.nodes.contact_monitor.parameters import PARAMETERS
from robot_dynamics.nodes.diagnostics import Diagnostics, DurationStatistics
from robot_dynamics.nodes.guarded_callbacks import refusal_reason
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    refuse_startup_changes,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.monitoring.contact_observer import Observation
    from robot_dynamics.nodes.contact_monitor.monitoring_setup import Monitoring
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.parameters import ParameterValues


class ContactMonitor(Node):
    """Observes external torques of a robot that moves, without a force sensor: ~/external_torque (JointState) for each
    message on joint_states, ~/external_wrench (WrenchStamped) at the frame of parameter frame, ~/collision (latched
    Bool), ~/event (DiagnosticStatus, the last 100 for late subscribers).

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: contact_monitor --ros-args -p robot_file:=panda

    joint_states need positions, velocities, efforts and stamps; accelerations are not needed. A robot with a moving
    base also needs odom. Service ~/reset (Trigger) ends a collision and restarts the observer.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("contact_monitor", **arguments)
        self._monitoring: Monitoring | None = None
        self._dynamics: Dynamics | None = None
        self._setup_error = ""
        self._is_built = False
        self._observation: Observation | None = None
        self._status = MonitorStatus()
        self._counted_restarts = 0
        self._received_at = -float("inf")  # [s] of the machine
        self._efforts_received_at = -float("inf")
        self._last_efforts: JointState | None = None
        self._durations = DurationStatistics()
        declare_parameters(self, PARAMETERS)
        self._values = read_parameters(self, PARAMETERS)
        self._candidate: tuple[ParameterValues, Monitoring | None] = (self._values, None)
        self._outputs = MonitorOutputs(self)
        self._robot = RobotSource(self, on_new_robot=self._on_new_robot, on_loaded=self._on_loaded)
        self._is_built = True
        if self._robot.name:
            self._on_new_robot(self._robot.dynamics)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._outputs.publish_collision(False)
        self._input_subscriptions = [
            self._subscribe(JointState, "joint_states", self._on_joint_states),
            self._subscribe(Odometry, "odom", self._on_odometry),
        ]
        if self._values["effort_topic"]:
            self._input_subscriptions.append(
                self._subscribe(JointState, self._values["effort_topic"], self._on_efforts)
            )
        self._reset_service = self.create_service(Trigger, "~/reset", self._on_reset)
        self._diagnostics = Diagnostics(self, "contacts", self._report, self._parts)

    def _subscribe(self, kind: type, topic: str, callback: Callable[..., None]) -> Subscription:
        return self.create_subscription(kind, topic, callback, INPUT_STREAM_QOS, qos_overriding_options=QOS_OVERRIDES)

    # Robot and parameters

    def _build(self, dynamics: Dynamics, values: ParameterValues) -> Monitoring:
        if self._robot.is_massless(dynamics):
            raise InvalidInputError(
                f"the description of {dynamics.robot.name!r} has no masses: external torques are what its model does "
                "not explain"
            )
        return build_monitoring(dynamics, values, self.get_namespace())

    def _on_loaded(self, dynamics: Dynamics) -> None:
        """Compile the programs of a new robot or payload, in the worker while the present one is observed."""
        try:
            build_monitoring(dynamics, self._values, self.get_namespace())
        except RobotDynamicsError:
            pass  # `_on_new_robot` reports it

    def _on_new_robot(self, dynamics: Dynamics) -> None:
        if not self._is_built:
            return
        self._dynamics = dynamics
        try:
            self._adopt(self._build(dynamics, self._values), "the robot or its payload changed")
        except RobotDynamicsError as error:
            self._monitoring = None
            self._setup_error = str(error)
            self.get_logger().error(f"nothing is observed: {error}")

    def _adopt(self, monitoring: Monitoring, reason: str) -> None:
        """Go on with another observer, which starts anew; a collision lasts until it finds low efforts."""
        previous = self._monitoring
        if previous is not None:
            monitoring.observer.detector.continue_from(previous.observer.detector)
            monitoring.observer.restarts = previous.observer.restarts + 1
            monitoring.observer.restart_reason = reason
            monitoring.base.continue_from(previous.base)
            monitoring.observer.balance.twist[:] = previous.observer.balance.twist
        self._monitoring = monitoring
        self._setup_error = ""
        self._observation = None

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        def change() -> None:
            refuse_startup_changes(PARAMETERS, parameters)
            changes = validate_changes(PARAMETERS, parameters)
            values = {**self._values, **changes}
            is_built_again = any(PARAMETERS[name].read_at == "configuration" for name in changes)
            monitoring = None
            if is_built_again and self._dynamics is not None:
                monitoring = self._build(self._dynamics, values)
            self._candidate = values, monitoring

        return try_parameter_change(change)

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        if any(parameter.name in PARAMETERS for parameter in parameters):
            self._values, monitoring = self._candidate
            if monitoring is not None:
                self._adopt(monitoring, "a parameter changed")

    # Inputs and outputs

    def _on_joint_states(self, message: JointState) -> None:
        began = time.perf_counter()
        self._received_at = time.monotonic()
        monitoring = self._monitoring
        if monitoring is None:
            return
        try:
            observation = self._observe(monitoring, message)
        except Exception as error:
            self._refuse("joint_states", error)
            return
        if observation is not None:
            self._status.observed += 1
            self._durations.add(time.perf_counter() - began)
        self._diagnostics.publish_if_changed("", monitoring.observer.detector.is_collision)

    def _observe(self, monitoring: Monitoring, message: JointState) -> Observation | None:
        """Observe the state of a message and publish; None for a message without the joints of the robot."""
        observer = monitoring.observer
        try:
            if not monitoring.joint_states.read(message, velocities_required=True):
                self._status.ignored += 1
                return None
            self._read_efforts(monitoring, message)
            monitoring.base.require_current(self._received_at, self._values["state_timeout"])
        except RobotDynamicsError as error:
            observer.restart(str(error))
            raise
        was_collision = observer.detector.is_collision
        observation = observer.update(to_nanoseconds(message.header.stamp))
        if observation is None:
            return None
        self._observation = observation
        self._publish(monitoring, message, observation, was_collision)
        return observation

    def _read_efforts(self, monitoring: Monitoring, message: JointState) -> None:
        """Copy the efforts of joint_states, or the last ones of the effort topic."""
        if not self._values["effort_topic"]:
            monitoring.read_efforts(message)
            return
        timeout = self._values["state_timeout"]
        if self._last_efforts is None or self._received_at - self._efforts_received_at > timeout:
            topic = self.resolve_topic_name(self._values["effort_topic"])
            raise InvalidInputError(f"no efforts on {topic} for {timeout:g} s")
        monitoring.read_efforts(self._last_efforts)

    def _publish(
        self, monitoring: Monitoring, message: JointState, observation: Observation, was_collision: bool
    ) -> None:
        observer = monitoring.observer
        dynamics = observer.balance.dynamics
        stamp = message.header.stamp
        names = dynamics.joint_names
        self._outputs.publish_collision(observation.is_collision)  # first: others react to it
        self._outputs.publish_torques(stamp, names, observation.efforts)
        if len(observation.base_wrench):
            self._outputs.publish_base_wrench(stamp, dynamics.robot.base_link, observation.base_wrench)
        if monitoring.wrench is not None and self._outputs.has_wrench_subscribers:
            frame_wrench = monitoring.wrench.estimate(observer.balance.program_positions, observation.efforts)
            self._outputs.publish_wrench(stamp, monitoring.wrench.frame, frame_wrench.wrench)
        event = observer.detector.event
        if observation.begins and event is not None:
            self._outputs.publish_beginning(
                dynamics.robot.name, event, observation.efforts, observer.detector.bounds, names
            )
            self.get_logger().warning(str(event))
        elif was_collision and not observation.is_collision:
            self._end_collision(observation.stamp, "the collision ended: external efforts are low again")

    def _end_collision(self, stamp: int, reason: str) -> None:
        self._outputs.publish_end(self._robot.name, stamp, reason)
        self.get_logger().info(reason)

    def _on_odometry(self, message: Odometry) -> None:
        if self._monitoring is not None:
            self._monitoring.base.read(message, time.monotonic())

    def _on_efforts(self, message: JointState) -> None:
        self._last_efforts = message
        self._efforts_received_at = time.monotonic()

    def _refuse(self, topic: str, error: Exception) -> None:
        self._status.refused += 1
        self._status.refusal = refusal_reason(self.get_logger(), topic, error)
        self.get_logger().warning(f"refused: {self._status.refusal}", throttle_duration_sec=1.0)
        self._diagnostics.publish_if_changed(self._status.refusal, self._is_collision)

    # Services

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        monitoring = self._monitoring
        if monitoring is None:
            response.success = False
            response.message = self._setup_error or self._robot.rejection_reason
            return response
        was_collision = monitoring.observer.detector.is_collision
        monitoring.observer.restart("service reset")
        monitoring.observer.detector.clear()
        self._outputs.publish_collision(False)
        if was_collision:
            self._end_collision(self.get_clock().now().nanoseconds, "the collision was reset")
        self._status.refusal = ""
        response.success = True
        response.message = "the collision was reset" if was_collision else "there was no collision"
        return response

    # Diagnostics

    @property
    def _is_collision(self) -> bool:
        return self._monitoring is not None and self._monitoring.observer.detector.is_collision

    def _report(self, elapsed: float) -> tuple[Level, str, str, Values]:
        status = self._status
        monitoring = self._monitoring
        status.standstill = time.monotonic() - self._received_at
        status.timeout = self._values["state_timeout"]
        status.topic = self.resolve_topic_name("joint_states")
        values: dict[str, object] = {
            "messages refused since the last report": status.refused,
            "last refusal": status.refusal,
        }
        if monitoring is not None:
            observer = monitoring.observer
            status.restarts = observer.restarts - self._counted_restarts
            self._counted_restarts = observer.restarts
            values |= {
                "restarts of the observer": observer.restarts,
                "last restart": observer.restart_reason,
                "messages with a repeated stamp": observer.repeated,
                "last collision": str(observer.detector.event or ""),
                "bandwidth [1/s]": f"{observer.detector.thresholds.bandwidth:g}",
            }
            if monitoring.wrench is not None and self._observation is not None:
                positions = observer.balance.program_positions
                values |= wrench_figures(monitoring.wrench.estimate(positions, self._observation.efforts))
        values |= self._durations.take("observation", elapsed)
        health = monitor_health(self._robot, monitoring, self._setup_error, status, self._is_collision)
        self._status = MonitorStatus(refusal=status.refusal)
        return *health, self._robot.name, values

    def _parts(self) -> Iterator[tuple[str, Level, str, Values]]:
        if self._monitoring is not None and self._observation is not None:
            yield from joint_parts(self._monitoring, self._observation)


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(ContactMonitor, arguments, executor=make_events_executor)
