"""The node replay_check: do the efforts that a running robot, or a bag that is played, tells of fit its model?"""

import time
import traceback
from array import array

import numpy as np
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from robot_dynamics.checking.live_check import DEFAULT_SPAN, LiveCheck
from robot_dynamics.checking.tolerances import load_tolerances
from robot_dynamics.cli.replay_check import format_check
from robot_dynamics.errors import InvalidInputError, RecordingError, RobotDynamicsError
from robot_dynamics.nodes.diagnostics import ERROR, OK, STALE, WARN, Diagnostics
from robot_dynamics.nodes.parameters import convert_parameter, declare_parameters, parse_names, try_parameter_change
from robot_dynamics.nodes.processes import make_events_executor, run_node
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.recordings.drives import load_drives
from robot_dynamics.recordings.joint_samples import sample_of_joint_state
from robot_dynamics.recordings.odometry import OdometryReader

# name: (default, what it is)
PARAMETERS = {
    "topics": ("", "names of the topics that tell of the joints; empty: joint_states"),
    "drives": ("", "path of a YAML file: motors and their ratios, gains, offsets; see config/drives"),
    "tolerances": ("", "path of a YAML file; empty: config/tolerances/default.yaml"),
    "cutoff": (0.0, "of the low-pass filter [Hz]; 0: 8, or a fifth of the rate"),
    "rate": (0.0, "of the grid that signals are put on [1/s]; 0: as they come"),
    "span": (DEFAULT_SPAN, "of time that a verdict is about [s]"),
    "stale_after": (1.0, "time without messages on a joint after which it is stale [s]"),
}
STARTUP_PARAMETERS = ("topics",)
LOWER_BOUNDS = {
    "cutoff": 0.1,
    "rate": 0.1,
    "span": 1.0,
    "stale_after": 0.1,
}  # a lower cut-off would keep minutes of samples
DEEP = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)  # nothing is late here, but much is computed
OUT = QoSProfile(depth=1000)  # pieces of a third of a second go out at once
TICK = 0.1  # [s] between looks at what can be told


class ReplayCheck(Node):
    """Compares the efforts on joint_states with those that the model of the robot predicts, as
    `robot-dynamics replay-check` does for bags, while they come; with odom where the base of the robot moves.

    The robot is named by parameter robot_file (a path, or a robot that ships) or robot_description (a text), else taken
    from the topic robot_description: replay_check --ros-args -p robot_file:=panda

    ~/predicted_effort and ~/residual (JointState) have the stamps of the samples, and come about a second later, as the
    filter must see what comes after a sample. Every second /diagnostics tells of each joint whether it is out of
    tolerance, by how much and since when. Services ~/report (Trigger: passed or not, with the table) and ~/reset.
    """

    def __init__(self, **arguments):
        super().__init__("replay_check", **arguments)
        self._check, self._dynamics, self._ended = None, None, True
        self._heard = self._refused = 0
        self._trouble = self._last_refusal = ""
        declare_parameters(self, PARAMETERS)
        self._values = {name: validate_parameter(name, self.get_parameter(name).value) for name in PARAMETERS}
        self._candidate = self._of_base = None
        self._robot = RobotSource(self, on_new_robot=self._adopt)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._predicted = self.create_publisher(JointState, "~/predicted_effort", OUT)
        self._residual = self.create_publisher(JointState, "~/residual", OUT)
        self._held = [
            self.create_subscription(JointState, topic, self._taking(self.resolve_topic_name(topic)), DEEP)
            for topic in self._values["topics"] or ["joint_states"]
        ]
        self._held += [
            self.create_service(Trigger, "~/report", self._on_report),
            self.create_service(Trigger, "~/reset", self._on_reset),
        ]
        self._diagnostics = Diagnostics(self, "check", self._report, self._parts)
        self._timer = self.create_timer(TICK, self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME))

    # Robot and parameters

    def _begun(self, dynamics, values):
        """A LiveCheck of a robot. Raises RobotDynamicsError."""
        drives = load_drives(values["drives"] or None, dynamics.joint_names)
        tolerances = load_tolerances(values["tolerances"] or None, dynamics.joint_names)
        return LiveCheck(dynamics, drives, tolerances, cutoff=values["cutoff"] or None, rate=values["rate"] or None,
                         span=values["span"])  # fmt: skip

    def _adopt(self, dynamics):
        """Begin anew, with this robot."""
        self._dynamics, self._ended = dynamics, True
        self._odometry = OdometryReader(dynamics.robot.base_link)
        if dynamics.robot.moving_base and self._of_base is None:
            self._of_base = self.create_subscription(Odometry, "odom", self._taking("odom"), DEEP)
        try:
            self._check, self._trouble = self._begun(dynamics, self._values), ""
        except RobotDynamicsError as error:
            self._check, self._trouble = None, str(error)
            self.get_logger().error(f"nothing is checked: {error}")

    def _before_change(self, parameters):
        told = {each.name: each.value for each in parameters if each.name in PARAMETERS}

        def change():
            for name in set(told) & set(STARTUP_PARAMETERS):
                raise InvalidInputError(f"parameter {name} is read when the node begins: start it anew")
            values = {**self._values, **{name: validate_parameter(name, value) for name, value in told.items()}}
            if told and self._dynamics is not None:
                self._begun(self._dynamics, values)
            self._candidate = values

        return try_parameter_change(change)

    def _after_change(self, parameters):
        if any(each.name in PARAMETERS for each in parameters):
            self._values = self._candidate
            if self._dynamics is not None:
                self._adopt(self._dynamics)

    # What comes, and what goes out

    def _taking(self, topic):
        def take(message):
            if self._check is None:
                return
            self._heard += 1
            read = self._odometry.sample if isinstance(message, Odometry) else sample_of_joint_state
            self._trying(lambda: self._check.feed(read(topic, time.time_ns(), message)))

        return take

    def _on_tick(self):
        if self._check is None:
            return
        stale = self._stale_names()
        if not stale:
            self._ended = False
            self._trying(self._check.advance)
        elif not self._ended:
            self._ended = True
            self._trying(self._check.finish)
        else:
            self._trying(self._check.advance)
        self._diagnostics.publish_if_changed(*self._health())

    def _stale_names(self):
        return self._check.find_stale_names(time.time_ns(), self._values["stale_after"])

    def _trying(self, work):
        """Publish the Pieces that come of some work; what it refuses is told, and counted."""
        try:
            for piece in work():
                self._publish(piece)
            return
        except RecordingError as error:
            reason = str(error)
        except Exception as error:  # a fault of ours must not take the node down
            self.get_logger().error(traceback.format_exc(), throttle_duration_sec=1.0)
            reason = f"internal error, please report it: {error!r}"
        self._refused, self._last_refusal = self._refused + 1, reason
        self.get_logger().warning(f"left out: {reason}", throttle_duration_sec=1.0)

    def _publish(self, piece):
        names = list(self._check.dynamics.joint_names)
        for publisher, columns in (
            (self._predicted, (piece.motion.q, piece.motion.qd, piece.predicted)),
            (self._residual, (np.zeros((len(piece.stamps), 0)),) * 2 + (piece.residuals,)),
        ):
            if not publisher.get_subscription_count():
                continue
            message = JointState(name=names)
            for stamp, *rows in zip(piece.stamps.tolist(), *columns, strict=True):
                message.header.stamp = Time(sec=stamp // 10**9, nanosec=stamp % 10**9)
                message.position, message.velocity, message.effort = (array("d", row.tobytes()) for row in rows)
                publisher.publish(message)

    # Services

    def _on_report(self, _request, response):
        try:
            found = self._found()
            response.success, response.message = found.passed, format_check(found)
        except RobotDynamicsError as error:
            response.success, response.message = False, str(error)
        except Exception as error:
            self.get_logger().error(traceback.format_exc())
            response.success, response.message = False, f"internal error, please report it: {error!r}"
        return response

    def _found(self):
        if self._check is None:
            raise RecordingError(self._trouble or self._robot.rejection_reason)
        return self._check.result()

    def _on_reset(self, _request, response):
        if self._dynamics is None:
            response.success, response.message = False, self._robot.rejection_reason
            return response
        self._heard = self._refused = 0
        self._last_refusal = ""
        self._adopt(self._dynamics)
        response.success, response.message = not self._trouble, self._trouble
        return response

    # What it says of itself

    def _report(self, _elapsed):
        values = {"messages heard": self._heard, "left out": self._refused, "last reason": self._last_refusal}
        if self._check is not None:
            values |= self._figures()
        return *self._health(), self._robot.name, values

    def _figures(self):
        check, told = self._check, {}
        if check.rate is not None:
            told["rate [1/s]"] = f"{check.rate:.5g}"
        if check.latest_motion is not None:
            told["cut-off [Hz]"] = f"{check.latest_motion.cutoff:.3g}"
            told["compared [s]"] = f"{check.latest_motion.end:.5g}"
        if check.error_message:
            told["last stretch"] = check.error_message
        return {**told, **{f"note {number}": note for number, note in enumerate(check.statistics.sentences, 1)}}

    def _health(self):
        """(level, message)."""
        level, message = self._robot.health()
        if level == ERROR or self._check is None:
            return ERROR, message if level == ERROR else f"nothing is checked: {self._trouble}"
        failed = [each.verdict.joint.joint for each in self._check.joint_statuses if each.failed_since is not None]
        stale = self._stale_names()
        objections = [
            f"last change refused: {self._robot.rejection_reason}" if self._robot.rejection_reason else "",
            f"out of tolerance: {', '.join(failed)}" if failed else "",
            f"nobody tells of {', '.join(stale)} for {self._values['stale_after']:g} s" if stale else "",
            "nothing was compared yet" if not self._check.joint_statuses else "",
            *(f"{each.verdict.joint.joint}: {each.warning}" for each in self._check.joint_statuses if each.warning),
        ]
        objections = [text for text in objections if text]
        level = ERROR if failed else WARN if objections else OK
        return level, "; ".join(objections) or "efforts fit the model"

    def _parts(self):
        """Of each joint: (name, level, message, values)."""
        if self._check is None:
            return
        stale = self._stale_names()
        for standing in self._check.joint_statuses:
            level, message = _said(standing)
            verdict = standing.verdict
            if stale:
                level, message = STALE, f"no new data; before: {message}"
            values = {
                "RMS": f"{verdict.joint.rms:.4g}", "tolerated": f"{verdict.tolerance:.4g}",
                "bias": f"{verdict.joint.bias:.4g}", "largest": f"{verdict.joint.largest:.4g}",
                "samples": verdict.joint.samples,
            }  # fmt: skip
            if standing.failed_since is not None:
                values["since [s]"] = _seconds(standing.failed_since)
            yield verdict.joint.joint, level, message, values


def _said(standing):
    """(level, message) of a Standing."""
    if standing.failed_since is not None:
        return ERROR, f"{'; '.join(standing.verdict.failures)}; since {_seconds(standing.failed_since)} s"
    if standing.warning:
        return WARN, standing.warning
    fits = f"RMS {standing.verdict.joint.rms:.3g} where {standing.verdict.tolerance:.3g} is tolerated"
    if standing.last_failure is not None:
        first, last = map(_seconds, standing.last_failure)
        return WARN, f"{fits}; was out of tolerance from {first} to {last} s"
    return OK, fits


def _seconds(stamp):
    return f"{stamp / 1e9:.2f}"


def validate_parameter(name, value):
    """The value of a parameter in its type. Raises QuestionError."""
    default, description = PARAMETERS[name]
    if name == "topics":
        return tuple(dict.fromkeys(parse_names(name, value)))
    value = convert_parameter(default, name, value, description)
    if name in LOWER_BOUNDS and not (LOWER_BOUNDS[name] <= value < 1e6 or (value == 0 and default == 0)):
        raise InvalidInputError(
            f"parameter {name} is {value:g}: {LOWER_BOUNDS[name]:g} or more is needed, {description}"
        )
    return value


def main(arguments=None):
    run_node(ReplayCheck, arguments, executor=make_events_executor)
