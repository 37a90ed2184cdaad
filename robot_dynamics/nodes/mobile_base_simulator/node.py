"""The node mobile_base_simulator: efforts, wheel commands and wrenches in; joint_states, odom, /tf and /clock out."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
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

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.clocks import ClockMonitor
from robot_dynamics.nodes.codecs.fields import to_nanoseconds, to_time_message
from robot_dynamics.nodes.diagnostics import Diagnostics, DurationStatistics, Level, Values
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.mobile_base_simulator.health import SimulatorStatus, simulator_health
from robot_dynamics.nodes.mobile_base_simulator.inputs import SimulatorInputs, StepInputs
from robot_dynamics.nodes.mobile_base_simulator.pacing import MAX_LAG, Pacer
from robot_dynamics.nodes.mobile_base_simulator.parameters import PARAMETERS
from robot_dynamics.nodes.mobile_base_simulator.publishers import SimulatorPublishers
from robot_dynamics.nodes.mobile_base_simulator.simulation_setup import (
    SimulationSetup,
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
from robot_dynamics.nodes.robot_source import PARAMETERS as ROBOT_PARAMETERS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node
from robot_dynamics.simulation import Simulation

TICK = 0.001  # [s] between two checks whether steps are due
MAX_TICK_DURATION = 0.02  # [s] of the machine for the steps of one check: then messages are received again
REPEAT_INTERVAL = 0.05  # [s] of the machine after which the state is published again while time stands still


@dataclass(frozen=True, eq=False)
class ActiveSimulation:
    """The simulation of the present robot, and its inputs."""

    setup: SimulationSetup
    inputs: SimulatorInputs

    @property
    def simulation(self) -> Simulation:
        """The simulation."""
        return self.setup.simulation


@dataclass(frozen=True, eq=False)
class Candidate:
    """A simulation for changed parameters, and whether it starts from its initial state, or continues."""

    setup: SimulationSetup
    restarts: bool


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
        self._active: ActiveSimulation | None = None
        self._candidate: Candidate | None = None
        self._failure = ""  # why nothing is simulated, or why the simulation stopped
        self._offset_ns = 0  # simulated time before the last reset or change of the robot
        self._pacer = Pacer()
        self._efforts_received_at = -np.inf  # [s] of the machine
        self._commands_timed_out = False
        self._step_count = 0
        self._skipped_time = 0
        self._refused = 0
        self._last_refusal = ""
        self._step_durations = DurationStatistics()
        declare_parameters(self, PARAMETERS)
        self._values = read_parameters(self, PARAMETERS)
        self._paused = self._values["start_paused"]
        self._robot = RobotSource(self)
        self._clock_monitor = ClockMonitor(self)
        self._outputs = SimulatorPublishers(self, self._values, self._stamp)
        self._subscribe()
        self._diagnostics = Diagnostics(self, "simulation", self._report)
        self._timer = self.create_timer(TICK, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._restart_pacer()
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
            if self._active is None:
                return
            try:
                body = message.twist if isinstance(message, TwistStamped) else message
                read(self._active.inputs, self._now(), body)
                self._efforts_received_at = time.monotonic()
                if self._values["wait_for_commands"] == "each" and self._active.inputs.has_new_efforts:
                    self._on_tick()
            except Exception as error:
                self._refused += 1
                self._last_refusal = f"{topic}: {failure_reason(self.get_logger(), error)}"
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
            candidate = self._candidate or Candidate(build_simulation(self._values, self._dynamics.robot), False)
            self._simulate(candidate)
        except RobotDynamicsError as error:
            self._active = None
            self._failure = str(error)
            self.get_logger().error(f"not simulated: {error}")

    def _simulate(self, candidate: Candidate) -> None:
        """Simulate a candidate, from the present state if it can have that and does not restart."""
        setup = candidate.setup
        simulation = setup.simulation
        previous = self._active
        continues = (
            previous is not None
            and not candidate.restarts
            and not self._failure
            and simulation.is_compatible_with(previous.simulation)
        )
        self._offset_ns = self._now_ns()
        self._candidate = None
        inputs = SimulatorInputs(setup, self.get_namespace(), self._values["command_timeout"])
        self._active = ActiveSimulation(setup, inputs)
        if previous is not None and continues:
            simulation.continue_from(previous.simulation)
            inputs.continue_from(previous.inputs)
        self._begin(self._active)
        logger = self.get_logger()
        for warning in joint_limit_warnings(simulation):
            logger.warning(warning)
        names = ", ".join(setup.joint_names)
        logger.info(f"simulates {simulation.robot!r}, {simulation.base} base, commands are for {names}")

    def _begin(self, active: ActiveSimulation) -> None:
        self._failure = ""
        self._outputs.restart()
        self._restart_pacer()
        self._publish(active)

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
        self._outputs.update_clock_publisher()
        if any(parameter.name in ROBOT_PARAMETERS for parameter in parameters):
            self._candidate = None  # it is of the previous robot
        elif self._candidate is not None:
            self._simulate(self._candidate)
        if self._active is not None:
            self._active.inputs.timeout = self._values["command_timeout"]
        self._restart_pacer()

    # Time

    def _now_ns(self) -> int:
        """Return the simulated time [ns], which goes on after a reset and with another robot."""
        if self._active is None:
            return self._offset_ns
        return self._offset_ns + round(self._active.simulation.state.time * 1e9)

    def _now(self) -> float:
        return self._now_ns() * 1e-9

    def _stamp(self) -> Time:
        return to_time_message(self._now_ns() if self._values["publish_clock"] else self.get_clock().now().nanoseconds)

    def _restart_pacer(self) -> None:
        self._pacer.restart(self._now_ns())

    def _on_tick(self) -> None:
        """Make the steps that are due, or publish the state again while time stands still."""
        self._update_robot()
        active = self._active
        if active is None:
            return
        if self._paused or self._failure or self._is_waiting(active.inputs):
            self._restart_pacer()
            has_input = active.inputs.has_new_efforts and self._values["wait_for_commands"] == "each"
            if (not has_input or self._paused) and time.monotonic() - self._outputs.published_at > REPEAT_INTERVAL:
                self._outputs.publish_joint_states_again()
            return
        factor = self._values["real_time_factor"]
        step = active.simulation.step
        deadline = time.monotonic() + MAX_TICK_DURATION
        while time.monotonic() < deadline:
            if factor:
                lag = self._pacer.lag(self._now_ns(), factor)
                if lag < step:
                    return
                if lag > max(MAX_LAG * factor, 2 * step):
                    self._skipped_time += 1
                    self._restart_pacer()
            if not self._advance(active) or self._is_waiting(active.inputs):
                return

    def _is_waiting(self, inputs: SimulatorInputs) -> bool:
        """Return whether time stands still until efforts come.

        There may be two responses to a state that was published twice. If efforts have no stamp of the state, a late
        one would be taken for that of the next state: time goes on after a pause without efforts.
        """
        wait = self._values["wait_for_commands"]
        if wait == "first":
            return not inputs.has_commands
        if wait != "each":
            return False
        if inputs.has_new_efforts and not inputs.has_state_stamp and self._outputs.publication_count > 1:
            return time.monotonic() - self._efforts_received_at < REPEAT_INTERVAL
        return not inputs.has_new_efforts

    def _advance(self, active: ActiveSimulation) -> bool:
        """Make one step, publish the state, and return whether the step was possible."""
        began = time.perf_counter()
        self._outputs.publication_count = 0
        active.inputs.expect_efforts()
        try:
            active.simulation.advance(**self._step_inputs(active))
        except Exception as error:
            reason = failure_reason(self.get_logger(), error)
            self._failure = f"stopped at {self._now():.6g} s, call ~/reset to restart: {reason}"
            self.get_logger().error(self._failure)
            self._diagnostics.publish_if_changed(self._failure)
            return False
        self._step_count += 1
        self._publish(active)
        self._step_durations.add(time.perf_counter() - began)
        timed_out = active.inputs.has_timed_out(self._now())
        if timed_out is not self._commands_timed_out:
            self._commands_timed_out = timed_out
            self._diagnostics.publish_if_changed(timed_out)
        return True

    def _step_inputs(self, active: ActiveSimulation) -> StepInputs:
        if self._values["moved_by"] == "reference":
            return {"motion": active.inputs.reference_motion(self._offset_ns * 1e-9)}
        return active.inputs.step_inputs(self._now())

    def _publish(self, active: ActiveSimulation) -> None:
        stamp = self._stamp()
        if self._values["wait_for_commands"] == "each":
            active.inputs.expect_efforts(to_nanoseconds(stamp))
        self._outputs.publish_state(active.simulation, active.inputs, stamp, lambda: self._step_inputs(active))

    # Services

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._paused = request.data
        self._restart_pacer()
        response.success = True
        response.message = f"{'paused' if self._paused else 'runs'} at {self._now():.6g} s"
        return response

    def _on_reset(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._active is None:
            response.message = f"nothing is simulated: {self._failure or self._robot.rejection_reason}"
            return response
        self._offset_ns = self._now_ns()
        self._active.simulation.reset()
        self._active.inputs.clear()
        self._begin(self._active)
        response.success = True
        response.message = "at the initial state"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if self._active is None or not self._paused or self._failure:
            response.message = self._failure or "a step is made while the simulation is paused: call ~/pause before"
            return response
        response.success = self._advance(self._active)
        response.message = self._failure or f"at {self._now():.6g} s"
        return response

    # Diagnostics

    def _report(self, elapsed: float) -> tuple[Level, str, str, Values]:
        self._clock_monitor.check()
        health = simulator_health(self._robot, self._status())
        step = self._active.simulation.step if self._active is not None else 0.0
        values = {
            "simulated time [s]": f"{self._now():.3f}",
            "real time factor": f"{self._step_count * step / elapsed:.3f}",
            "times let go": self._skipped_time,
            "messages refused": self._refused,
            "last refusal": self._last_refusal,
            **self._step_durations.take("step", elapsed),
        }
        self._step_count = 0
        self._skipped_time = 0
        self._refused = 0
        return *health, self._robot.name, values

    def _status(self) -> SimulatorStatus:
        active = self._active
        awaits = self._values["wait_for_commands"] != "never" and active is not None and not active.inputs.has_commands
        topics = tuple(map(self.resolve_topic_name, ("~/commands", "~/effort")))
        return SimulatorStatus(
            failure=self._failure,
            clock_conflict=self._clock_monitor.conflict,
            paused_robot=active.simulation.robot.name if active is not None and self._paused else "",
            commands_timed_out=self._commands_timed_out,
            skipped_time=self._skipped_time,
            refusal=self._last_refusal if self._refused else "",
            awaited_topics=topics if awaits else (),
        )


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    run_node(MobileBaseSimulator, arguments, make_events_executor)
