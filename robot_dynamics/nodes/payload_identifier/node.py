"""The node payload_identifier: finds what a link of a running robot carries, and sets it on other nodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_dynamics.checking.load_hint import last_link_name
from robot_dynamics.errors import InvalidInputError, RecordingError, RobotDynamicsError
from robot_dynamics.identification.payload_identification import (
    identify_payload,
    node_parameters,
    require_payload_link,
)
from robot_dynamics.nodes.client import ServiceClient
from robot_dynamics.nodes.codecs.wrenches import resolve_link
from robot_dynamics.nodes.deferred_responses import defer_responses
from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.parameter_requests import run_in_executor, yielding_thread
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    refuse_startup_changes,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.payload_identifier.measurement import Baseline, Measurement, load_drives_of
from robot_dynamics.nodes.payload_identifier.parameters import PARAMETERS
from robot_dynamics.nodes.payload_identifier.responses import write_payload
from robot_dynamics.nodes.qos import BUFFERED_INPUT_QOS, SERVICE_QOS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node
from robot_dynamics.nodes.running_nodes import set_parameters_of_nodes
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.odometry import OdometryReader
from robot_dynamics.recordings.recording import require_motors
from robot_dynamics.recordings.sample_statistics import SampleStatistics
from robot_dynamics_interfaces.srv import IdentifyPayload

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.deferred_responses import DeferredResponse
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.recordings.joint_samples import JointSample
    from robot_dynamics.recordings.recording import Recording

TICK = 0.05  # [s] between two looks at the end of a measurement
SETTING_SERVICE = "/set_parameters_atomically"
DISCOVERY_TIME = 8.0
"""Time [s] after which a node that is not discovered counts as absent, long before the end of a long measurement."""


class PayloadIdentifier(Node):
    """Finds mass, centre of mass and, where the motion shows it, inertia of what a link carries, from the messages on
    joint_states that arrive during a measurement, as `robot-dynamics identify-payload` does from recordings.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot without load,
    else the topic robot_description: payload_identifier --ros-args -p robot_file:=panda

    Service ~/identify_payload measures for a time, fits, and sets the parameters payload.* of the nodes that the
    request names. With without_load it measures the robot without the load, for later requests. ~/stop (Trigger) ends
    the measurement now. The fit runs beside the executor.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("payload_identifier", **arguments)
        self._measurement: Measurement | None = None
        self._baseline: Baseline | None = None
        self._odometry: OdometryReader | None = None
        self._odometry_subscription: Subscription | None = None
        self._received = 0
        self._identified = 0
        self._refused = 0
        self._last_refusal = ""
        self._last_payload = ""
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="payload")
        self._client = ServiceClient(node=self)
        declare_parameters(self, PARAMETERS)
        self._values = read_parameters(self, PARAMETERS)
        self._robot = RobotSource(self, on_new_robot=self._on_new_robot)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        topics = dict.fromkeys(self._values["topics"]) or ["joint_states"]
        self._joint_state_subscriptions = [
            self.create_subscription(JointState, topic, self._on_joint_state(topic), BUFFERED_INPUT_QOS)
            for topic in topics
        ]
        service = self.create_service(
            IdentifyPayload, "~/identify_payload", self._on_identify_payload, qos_profile=SERVICE_QOS
        )
        defer_responses(service)
        self._service_handles = [service, self.create_service(Trigger, "~/stop", self._on_stop)]
        self._diagnostics = Diagnostics(self, "payload", self._report)
        self._timer = self.create_timer(TICK, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # Robot and parameters

    def _on_new_robot(self, dynamics: Dynamics) -> None:
        """Forget what was measured with another robot."""
        self._baseline = None
        self._odometry = OdometryReader(dynamics.robot.base_link)
        if dynamics.robot.moving_base and self._odometry_subscription is None:
            self._odometry_subscription = self.create_subscription(
                Odometry, "odom", self._on_odometry, BUFFERED_INPUT_QOS
            )
        measurement = self._measurement
        if measurement is not None and not measurement.is_fitted:
            self._refuse(measurement, "the robot of this node changed during the measurement: measure again")

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        def change() -> None:
            refuse_startup_changes(PARAMETERS, parameters)
            changes = validate_changes(PARAMETERS, parameters)
            if self._robot.name:
                self._check_settings({**self._values, **changes})

        return try_parameter_change(change)

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        self._values = {**self._values, **validate_changes(PARAMETERS, parameters)}

    def _check_settings(self, values: dict[str, Any]) -> None:
        """Refuse a link or drives that do not fit the robot. Raises RobotDynamicsError."""
        dynamics = self._robot.dynamics
        load_drives_of(dynamics, values["drives"])
        if values["link"]:
            require_payload_link(dynamics.robot, values["link"])

    # Inputs

    def _on_joint_state(self, topic: str) -> Callable[[JointState], None]:
        name = self.resolve_topic_name(topic)

        def callback(message: JointState) -> None:
            self._add(lambda: sample_of_joint_state(name, time.time_ns(), message))

        return callback

    def _on_odometry(self, message: Odometry) -> None:
        odometry = self._odometry
        if odometry is not None:
            self._add(lambda: odometry.sample("odom", time.time_ns(), message), is_base=True)

    def _add(self, make_sample: Callable[[], JointSample], is_base: bool = False) -> None:
        """Add a sample to the measurement that runs."""
        measurement = self._measurement
        if measurement is None or measurement.is_fitted:
            return
        self._received += 1
        try:
            measurement.add(make_sample(), self.get_clock().now().nanoseconds, is_base)
        except Exception as error:
            reason = failure_reason(self.get_logger(), error)
            self.get_logger().warning(f"left out: {reason}", throttle_duration_sec=1.0)

    # Services

    def _on_identify_payload(
        self, request: IdentifyPayload.Request, _response: IdentifyPayload.Response
    ) -> IdentifyPayload.Response | DeferredResponse:
        try:
            if self._measurement is not None and self._measurement.request != request:
                raise RobotDynamicsError(f"a measurement runs: {self._state()}. Wait for it, or call ~/stop")
            if self._measurement is None:
                self._measurement = self._new_measurement(request)
            return self._measurement.wait()
        except Exception as error:
            return self._refusal(failure_reason(self.get_logger(), error))

    def _on_stop(self, _request: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        measurement = self._measurement
        response.success = measurement is not None and not measurement.is_fitted
        if measurement is not None and response.success:
            measurement.is_stopped = True
            response.message = f"stopped after {self._elapsed(measurement):.3g} s"
        else:
            response.message = "no measurement runs"
        return response

    def _new_measurement(self, request: IdentifyPayload.Request) -> Measurement:
        """Return the measurement of a checked request. Raises RobotDynamicsError."""
        dynamics = self._robot.dynamics
        limit = self._values["max_duration"]
        if not 0 < request.duration <= limit:
            raise InvalidInputError(
                f"duration is {request.duration:g} s: more than 0 and {limit:g} s at most is needed (parameter "
                "max_duration)"
            )
        require_motors(dynamics)
        name = request.link or self._values["link"] or last_link_name(dynamics.robot)
        link = resolve_link(name, dynamics.robot, self.get_namespace(), "link")
        require_payload_link(dynamics.robot, link)
        if request.without_load and (request.use_without_load or request.set_nodes):
            raise InvalidInputError(
                "without_load: nothing is fitted. Leave set_nodes empty and use_without_load false, and send a request "
                "with the load after this one"
            )
        if request.use_without_load and self._baseline is None:
            raise InvalidInputError(
                "use_without_load: nothing was measured without load with this robot. Send a request with without_load "
                "before"
            )
        return Measurement(
            request,
            dynamics,
            link,
            self._nodes_to_set(request.set_nodes),
            self._values,
            load_drives_of(dynamics, self._values["drives"]),
            self.get_clock().now().nanoseconds,
            self._baseline if request.use_without_load else None,
        )

    def _nodes_to_set(self, names: Sequence[str]) -> tuple[str, ...]:
        """Return the full names of nodes to set. Raises InvalidInputError where they must not be set."""
        namespace = self.get_namespace().rstrip("/")
        full_names = tuple(name if name.startswith("/") else f"{namespace}/{name}" for name in names)
        if self.get_fully_qualified_name() in full_names:
            raise InvalidInputError("set_nodes: the robot of this node is the one without load: leave it out")
        if full_names and self.get_parameter("payload.link").value:
            raise InvalidInputError(
                "set_nodes: this node has a payload of its own, as part of the robot without load, and the nodes would "
                "lose it. Add it to the description, or set the parameters of the response yourself"
            )
        return full_names

    def _require_nodes(self, names: Sequence[str]) -> None:
        """Refuse nodes that do not run. Raises InvalidInputError."""
        services = {name for name, _ in self.get_service_names_and_types()}
        running = {name.removesuffix(SETTING_SERVICE) for name in services if name.endswith(SETTING_SERVICE)}
        missing = [name for name in names if name not in running]
        if missing:
            others = ", ".join(sorted(running - {self.get_fully_qualified_name()})) or "none"
            raise InvalidInputError(f"set_nodes: no node {missing[0]} runs. Nodes with parameters are: {others}")

    # Measurement and fit

    def _on_tick(self) -> None:
        measurement = self._measurement
        if measurement is None or measurement.is_fitted:
            return
        now = self.get_clock().now().nanoseconds
        is_over = measurement.is_over(now)
        try:
            if measurement.elapsed(now) > DISCOVERY_TIME:
                self._require_nodes(measurement.set_nodes)
        except RobotDynamicsError as error:
            self._refuse(measurement, str(error))
            return
        if is_over:
            measurement.is_fitted = True
            future = self._worker.submit(self._evaluate, measurement)
            future.add_done_callback(lambda done: run_in_executor(self, lambda: self._on_evaluated(measurement, done)))

    def _evaluate(self, measurement: Measurement) -> tuple[IdentifyPayload.Response, Baseline | None]:
        """Return the response of a measurement, and what is kept of one without load. Raises RobotDynamicsError.

        It runs in the worker.
        """
        with yielding_thread():
            if not len(measurement.samples):
                topics = ", ".join(subscription.topic_name for subscription in self._joint_state_subscriptions)
                raise RecordingError(f"no message arrived on {topics}")
            loaded, empty = measurement.recordings()
            if measurement.request.without_load:
                return _read_baseline(measurement, loaded[0])
            values = measurement.values
            fit = identify_payload(
                measurement.dynamics,
                measurement.link,
                loaded,
                empty,
                cutoff=values["cutoff"] or None,
                band=values["band"] or None,
                effort_accuracy=values["effort_accuracy"],
            )
            response = write_payload(fit, measurement.link, measurement.dynamics)
        if fit.is_determined:
            self._set_nodes(measurement.set_nodes, node_parameters(measurement.link, fit), response)
        elif measurement.set_nodes:
            response.message += "; set_nodes: no parameter was set"
        return response, None

    def _set_nodes(
        self, names: Sequence[str], parameters: dict[str, object], response: IdentifyPayload.Response
    ) -> None:
        """Set the parameters of nodes, and write the outcome into the response."""
        done: list[str] = []
        try:
            for name in set_parameters_of_nodes(self._client, names, parameters):
                done.append(name)  # those before an error count too
        except RobotDynamicsError as error:
            response.success = False
            response.message = "; ".join(filter(None, [f"set_nodes: {error}", response.message]))
        response.set_nodes = done

    def _on_evaluated(
        self, measurement: Measurement, future: Future[tuple[IdentifyPayload.Response, Baseline | None]]
    ) -> None:
        """Send the response of a measurement that was evaluated."""
        error = future.exception()
        if isinstance(error, Exception):
            self._refuse(measurement, failure_reason(self.get_logger(), error))
            return
        response, baseline = future.result()
        if baseline is not None and baseline.dynamics is self._robot.dynamics:
            self._baseline = baseline
        if response.success:
            self._identified += 1
        if not measurement.request.without_load:
            self._last_payload = f"{response.mass:.4g} ± {response.mass_deviation:.2g} kg on {response.link!r}"
            verdict = "determined" if response.determined else "not determined"
            self.get_logger().info(f"{verdict}: {self._last_payload}")
        if response.message:
            self.get_logger().info(response.message)
        self._finish(measurement, response)

    def _refuse(self, measurement: Measurement, reason: str) -> None:
        """End a measurement for a reason."""
        self._finish(measurement, self._refusal(reason))

    def _refusal(self, reason: str) -> IdentifyPayload.Response:
        """Return the response that refuses a request for a reason."""
        self._refused += 1
        self._last_refusal = reason
        self.get_logger().warning(f"request refused: {reason}", throttle_duration_sec=1.0)
        return IdentifyPayload.Response(success=False, message=reason)

    def _finish(self, measurement: Measurement, response: IdentifyPayload.Response) -> None:
        """Send a response to all requests that wait for it, and be ready for another measurement."""
        if self._measurement is measurement:
            self._measurement = None
        for waiting in measurement.waiting:
            try:
                if waiting.send is not None:
                    waiting.send(response)
            except Exception as error:  # the client has gone, for example
                failure_reason(self.get_logger(), error)

    # Diagnostics

    def _elapsed(self, measurement: Measurement) -> float:
        return measurement.elapsed(self.get_clock().now().nanoseconds)

    def _state(self) -> str:
        """What the node does, as words."""
        measurement = self._measurement
        if measurement is None:
            return "waiting for a request"
        if measurement.is_fitted:
            return "fitting"
        return f"measuring, {self._elapsed(measurement):.1f} of {measurement.request.duration:g} s"

    def _report(self, _elapsed: float) -> tuple[Level, str, str, Values]:
        values = {
            "state": self._state(),
            "messages received": self._received,
            "measured without load": self._baseline is not None,
            "requests answered": self._identified,
            "requests refused": self._refused,
            "last refusal": self._last_refusal,
            "last load": self._last_payload,
        }
        return *self._robot.health(), self._robot.name, values


def _read_baseline(measurement: Measurement, recording: Recording) -> tuple[IdentifyPayload.Response, Baseline]:
    """Return the response of a measurement without load, and the samples to keep. Raises RecordingError."""
    statistics = SampleStatistics()
    motions = recording.motions(statistics, cutoff=measurement.values["cutoff"] or None)
    seconds = sum(len(motion) / motion.rate for motion in motions)
    message = "; ".join([f"{seconds:.3g} s without load are kept", *statistics.sentences])
    response = IdentifyPayload.Response(success=True, message=message, link=measurement.link)
    return response, Baseline(measurement.dynamics, measurement.samples)


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(PayloadIdentifier, arguments, executor=make_events_executor)
