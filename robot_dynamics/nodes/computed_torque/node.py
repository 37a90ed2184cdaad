"""The node computed_torque: joint_states and a reference in, efforts out, at the rate of joint_states."""

import gc
import sys
import traceback
from concurrent.futures import ThreadPoolExecutor
from math import inf
from time import perf_counter, time_ns

import numpy as np
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.control.control_law import FEEDFORWARD, GRAVITY, ControlLaw, actuated_joint_names
from robot_dynamics.control.controller import Controller
from robot_dynamics.control.sending import send_in_time
from robot_dynamics.control.transit import TransitTimes
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError
from robot_dynamics.nodes.clocks import ClockMonitor
from robot_dynamics.nodes.codecs.base_odometry import BaseOdometryReader
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.joint_states import JointStateReader
from robot_dynamics.nodes.codecs.references import read_reference, read_reference_point
from robot_dynamics.nodes.computed_torque.fault_log import FaultLog
from robot_dynamics.nodes.computed_torque.outputs import QOS_OVERRIDES, ControlOutputs
from robot_dynamics.nodes.computed_torque.parameters import (
    CONFIGURATION_PARAMETERS,
    PARAMETERS,
    settings_from_parameters,
    validate_parameter,
)
from robot_dynamics.nodes.diagnostics import ERROR, OK, WARN, Diagnostics, DurationStatistics
from robot_dynamics.nodes.message_info import MessageInfoCallback
from robot_dynamics.nodes.parameters import declare_parameters, try_parameter_change
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS
from robot_dynamics.nodes.robot_source import PARAMETERS as ROBOT_PARAMETERS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node

RCLError = rclpy_implementation.RCLError
STANDSTILL = 1.0  # [s] of the machine without a state, after which a clock that does not go on is no reason to wait
TICK = 0.005  # [s] between looks at the age of the state, at most
ANOTHER_CLOCK = 10.0  # [s] of age that no delay explains
NOT_CONFIGURED = "not configured"
SWITCH = 2e-4  # [s] after which a thread that loads a robot lets the one that streams go on


class ComputedTorque(LifecycleNode):
    """Streams efforts that make a robot follow a reference: ~/commands (Float64MultiArray, in the order of parameter
    `joints`) and ~/effort (JointState), one for each message on joint_states.

    The robot is named by parameter robot_file (a path, or a robot that ships) or robot_description (a text), else taken
    from the topic robot_description: computed_torque --ros-args -p robot_file:=panda

    The reference is a trajectory on ~/reference, or single points on ~/reference_point (both JointTrajectory).
    Parameter mode says what is made of it: gravity_compensation, feedforward, computed_torque or pd_gravity. ~/state
    has reference, feedback, error and output. Where the state is stale or wrong, efforts go to zero in ramp_time and
    zeros are sent on; /diagnostics says why.
    """

    def __init__(self, **arguments):
        super().__init__("computed_torque", **arguments)
        self._controller = self._reader = self._pending = None
        self._active, self._built, self._start_wanted = False, False, False
        self._last_time, self._out_of_order, self._refused = -np.inf, 0, 0
        self._refusal = self._last_refusal = ""
        self._lately, self._ages, self._saturated = DurationStatistics(), DurationStatistics(), 0
        self._late = 0
        self._transits = {kind: TransitTimes() for kind in (JointState, Odometry, JointTrajectory)}
        self._ticked, self._heard_at = None, np.inf  # [s] by the clock of the node, and by that of the machine
        self._fault_log = FaultLog(self.get_logger())
        declare_parameters(self, PARAMETERS)
        self._values = {name: validate_parameter(name, self.get_parameter(name).value) for name in PARAMETERS}
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="robot")
        self._robot = RobotSource(self, on_new_robot=self._adopt, worker=self._worker)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._epoch = self.get_clock().now().nanoseconds
        self._publish_and_subscribe()
        self._built = True
        if self._values["autostart"]:
            self._start()

    def _publish_and_subscribe(self):
        self._outputs, self._clocks = ControlOutputs(self), ClockMonitor(self)
        self._diagnostics = Diagnostics(self, "control", self._report)
        self._subscriptions_held = [
            self.create_subscription(
                JointState,
                "joint_states",
                MessageInfoCallback(self._on_joint_states),
                INPUT_STREAM_QOS,
                **QOS_OVERRIDES,
            ),
            self.create_subscription(
                Odometry, "odom", MessageInfoCallback(self._on_odom), INPUT_STREAM_QOS, **QOS_OVERRIDES
            ),
            self.create_subscription(JointTrajectory, "~/reference", self._on_reference, 1),
            self.create_subscription(
                JointTrajectory, "~/reference_point", MessageInfoCallback(self._on_reference_point), INPUT_STREAM_QOS
            ),
        ]
        # a timer of the machine's time: that of a simulation may stand still for ever
        self._timer = self.create_timer(
            self._tick_period(), self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def _tick_period(self):
        return min(TICK, self._values["state_timeout"] / 4)

    def _now(self):
        """Time [s] since the node was made, by its clock: small numbers, that a float tells to the nanosecond."""
        return (self.get_clock().now().nanoseconds - self._epoch) * 1e-9

    # Transitions

    def _start(self):
        """Configure and activate, if there is a robot; else when there is one."""
        if not self._robot.name:
            self._start_wanted = True
            return
        self._start_wanted = False
        if self._controller is None and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def _LifecycleNodeMixin__on_change_state(self, request, response):
        """As rclpy has it, but that a transition which is not possible now is refused, and does not end the node."""
        try:
            return super()._LifecycleNodeMixin__on_change_state(request, response)
        except RCLError as error:
            self.get_logger().error(f"transition refused: {error}")
            response.success = False
            return response

    def on_configure(self, state):
        try:
            dynamics = self._robot.dynamics
            law = ControlLaw(dynamics, self._values["joints"] or actuated_joint_names(dynamics))
            settings = self._settings(dynamics, law.joints)
        except RobotDynamicsError as error:
            self._refusal = f"{NOT_CONFIGURED}: {error}"
            self.get_logger().error(self._refusal)
            return TransitionCallbackReturn.FAILURE
        self._controller, self._pending, self._refusal = Controller(law, settings), None, ""
        self._listen(law)
        self._outputs.configure(law.joints)
        self.get_logger().info(f"controls {', '.join(law.joints)}, limits {settings.limits.tolist()}")
        idle = [name for name, limit in zip(law.joints, settings.limits, strict=True) if limit == 0]
        if idle:
            self.get_logger().warning(f"the effort of {', '.join(idle)} is limited to 0: set effort_limits")
        return super().on_configure(state)

    def _listen(self, law):
        namespace = self.get_namespace()
        self._reader = JointStateReader(law.dynamics, law.joints, namespace, law.q, law.qd, law.dependent_positions)
        self._base = BaseOdometryReader(law.dynamics.robot, namespace, law.twist, law.gravity)

    def on_activate(self, state):
        gc.freeze()  # what there is by now stays, and is not searched for garbage while efforts are due
        self._controller.restart()
        self._last_time, self._ticked, self._heard_at, self._active = -np.inf, None, np.inf, True
        self._fault_log.restart(self._controller.watchdog.reason)
        for transit in self._transits.values():
            transit.restart()
        return super().on_activate(state)

    def on_deactivate(self, state):
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state):
        self._controller = self._reader = None
        return super().on_cleanup(state)

    def on_shutdown(self, state):
        self._stop()
        return super().on_shutdown(state)

    def _stop(self):
        """The last efforts that are sent are zero."""
        if self._active:
            self._active = False
            self._controller.restart()
            self._outputs.publish_efforts(self._controller.last_efforts)

    def destroy_node(self):
        self._stop()
        self._worker.shutdown(wait=False, cancel_futures=True)
        return super().destroy_node()

    # Robot and parameters

    def _adopt(self, dynamics):
        """Another robot, or the same with another payload: its law is made while the old one goes on."""
        if not self._built:
            return
        if self._controller is None:
            self._start_wanted = self._values["autostart"]  # in the thread of the executor, at the next tick
        else:
            self._worker.submit(self._prepare, dynamics, self._controller.law.joints)

    def _prepare(self, dynamics, joints):
        try:
            law = ControlLaw(dynamics, joints)
            self._pending = law, self._settings(dynamics, joints), ""
        except RobotDynamicsError as error:
            self._pending = None, None, f"the description of {dynamics.robot.name!r} does not fit: {error}"
        except Exception as error:  # a fault of ours must not end the thread in silence
            self._pending = None, None, f"internal error, please report it: {error!r}"

    def _settings(self, dynamics, joints, changes=None):
        """The Settings of the parameters as they are, or would be after changes. Raises QuestionError."""
        return settings_from_parameters(
            {**self._values, **(changes or {})}, dynamics, joints, self._robot.is_massless(dynamics)
        )

    def _exchange(self):
        (law, settings, reason), self._pending = self._pending, None
        self._controller.watchdog.block(reason)
        if reason:
            self.get_logger().error(reason)
            return
        self._controller.replace_law(law)
        self._controller.apply(settings)
        known = self._base
        self._listen(law)
        self._base.continue_from(known)
        self.get_logger().info(f"goes on with {law.dynamics.robot!r}")

    def _before_change(self, parameters):
        def change():
            for parameter in parameters:
                name = parameter.name
                if self._controller is not None and name in CONFIGURATION_PARAMETERS:
                    raise InvalidInputError(f"parameter {name} is read when the node is configured: clean it up before")
                if self._active and name in ROBOT_PARAMETERS and not name.startswith("payload."):
                    raise InvalidInputError(
                        f"parameter {name} cannot change while efforts are sent: deactivate the node"
                    )
            changes = {p.name: validate_parameter(p.name, p.value) for p in parameters if p.name in PARAMETERS}
            if self._controller is not None:
                law = self._controller.law
                self._settings(law.dynamics, law.joints, changes)

        return try_parameter_change(change)

    def _after_change(self, parameters):
        changes = {p.name: validate_parameter(p.name, p.value) for p in parameters if p.name in PARAMETERS}
        if not changes:
            return
        self._values.update(changes)
        if self._controller is not None:
            law = self._controller.law
            self._controller.apply(self._settings(law.dynamics, law.joints))
        elif self._refusal.startswith(NOT_CONFIGURED):  # what was wrong may be right now
            self._start_wanted = self._values["autostart"]
        self._timer.timer_period_ns = int(self._tick_period() * 1e9)

    # What streams

    def _on_joint_states(self, message, info):
        if not self._active:
            return
        began = self._heard_at = perf_counter()
        if self._pending is not None:
            self._exchange()
        controller, now = self._controller, self._now()
        stamp = message.header.stamp
        of_now = stamp.sec == stamp.nanosec == 0
        time = now if of_now else (to_nanoseconds(stamp) - self._epoch) * 1e-9
        timeout = controller.settings.state_timeout
        if 0.0 < self._last_time - time < timeout:
            self._out_of_order += 1
            return
        self._last_time, until = time, began + self._lifetime()
        try:
            if not self._reader.read(message, controller.settings.mode not in (GRAVITY, FEEDFORWARD)):
                return
            published = now - self._delay(message, info)
            if of_now:
                time = published
            if abs(now - time) > timeout:
                raise InvalidInputError(_of_another_time(now - time, of_now))
            self._base.require_current(now, timeout)
            efforts = controller.step(now, time, published)
            until -= now - min(time, published)
        except InvalidInputError as error:
            stamp, efforts = None, controller.reject_state(now, str(error))
        except Exception as error:  # a fault of ours must not take the node down while a robot hangs on it
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=1.0)
            stamp, efforts = None, controller.reject_state(now, f"internal error, please report it: {error!r}")
        self._send(efforts, stamp, until)
        self._answered(time, perf_counter() - began)

    def _delay(self, message, info):
        """How long a message was under way [s], as far as is known."""
        if self.get_clock().ros_time_is_active:
            return 0.0
        return self._transits[type(message)].delay(time_ns(), info["source_timestamp"])

    def _lifetime(self):
        """How long efforts are good for the state that they answer [s of the machine, which are not those of a
        simulation]."""
        return inf if self.get_clock().ros_time_is_active else self._controller.settings.state_timeout

    def _send(self, efforts, stamp=None, until=inf):
        """Send efforts that are good until a time [s] of perf_counter; where it has passed when they leave, those that
        are right then."""
        send_in_time(self._controller, self._outputs.publish_efforts, self._now, efforts, stamp, until)

    def _on_odom(self, message, info):
        if self._active:
            self._base.read(message, self._now() - self._delay(message, info))

    def _answered(self, time, took):
        age = max(self._now() - time, took)
        self._lately.add(took)
        self._ages.add(age)
        controller = self._controller
        controller.watchdog.record_latency(age)
        self._late += age > controller.settings.deadline
        self._saturated += bool(controller.saturated.any())
        self._tell(time)

    def _on_tick(self):
        if self._start_wanted:
            self._start()
        if not self._active:
            return
        if self._pending is not None:
            self._exchange()
        began, now, before = perf_counter(), self._now(), self._ticked
        self._ticked, until = now, inf
        if now != before:
            efforts = self._controller.tick(now)
            until = began + self._lifetime()
        elif began - self._heard_at > STANDSTILL:
            efforts = self._controller.halt(f"no joint_states for {STANDSTILL:g} s, and the clock stands still")
        else:
            return
        if efforts is not None:
            self._send(efforts, until=until)
            self._tell(now)

    def _tell(self, time):
        """Publish ~/state where it is time to, and /diagnostics where something else is to be told."""
        controller = self._controller
        self._outputs.tell(controller, time, self._values["state_rate"])
        self._fault_log.update(controller.fault)
        self._diagnostics.publish_if_changed(
            controller.fault, controller.activity, controller.no_reference_reason, self._refusal
        )

    def _on_reference(self, message):
        def follow(controller):
            times, points = read_reference(message, controller.law.joints, self.get_namespace())
            now = self._now()  # thousands of points take long to read
            controller.follow_trajectory(now, self._start_of(message, now), times, points)

        self._take(follow, "reference")

    def _on_reference_point(self, message, info):
        def track(controller):
            now = self._now()
            told = read_reference_point(message, controller.law.joints, self.get_namespace())
            controller.track_point(now, self._start_of(message, now - self._delay(message, info)), told)

        self._take(track, "reference_point")

    def _start_of(self, message, otherwise):
        """The time of a stamp [s], `otherwise` for a stamp of zero."""
        stamp = to_nanoseconds(message.header.stamp)
        return otherwise if stamp == 0 else (stamp - self._epoch) * 1e-9

    def _take(self, take, topic):
        try:
            if not self._active:
                raise InvalidInputError("the node is not active")
            take(self._controller)
            self._refusal = ""
        except Exception as error:
            reason = str(error)
            if not isinstance(error, RobotDynamicsError):  # a fault of ours must not take the node down
                self.get_logger().error(traceback.format_exc())
                reason = f"internal error, please report it: {error!r}"
            self._refused, self._refusal = self._refused + 1, f"{topic} refused: {reason}"
            self._last_refusal = self._refusal
            self.get_logger().warning(self._refusal, throttle_duration_sec=1.0)

    # What it says of itself

    def _report(self, elapsed):
        self._clocks.check()
        values = {**self._lately.tell("efforts", elapsed), **self._ages.tell("age of state")}
        values.update(
            {
                "deadline misses": self._late,
                "saturated": self._saturated,
                "states out of order": self._out_of_order,
                "standstills": self._controller.watchdog.stall_count if self._controller else 0,
                "references refused": self._refused,
                "last refusal": self._last_refusal,
            }
        )
        self._late = self._saturated = 0
        return *self._health(values), self._robot.name, values

    def _health(self, values):
        """(level, message)."""
        level, message = self._robot.health()
        controller = self._controller
        if level == ERROR or controller is None or not self._active:
            return max(level, WARN), message if level == ERROR else self._refusal or "not active: no efforts are sent"
        if controller.fault:
            clocks = f"; {self._clocks.conflict}" if self._clocks.conflict else ""
            return ERROR, f"efforts go to zero: {controller.fault}{clocks}"
        if not controller.activity:
            return WARN, "use_sim_time is set, and nothing came on /clock yet"
        unreported_joint_names = [
            name for name in self._reader.unreported_joint_names if name not in controller.law.spring_names
        ]
        joints = np.array(controller.law.joints)
        objections = [
            f"last change refused: {self._robot.rejection_reason}" if self._robot.rejection_reason else "",
            f"at its limit: {', '.join(joints[controller.saturated])}" if controller.saturated.any() else "",
            "" if controller.settings.mode == GRAVITY else controller.no_reference_reason,
            self._refusal,
            self._clocks.conflict,
            self._robot.reliability_warning,
            f"nobody tells of {', '.join(unreported_joint_names)}, taken to be at zero"
            if unreported_joint_names
            else "",
            f"{values['deadline misses']} answers were late" if values["deadline misses"] else "",
        ]
        objections = [text for text in objections if text]
        return (WARN if objections else OK), "; ".join([controller.activity, *objections])


def _of_another_time(age, under_way):
    if under_way:
        return f"joint_states were under way for {age:.3f} s"
    if age > 0:
        other = "; do both use the same time (use_sim_time)?" if age > ANOTHER_CLOCK else ""
        return f"joint_states are {age:.3f} s old by their stamp{other}"
    return (
        f"joint_states have a stamp {-age:.3f} s ahead of the clock of this node: do both use the same time "
        "(use_sim_time), and is it kept alike on both machines?"
    )


def main(arguments=None):
    sys.setswitchinterval(SWITCH)
    run_node(ComputedTorque, arguments, executor=make_events_executor, udp_only=True)
