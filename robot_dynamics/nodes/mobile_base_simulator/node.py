"""The node mobile_base_simulator: efforts, wheel commands and wrenches in; joint_states, odom, /tf and /clock out."""

import time
import traceback

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import AccelStamped, Twist, TwistStamped, WrenchStamped
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray
from std_srvs.srv import SetBool, Trigger
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.errors import InvalidInputError, RobotDynamicsError
from robot_dynamics.nodes.clocks import CLOCK_TOPIC, ClockMonitor
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN, Diagnostics, DurationStatistics
from robot_dynamics.nodes.mobile_base_simulator import outputs as outputs
from robot_dynamics.nodes.mobile_base_simulator.inputs import SimulatorInputs
from robot_dynamics.nodes.mobile_base_simulator.parameters import (
    PARAMETERS,
    RUNTIME_PARAMETERS,
    STARTUP_PARAMETERS,
    build_simulation,
    joint_limit_warnings,
    validate_parameter,
)
from robot_dynamics.nodes.parameters import declare_parameters, try_parameter_change
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS, LATEST_ONLY_QOS
from robot_dynamics.nodes.robot_source import PARAMETERS as ROBOT_PARAMETERS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node

try:
    from tf2_msgs.msg import TFMessage
except ImportError:  # odom tells the same
    TFMessage = None

TICK = 0.001  # [s] between looks at what is due
MOST_AT_ONCE = 0.02  # [s] of the machine that one look may take: then messages are heard again
AGAIN = 0.05  # [s] of the machine after which the state is told again where time stands still
FARTHEST_BEHIND = 0.1  # [s] of simulated time that are caught up, what is more is let go


class MobileBaseSimulator(Node):
    """Stands in for a robot: ~/commands (Float64MultiArray, in the order of parameter `joints`) or ~/effort
    (JointState) move it, joint_states tell where it is.

    The robot is named by parameter robot_file (a path, or a robot that ships) or robot_description (a text), else taken
    from the topic robot_description: mobile_base_simulator --ros-args -p robot_file:=panda

    Its base is fixed, flies freely, glides in a plane, or rolls on wheels; then cmd_vel (Twist) drives it. Wrenches on
    links come on ~/external_wrench (WrenchStamped, frame_id the link). With moved_by:=reference joints move as
    ~/reference (JointTrajectory) tells, and the base by reaction. Where the base moves, odom, /tf and
    ~/base_acceleration tell how. Services ~/pause (SetBool), ~/reset and ~/step (Trigger). Commands that stop are zero
    after command_timeout.
    """

    def __init__(self, **arguments):
        super().__init__("mobile_base_simulator", **arguments)
        self._served = self._simulated = self._inputs = self._candidate = None
        self._anew = False  # whether what is a candidate begins where it says
        self._paused, self._failure, self._refused, self._last_refusal = True, "", 0, ""
        self._steps, self._behind, self._took, self._stopped = 0, 0, DurationStatistics(), False
        self._last_told, self._last_answer, self._told_times = -np.inf, -np.inf, 0  # [s] of the machine; how often
        self._offset, self._told_at = 0, -np.inf  # [ns] of simulated time before the last reset; [s]
        declare_parameters(self, PARAMETERS)
        self._values = {name: validate_parameter(name, self.get_parameter(name).value) for name in PARAMETERS}
        self._paused = self._values["start_paused"]
        self._robot = RobotSource(self)
        self._publish_and_subscribe()
        self._serve_robot()
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)

    def _publish_and_subscribe(self):
        self._joint_states = self.create_publisher(JointState, "joint_states", 10)
        self._odom = self.create_publisher(Odometry, "odom", LATEST_ONLY_QOS)
        self._acceleration = self.create_publisher(AccelStamped, "~/base_acceleration", LATEST_ONLY_QOS)
        self._clock_out, self._clocks = None, ClockMonitor(self)
        self._publish_clock_or_not()
        self._tf = None if TFMessage is None else self.create_publisher(TFMessage, "/tf", 100)
        twist = TwistStamped if self._values["stamped_cmd_vel"] else Twist
        self._heard = [
            self.create_subscription(kind, topic, self._taking(topic, take), quality)
            for kind, topic, take, quality in (
                (Float64MultiArray, "~/commands", SimulatorInputs.on_commands, INPUT_STREAM_QOS),
                (JointState, "~/effort", SimulatorInputs.on_efforts, INPUT_STREAM_QOS),
                (twist, "cmd_vel", SimulatorInputs.on_cmd_vel, INPUT_STREAM_QOS),
                (WrenchStamped, "~/external_wrench", SimulatorInputs.wrench, 10),
                (JointTrajectory, "~/reference", SimulatorInputs.reference, 1),
            )
        ]
        self._services_held = [
            self.create_service(SetBool, "~/pause", self._on_pause),
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(Trigger, "~/step", self._on_step),
        ]
        self._diagnostics = Diagnostics(self, "simulation", self._report)
        self._timer = self.create_timer(TICK, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._pace_anew()

    def _publish_clock_or_not(self):
        """Make the publisher of /clock, or take it away: one that says nothing would pass for a second clock."""
        if self._values["publish_clock"] and self._clock_out is None:
            self._clock_out = self.create_publisher(ClockMessage, CLOCK_TOPIC, LATEST_ONLY_QOS)
        elif not self._values["publish_clock"] and self._clock_out is not None:
            self.destroy_publisher(self._clock_out)
            self._clock_out = None

    # Robot and parameters

    def _serve_robot(self):
        """Take over the robot of the source, if it has another one than is simulated."""
        if not self._robot.name or self._robot.dynamics is self._served:
            return
        self._served = self._robot.dynamics
        try:
            self._simulate(self._candidate or build_simulation(self._values, self._served.robot), self._anew)
        except RobotDynamicsError as error:
            self._simulated, self._failure = None, str(error)
            self.get_logger().error(f"not simulated: {error}")

    def _simulate(self, found, anew=False):
        """Simulate something else, from the state that there is, if it can have that, and should not begin anew."""
        before, heard, simulation = self._simulated, self._inputs, found.simulation
        goes_on = not (before is None or anew or self._failure) and simulation.is_compatible_with(before.simulation)
        self._offset, self._simulated, self._failure = self._now_ns(), found, ""
        self._candidate, self._anew = None, False
        self._inputs = SimulatorInputs(found, self.get_namespace(), self._values["command_timeout"])
        if goes_on:
            simulation.continue_from(before.simulation)
            self._inputs.continue_from(heard)
        self._begin()
        for warning in joint_limit_warnings(simulation):
            self.get_logger().warning(warning)
        self.get_logger().info(f"simulates {simulation.robot!r}, {simulation.base} base, commands are of "
                               f"{', '.join(found.joint_names)}")  # fmt: skip

    def _begin(self):
        self._random, self._told_at, self._failure = np.random.default_rng(self._values["seed"]), -np.inf, ""
        self._pace_anew()
        self._tell()

    def _before_change(self, parameters):
        def change():
            for parameter in parameters:
                if parameter.name in STARTUP_PARAMETERS:
                    raise InvalidInputError(f"parameter {parameter.name} is read when the node begins")
            changes = {p.name: validate_parameter(p.name, p.value) for p in parameters if p.name in PARAMETERS}
            self._candidate, self._anew = None, any(name.startswith("initial.") for name in changes)
            if self._served is not None and set(changes) - set(RUNTIME_PARAMETERS):
                self._candidate = build_simulation({**self._values, **changes}, self._served.robot)

        return try_parameter_change(change)

    def _after_change(self, parameters):
        changes = {p.name: validate_parameter(p.name, p.value) for p in parameters if p.name in PARAMETERS}
        self._values.update(changes)
        self._publish_clock_or_not()
        if any(p.name in ROBOT_PARAMETERS for p in parameters):
            self._candidate = None  # made for the robot before
        elif self._candidate is not None:
            self._simulate(self._candidate, self._anew)
        if self._inputs is not None:
            self._inputs.timeout = self._values["command_timeout"]
        self._pace_anew()

    # Time

    def _now_ns(self):
        """Simulated time [ns], which goes on at a reset and with another robot."""
        return self._offset + (0 if self._simulated is None else round(self._simulated.simulation.state.time * 1e9))

    def _now(self):
        return self._now_ns() * 1e-9

    def _stamp(self):
        ns = self._now_ns() if self._values["publish_clock"] else self.get_clock().now().nanoseconds
        return Time(sec=ns // 10**9, nanosec=ns % 10**9)

    def _pace_anew(self):
        """From now on simulated time runs beside that of the machine."""
        self._machine, self._simulated_from = time.monotonic(), self._now_ns()

    def _on_tick(self):
        self._serve_robot()
        if self._simulated is None:
            return
        if self._paused or self._failure or self._waits():
            self._pace_anew()
            quiet = self._inputs.has_new_efforts and self._values["wait_for_commands"] == "each" and not self._paused
            if not quiet and time.monotonic() - self._last_told > AGAIN:
                self._tell_again()
            return
        factor, step = self._values["real_time_factor"], self._simulated.simulation.step
        until = time.monotonic() + MOST_AT_ONCE
        while time.monotonic() < until:
            if factor:
                due = (time.monotonic() - self._machine) * factor - (self._now_ns() - self._simulated_from) * 1e-9
                if due < step:
                    return
                if due > max(FARTHEST_BEHIND * factor, 2 * step):
                    self._behind += 1
                    self._pace_anew()
            if not self._advance() or self._waits():
                return

    def _waits(self):
        """Whether time stands still until efforts come. A state that was told twice may be answered twice, and where
        answers do not say to what, a late one would be taken for that to the next: it goes on when all has been quiet.
        """
        wait, inputs = self._values["wait_for_commands"], self._inputs
        if wait == "each" and inputs.has_new_efforts and not inputs.has_state_stamp and self._told_times > 1:
            return time.monotonic() - self._last_answer < AGAIN
        return (wait == "first" and not inputs.has_commands) or (wait == "each" and not inputs.has_new_efforts)

    def _advance(self):
        """One step, told to all. Returns whether it could be made."""
        simulation, began = self._simulated.simulation, time.perf_counter()
        self._told_times = 0
        self._inputs.expect_efforts()
        try:
            simulation.advance(**self._acting())
        except RobotDynamicsError as error:
            self._fail(str(error))
            return False
        except Exception as error:  # a fault of ours must not take the node down
            self.get_logger().error(traceback.format_exc())
            self._fail(f"internal error, please report it: {error!r}")
            return False
        self._steps += 1
        self._tell()
        self._took.add(time.perf_counter() - began)
        silent = self._inputs.has_timed_out(self._now())
        if silent is not self._stopped:
            self._stopped = silent
            self._diagnostics.publish_if_changed(silent)
        return True

    def _acting(self):
        if self._values["moved_by"] == "reference":
            return {"motion": self._inputs.reference_motion(self._offset * 1e-9)}
        return self._inputs.step_inputs(self._now())

    def _fail(self, reason):
        self._failure = f"stopped at {self._now():.6g} s, ~/reset begins anew: {reason}"
        self.get_logger().error(self._failure)
        self._diagnostics.publish_if_changed(self._failure)

    # Messages

    def _tell(self):
        stamp, simulation = self._stamp(), self._simulated.simulation
        noise = self._values["noise.position"], self._values["noise.velocity"], self._random
        if self._values["wait_for_commands"] == "each":
            self._inputs.expect_efforts(to_nanoseconds(stamp))
        self._state_message = outputs.joint_state_message(simulation, self._inputs.efforts, noise, stamp)
        self._tell_again()
        rate, state = self._values["odom_rate"], simulation.state
        if simulation.base == "fixed" or not rate or state.time - self._told_at < 1 / rate - simulation.step / 2:
            return
        self._told_at = state.time
        frames = self._values["odom_frame"], self._values["base_frame"] or simulation.robot.base_link
        self._odom.publish(outputs.odometry_message(state, stamp, *frames))
        if self._tf is not None:
            self._tf.publish(TFMessage(transforms=[outputs.transform(state, stamp, *frames)]))
        if self._acceleration.get_subscription_count():
            base, _ = simulation.accelerations(**self._acting())
            self._acceleration.publish(outputs.acceleration_message(base, stamp, frames[1]))

    def _tell_again(self):
        """The time, and the state as it was measured."""
        self._last_told, stamp = time.monotonic(), self._stamp()
        self._told_times += 1
        if self._clock_out is not None:
            self._clock_out.publish(ClockMessage(clock=stamp))
        self._state_message.header.stamp = stamp
        self._joint_states.publish(self._state_message)

    def _taking(self, topic, take):
        def taken(message):
            if self._simulated is None:
                return
            try:
                take(self._inputs, self._now(), message.twist if isinstance(message, TwistStamped) else message)
                self._last_answer = time.monotonic()
                if self._values["wait_for_commands"] == "each" and self._inputs.has_new_efforts:
                    self._on_tick()
            except RobotDynamicsError as error:
                self._refused += 1
                self._last_refusal = f"{topic}: {error}"
                self.get_logger().warning(f"refused: {self._last_refusal}", throttle_duration_sec=1.0)
                self._diagnostics.publish_if_changed(self._last_refusal)

        return taken

    # Services

    def _on_pause(self, request, response):
        self._paused = request.data
        self._pace_anew()
        response.success, response.message = True, f"{'paused' if self._paused else 'runs'} at {self._now():.6g} s"
        return response

    def _on_reset(self, _, response):
        if self._simulated is None:
            response.message = f"nothing is simulated: {self._failure or self._robot.rejection_reason}"
            return response
        self._offset = self._now_ns()
        self._simulated.simulation.reset()
        self._inputs.clear()
        self._begin()
        response.success, response.message = True, "as it began"
        return response

    def _on_step(self, _, response):
        if self._simulated is None or not self._paused or self._failure:
            response.message = self._failure or "a step is made while the simulation is paused: call ~/pause before"
            return response
        response.success = self._advance()
        response.message = self._failure or f"at {self._now():.6g} s"
        return response

    def _report(self, elapsed):
        self._clocks.check()
        level, message = self._robot.health()
        if self._failure:
            level, message = ERROR, self._failure
        elif level == OK and self._clocks.conflict:
            level, message = WARN, self._clocks.conflict
        elif level == OK and self._paused:
            message = f"paused, {self._simulated.simulation.robot.name!r}"
        elif level == OK and self._stopped:
            level, message = WARN, "commands stopped: efforts are zero"
        elif level == OK and self._behind:
            level, message = WARN, "the machine is too slow for real_time_factor: time was let go"
        elif level == OK and self._refused:
            level, message = WARN, f"refused: {self._last_refusal}"
        elif level == OK and self._values["wait_for_commands"] != "never" and not self._inputs.has_commands:
            level, message = (
                WARN,
                "time stands still until the first efforts come on "
                f"{' or '.join(map(self.resolve_topic_name, ('~/commands', '~/effort')))}",
            )
        step = self._simulated.simulation.step if self._simulated else 0.0
        values = {
            "simulated time [s]": f"{self._now():.3f}",
            "real time factor": f"{self._steps * step / elapsed:.3f}",
            "times let go": self._behind,
            "messages refused": self._refused,
            "last refusal": self._last_refusal,
            **self._took.tell("step", elapsed),
        }
        self._steps = self._behind = self._refused = 0
        return level, message, self._robot.name, values


def main(arguments=None):
    run_node(MobileBaseSimulator, arguments, make_events_executor)
