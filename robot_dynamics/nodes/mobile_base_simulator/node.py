"""The node mobile_base_simulator: efforts, wheel commands and wrenches in; joint_states, odom, /tf and /clock out."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

from geometry_msgs.msg import Twist, TwistStamped, WrenchStamped
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.clocks import ClockMonitor
from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.guarded_callbacks import refusal_reason
from robot_dynamics.nodes.mobile_base_simulator.health import SimulatorStatus, simulator_health
from robot_dynamics.nodes.mobile_base_simulator.inputs import SimulatorInputs
from robot_dynamics.nodes.mobile_base_simulator.other_publishers import OtherPublishers
from robot_dynamics.nodes.mobile_base_simulator.parameters import PARAMETERS
from robot_dynamics.nodes.mobile_base_simulator.simulation_loop import SimulationLoop
from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import (
    build_simulation,
    joint_limit_warnings,
)
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    refuse_startup_changes,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS
from robot_dynamics.nodes.robot_parameters import PARAMETERS as ROBOT_PARAMETERS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import (
        SimulationSetup,
    )
    from robot_dynamics.nodes.parameters import ParameterValues

LONG_STANDSTILL = 1.0  # [s] without efforts, after which a simulation that waits for them is a warning
TICK = 0.001  # [s] between two checks whether steps are due


@dataclass(frozen=True, eq=False)
class Candidate:
    """A simulation for changed parameters, and whether it starts from its initial state, or continues."""

    setup: SimulationSetup
    restarts: bool


@dataclass(frozen=True, eq=False)
class PreparedSetup:
    """What `build_simulation` has made of parameters and a robot: a setup, or why there is none."""

    values: ParameterValues
    outcome: SimulationSetup | RobotDynamicsError


class MobileBaseSimulator(Node):
    """Simulates a robot: ~/commands (Float64MultiArray, in the order of parameter `joints`) or ~/effort (JointState)
    move it, joint_states has its state.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: mobile_base_simulator --ros-args -p robot_file:=panda

    Its base is fixed, flies freely, slides in a plane, or rolls on wheels; then cmd_vel (Twist) drives it. Wrenches on
    links come on ~/external_wrench (WrenchStamped, frame_id the link). With moved_by:=reference the joints follow
    ~/reference (JointTrajectory), and the base moves by reaction. The motion of a moving base is on odom, /tf and
    ~/base_acceleration. Services ~/pause (SetBool), ~/reset and ~/step (Trigger). Commands that are not repeated are
    zero after command_timeout.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("mobile_base_simulator", **arguments)
        self._dynamics: Dynamics | None = None  # of the robot that is, or cannot be, simulated
        self._candidate: Candidate | None = None
        self._refused = 0
        self._last_refusal = ""
        self._last_failure = ""
        self._commands_timed_out = False
        declare_parameters(self, PARAMETERS)
        self._values = read_parameters(self, PARAMETERS)
        self._prepared: WeakKeyDictionary[Dynamics, PreparedSetup] = WeakKeyDictionary()
        self._robot = RobotSource(self, on_loaded=self._prepare_simulation)
        self._clock_monitor = ClockMonitor(self)
        self._other_publishers = OtherPublishers(self, self._state_topics)
        self._loop = SimulationLoop(self, self._values)
        self._subscribe()
        self._diagnostics = Diagnostics(self, "simulation", self._report)
        self._timer = self.create_timer(TICK, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._loop.restart_pacer()
        self._update_robot()
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)

    def _subscribe(self) -> None:
        twist = TwistStamped if self._values["stamped_cmd_vel"] else Twist
        stream = INPUT_STREAM_QOS
        self._input_subscriptions = [
            self._input_subscription(Float64MultiArray, "~/commands", SimulatorInputs.on_commands, stream),
            self._input_subscription(JointState, "~/effort", SimulatorInputs.on_efforts, stream),
            self._input_subscription(twist, "cmd_vel", SimulatorInputs.on_cmd_vel, stream),
            self._input_subscription(WrenchStamped, "~/external_wrench", SimulatorInputs.on_wrench, 10),
            self._input_subscription(JointTrajectory, "~/reference", SimulatorInputs.on_reference, 1),
        ]
        self._service_handles = [
            self.create_service(SetBool, "~/pause", self._on_pause),
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(Trigger, "~/step", self._on_step),
        ]

    def _input_subscription(
        self, kind: type, topic: str, read: Callable[[SimulatorInputs, float, Any], None], qos: QoSProfile | int
    ) -> Subscription:
        def callback(message: Any) -> None:
            active = self._loop.active
            if active is None:
                return
            try:
                body = message.twist if isinstance(message, TwistStamped) else message
                read(active.inputs, self._loop.now(), body)
                self._loop.efforts_received_at = time.monotonic()
                if self._values["wait_for_commands"] == "each" and active.inputs.has_new_efforts:
                    self._on_tick()
            except Exception as error:
                self._refused += 1
                self._last_refusal = refusal_reason(self.get_logger(), topic, error)
                self.get_logger().warning(f"refused: {self._last_refusal}", throttle_duration_sec=1.0)
                self._diagnostics.publish_if_changed(self._last_refusal)

        return self.create_subscription(kind, topic, callback, qos)

    # Robot and parameters

    def _update_robot(self) -> None:
        """Simulate the robot of the source, if it has another one than is simulated."""
        if not self._robot.name or self._robot.dynamics is self._dynamics:
            return
        self._dynamics = self._robot.dynamics
        try:
            self._simulate(self._candidate or Candidate(self._setup(self._dynamics), False))
        except RobotDynamicsError as error:
            self._loop.stop(str(error))
            self.get_logger().error(f"not simulated: {error}")

    def _prepare_simulation(self, dynamics: Dynamics) -> None:
        """Build the simulation of a robot that is not yet used: compiling it can take seconds."""
        values = dict(self._values)
        outcome: SimulationSetup | RobotDynamicsError
        try:
            outcome = build_simulation(values, dynamics.robot)
        except RobotDynamicsError as error:
            outcome = error
        self._prepared[dynamics] = PreparedSetup(values, outcome)

    def _setup(self, dynamics: Dynamics) -> SimulationSetup:
        """Return the setup that was prepared, or a new one if parameters have changed since.

        A setup is used once: the simulation in it moves. Raises RobotDynamicsError.
        """
        prepared = self._prepared.pop(dynamics, None)
        if prepared is None or prepared.values != self._values:
            return build_simulation(self._values, dynamics.robot)
        if isinstance(prepared.outcome, RobotDynamicsError):
            raise prepared.outcome
        return prepared.outcome

    def _simulate(self, candidate: Candidate) -> None:
        self._candidate = None
        self._loop.start(candidate.setup, candidate.restarts)
        logger = self.get_logger()
        simulation = candidate.setup.simulation
        for warning in joint_limit_warnings(simulation):
            logger.warning(warning)
        names = ", ".join(candidate.setup.joint_names)
        logger.info(f"simulates {simulation.robot!r}, {simulation.base} base, commands are for {names}")

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        def change() -> None:
            refuse_startup_changes(PARAMETERS, parameters)
            changes = validate_changes(PARAMETERS, parameters)
            self._candidate = None
            if self._dynamics is not None and any(PARAMETERS[name].read_at == "configuration" for name in changes):
                setup = build_simulation({**self._values, **changes}, self._dynamics.robot)
                self._candidate = Candidate(setup, any(name.startswith("initial.") for name in changes))

        return try_parameter_change(change)

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        self._values.update(validate_changes(PARAMETERS, parameters))
        self._loop.outputs.update_clock_publisher()
        if any(parameter.name in ROBOT_PARAMETERS for parameter in parameters):
            self._candidate = None  # it is of the previous robot
        elif self._candidate is not None:
            self._simulate(self._candidate)
        if self._loop.active is not None:
            self._loop.active.inputs.timeout = self._values["command_timeout"]
        self._loop.restart_pacer()

    # Time

    def _on_tick(self) -> None:
        self._update_robot()
        self._loop.tick()
        self._publish_changes()

    def _publish_changes(self) -> None:
        """Publish /diagnostics if the simulation has stopped, or efforts have timed out or come again."""
        loop = self._loop
        if loop.failure != self._last_failure:
            self._last_failure = loop.failure
            if loop.failure:
                self._diagnostics.publish_if_changed(loop.failure)
        if loop.commands_timed_out is not self._commands_timed_out:
            self._commands_timed_out = loop.commands_timed_out
            self._diagnostics.publish_if_changed(loop.commands_timed_out)

    # Services

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._loop.is_paused = request.data
        self._loop.restart_pacer()
        response.success = True
        response.message = f"{'paused' if request.data else 'runs'} at {self._loop.now():.6g} s"
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        active = self._loop.active
        if active is None:
            response.message = f"nothing is simulated: {self._loop.failure or self._robot.rejection_reason}"
            return response
        self._loop.reset(active)
        response.success = True
        response.message = "at the initial state"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        loop = self._loop
        if loop.active is None or not loop.is_paused or loop.failure:
            response.message = loop.failure or "a step is made while the simulation is paused: call ~/pause before"
            return response
        response.success = loop.advance(loop.active)
        response.message = loop.failure or f"at {loop.now():.6g} s"
        self._publish_changes()
        return response

    # Diagnostics

    def _report(self, elapsed: float) -> tuple[Level, str, str, Values]:
        self._clock_monitor.check()
        self._other_publishers.check()
        health = simulator_health(self._robot, self._status())
        loop = self._loop
        step = loop.active.simulation.step if loop.active is not None else 0.0
        values = {
            "simulated time [s]": f"{loop.now():.3f}",
            "real time factor": f"{loop.step_count * step / elapsed:.3f}",
            "times let go": loop.skipped_time,
            "messages refused since the last report": self._refused,
            "last refusal": self._last_refusal,
            **loop.step_durations.take("step", elapsed),
        }
        loop.step_count = 0
        loop.skipped_time = 0
        self._refused = 0
        return *health, self._robot.name, values

    def _state_topics(self) -> Sequence[str]:
        """Return the names of the topics with the simulated state that are published at present."""
        active = self._loop.active
        if active is None:
            return ()
        is_moving = active.simulation.base != "fixed" and self._values["odom_rate"]
        return ("joint_states", "odom") if is_moving else ("joint_states",)

    def _status(self) -> SimulatorStatus:
        loop = self._loop
        active = loop.active
        standstill = loop.standstill()
        topics = tuple(map(self.resolve_topic_name, ("~/commands", "~/effort")))
        return SimulatorStatus(
            failure=loop.failure,
            conflicts=(*filter(None, [self._clock_monitor.conflict]), *self._other_publishers.conflicts),
            notes=tuple(self._other_publishers.notes),
            paused_robot=active.simulation.robot.name if active is not None and loop.is_paused else "",
            commands_timed_out=loop.commands_timed_out,
            skipped_time=loop.skipped_time,
            refusal=self._last_refusal if self._refused else "",
            awaited_topics=topics if standstill > LONG_STANDSTILL else (),
            standstill=standstill,
        )


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(MobileBaseSimulator, arguments, make_events_executor)
