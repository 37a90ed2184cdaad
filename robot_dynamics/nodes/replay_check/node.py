"""The node replay_check: compares the efforts of a running robot, or of a bag that is played, with its model."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_dynamics.checking.live_check import LiveCheck
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.cli.check_tables import format_check
from robot_dynamics.errors import RecordingError, RobotDynamicsError
from robot_dynamics.nodes.codecs.fields import to_time_message
from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    refuse_startup_changes,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.qos import BUFFERED_INPUT_QOS
from robot_dynamics.nodes.replay_check.health import check_figures, check_health, joint_parts
from robot_dynamics.nodes.replay_check.parameters import PARAMETERS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node
from robot_dynamics.recordings.drives import load_drives
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.odometry import OdometryReader

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.checking.live_check import EffortPrediction
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.parameters import (
        ParameterValues,
    )

OUTPUT_QOS = QoSProfile(depth=1000)  # outputs of a third of a second are published at once
TICK = 0.1  # [s] between two evaluations


class ReplayCheck(Node):
    """Compares the efforts on joint_states with those that the model of the robot predicts, while messages arrive, as
    `robot-dynamics replay-check` does for bags; uses odom if the base of the robot moves.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: replay_check --ros-args -p robot_file:=panda

    ~/predicted_effort and ~/residual (JointState) have the stamps of the samples. They are published about a second
    later, since the filter needs later samples. Every second /diagnostics has the verdict of each joint: whether it is
    out of tolerance, by how much and since when. Services ~/report (Trigger: passed or not, with the table) and
    ~/reset.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("replay_check", **arguments)
        self._check: LiveCheck | None = None
        self._dynamics: Dynamics | None = None
        self._odometry: OdometryReader | None = None
        self._odometry_subscription: Subscription | None = None
        self._is_finished = True  # no data since the last verdict
        self._received = 0
        self._skipped = 0
        self._last_reason = ""
        self._setup_error = ""
        declare_parameters(self, PARAMETERS)
        self._values = read_parameters(self, PARAMETERS)
        self._candidate = self._values
        self._robot = RobotSource(self, on_new_robot=self._restart)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._predicted = self.create_publisher(JointState, "~/predicted_effort", OUTPUT_QOS)
        self._residual = self.create_publisher(JointState, "~/residual", OUTPUT_QOS)
        topics = dict.fromkeys(self._values["topics"]) or ["joint_states"]
        self._joint_state_subscriptions = [
            self.create_subscription(JointState, topic, self._on_joint_state(topic), BUFFERED_INPUT_QOS)
            for topic in topics
        ]
        self._service_handles = [
            self.create_service(Trigger, "~/report", self._on_report),
            self.create_service(Trigger, "~/reset", self._on_reset),
        ]
        self._diagnostics = Diagnostics(self, "check", self._report, self._parts)
        self._timer = self.create_timer(TICK, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # Robot and parameters

    def _new_check(self, dynamics: Dynamics, values: ParameterValues) -> LiveCheck:
        """Return the check of a robot with these parameters. Raises RobotDynamicsError."""
        return LiveCheck(
            dynamics,
            load_drives(values["drives"] or None, dynamics.joint_names),
            load_tolerances(values["tolerances"] or None, dynamics.joint_names),
            cutoff=values["cutoff"] or None,
            rate=values["rate"] or None,
            span=values["span"],
        )

    def _restart(self, dynamics: Dynamics) -> None:
        """Start a new check, of this robot."""
        self._dynamics = dynamics
        self._is_finished = True
        self._odometry = OdometryReader(dynamics.robot.base_link)
        if dynamics.robot.moving_base and self._odometry_subscription is None:
            self._odometry_subscription = self.create_subscription(
                Odometry, "odom", self._on_odometry, BUFFERED_INPUT_QOS
            )
        try:
            self._check = self._new_check(dynamics, self._values)
            self._setup_error = ""
        except RobotDynamicsError as error:
            self._check = None
            self._setup_error = str(error)
            self.get_logger().error(f"nothing is checked: {error}")

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        def change() -> None:
            refuse_startup_changes(PARAMETERS, parameters)
            changes = validate_changes(PARAMETERS, parameters)
            values = {**self._values, **changes}
            if changes and self._dynamics is not None:
                self._new_check(self._dynamics, values)
            self._candidate = values

        return try_parameter_change(change)

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        if any(parameter.name in PARAMETERS for parameter in parameters):
            self._values = self._candidate
            if self._dynamics is not None:
                self._restart(self._dynamics)

    # Inputs and outputs

    def _on_joint_state(self, topic: str) -> Callable[[JointState], None]:
        name = self.resolve_topic_name(topic)

        def callback(message: JointState) -> None:
            check = self._check
            if check is not None:
                self._received += 1
                self._process(lambda: check.feed(sample_of_joint_state(name, time.time_ns(), message)))

        return callback

    def _on_odometry(self, message: Odometry) -> None:
        check = self._check
        odometry = self._odometry
        if check is not None and odometry is not None:
            self._received += 1
            self._process(lambda: check.feed(odometry.sample("odom", time.time_ns(), message)))

    def _on_tick(self) -> None:
        check = self._check
        if check is None:
            return
        if not self._stale_names(check):
            self._is_finished = False
            self._process(check.advance)
        elif not self._is_finished:
            self._is_finished = True
            self._process(check.finish)
        else:
            self._process(check.advance)
        self._diagnostics.publish_if_changed(*self._health())

    def _stale_names(self, check: LiveCheck) -> list[str]:
        return check.find_stale_names(time.time_ns(), self._values["stale_after"])

    def _process(self, compute: Callable[[], Iterable[EffortPrediction]]) -> None:
        """Publish the predictions of a computation; data that it refuses are counted."""
        try:
            for prediction in compute():
                self._publish(prediction)
        except Exception as error:
            self._skipped += 1
            self._last_reason = failure_reason(self.get_logger(), error)
            self.get_logger().warning(f"left out: {self._last_reason}", throttle_duration_sec=1.0)

    def _publish(self, prediction: EffortPrediction) -> None:
        motion = prediction.motion
        empty = np.zeros((len(prediction.stamps), 0))
        self._publish_rows(self._predicted, prediction, motion.q, motion.qd, prediction.predicted)
        self._publish_rows(self._residual, prediction, empty, empty, prediction.residuals)

    def _publish_rows(
        self, publisher: Publisher, prediction: EffortPrediction, positions: Array, velocities: Array, efforts: Array
    ) -> None:
        """Publish one message for each row of positions, velocities and efforts (N, n)."""
        if not publisher.get_subscription_count() or self._dynamics is None:
            return
        message = JointState(name=list(self._dynamics.joint_names))
        rows = zip(prediction.stamps.tolist(), positions, velocities, efforts, strict=True)
        for stamp, position, velocity, effort in rows:
            message.header.stamp = to_time_message(stamp)
            message.position = array("d", position.tobytes())
            message.velocity = array("d", velocity.tobytes())
            message.effort = array("d", effort.tobytes())
            publisher.publish(message)

    # Services

    def _on_report(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        try:
            if self._check is None:
                raise RecordingError(self._setup_error or self._robot.rejection_reason)
            result = self._check.result()
            response.message = format_check(result)
            response.success = result.passed
        except Exception as error:
            response.success = False
            response.message = failure_reason(self.get_logger(), error)
        return response

    def _on_reset(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._dynamics is None:
            response.success = False
            response.message = self._robot.rejection_reason
            return response
        self._received = 0
        self._skipped = 0
        self._last_reason = ""
        self._restart(self._dynamics)
        response.success = not self._setup_error
        response.message = self._setup_error
        return response

    # Diagnostics

    def _report(self, _elapsed: float) -> tuple[Level, str, str, Values]:
        values: dict[str, object] = {
            "messages heard": self._received,
            "left out": self._skipped,
            "last reason": self._last_reason,
        }
        figures: Mapping[str, object] = check_figures(self._check) if self._check is not None else {}
        return *self._health(), self._robot.name, {**values, **figures}

    def _health(self) -> tuple[Level, str]:
        stale = self._stale_names(self._check) if self._check is not None else []
        return check_health(self._robot, self._check, self._setup_error, stale, self._values["stale_after"])

    def _parts(self) -> Iterator[tuple[str, Level, str, Values]]:
        if self._check is not None:
            yield from joint_parts(self._check, is_stale=bool(self._stale_names(self._check)))


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(ReplayCheck, arguments, executor=make_events_executor)
