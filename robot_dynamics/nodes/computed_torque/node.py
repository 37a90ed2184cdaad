"""The node computed_torque: joint_states and a reference in, efforts out, at the rate of joint_states."""

from __future__ import annotations

import gc
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TYPE_CHECKING, Any

from nav_msgs.msg import Odometry
from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import JointState

from robot_dynamics.control.control_law import ControlLaw, actuated_joint_names
from robot_dynamics.control.modes import ADAPTIVE
from robot_dynamics.errors import InvalidInputError, RobotDynamicsError, describe_unknown_name
from robot_dynamics.nodes.clocks import ClockMonitor
from robot_dynamics.nodes.computed_torque.adapted_model import AdaptedModel
from robot_dynamics.nodes.computed_torque.collision_input import CollisionInput
from robot_dynamics.nodes.computed_torque.control_loop import ControlLoop, PreparedLaw, RejectedLaw
from robot_dynamics.nodes.computed_torque.control_statistics import ControlStatistics
from robot_dynamics.nodes.computed_torque.fault_log import FaultLog
from robot_dynamics.nodes.computed_torque.health import control_health
from robot_dynamics.nodes.computed_torque.message_times import MessageTimes
from robot_dynamics.nodes.computed_torque.outputs import QOS_OVERRIDES, ControlOutputs
from robot_dynamics.nodes.computed_torque.parameters import (
    PARAMETERS,
    adaptation_limits,
    default_tolerances,
    describe_settings,
    joint_tolerance_parameters,
    limits_warning,
    settings_from_parameters,
)
from robot_dynamics.nodes.computed_torque.publisher_monitor import PublisherMonitor, SequenceSteps
from robot_dynamics.nodes.computed_torque.reference_inputs import ReferenceInputs
from robot_dynamics.nodes.computed_torque.state_agreement import StateAgreement
from robot_dynamics.nodes.computed_torque.trajectory_action import DEACTIVATED, TrajectoryAction
from robot_dynamics.nodes.diagnostics import Diagnostics
from robot_dynamics.nodes.guarded_callbacks import failure_reason
from robot_dynamics.nodes.lifecycle import RobustLifecycleNode
from robot_dynamics.nodes.message_info import MessageInfoCallback
from robot_dynamics.nodes.middleware import without_shared_memory
from robot_dynamics.nodes.parameters import (
    declare_parameters,
    read_parameters,
    try_parameter_change,
    validate_changes,
)
from robot_dynamics.nodes.publisher_names import describe_publishers
from robot_dynamics.nodes.qos import INPUT_STREAM_QOS
from robot_dynamics.nodes.robot_parameters import PARAMETERS as ROBOT_PARAMETERS
from robot_dynamics.nodes.robot_source import RobotSource
from robot_dynamics.nodes.runner import make_events_executor, run_node

try:
    from control_msgs.action import FollowJointTrajectory
except ImportError:  # an optional package
    FollowJointTrajectory = None

if TYPE_CHECKING:
    from robot_dynamics.control.controller_settings import Settings
    from robot_dynamics.control.goal_tolerances import GoalTolerances
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.nodes.diagnostics import Level, Values
    from robot_dynamics.nodes.message_info import MessageInfo
    from robot_dynamics.nodes.parameters import (
        ParameterValues,
    )
    from robot_dynamics.nodes.robot_source import DescriptionKey

MAX_TICK = 0.005  # [s] longest time between two checks of the age of the state
SWITCH_INTERVAL = 2e-4  # [s] after which a thread that loads a robot lets the streaming thread go on


class ComputedTorque(RobustLifecycleNode):
    """Streams efforts that make a robot follow a reference: ~/commands (Float64MultiArray, in the order of parameter
    `joints`) and ~/effort (JointState), one for each message on joint_states.

    Parameter robot_file (a path, or a robot that ships) or robot_description (a text) selects the robot, else the
    topic robot_description: computed_torque --ros-args -p robot_file:=panda

    The reference is a trajectory on ~/reference, or single points on ~/reference_point (both JointTrajectory).
    Where control_msgs is installed, the action ~/follow_joint_trajectory takes trajectories as well, and
    ~/controller_state is published.

    Parameter mode selects the control law: gravity_compensation, feedforward, computed_torque, pd_gravity or
    adaptive_computed_torque. ~/state has reference, feedback, error and output. If the state is stale or invalid,
    efforts go to zero in ramp_time and zeros are sent from then on; /diagnostics has the reason.
    """

    def __init__(self, **arguments: Any) -> None:
        super().__init__("computed_torque", **arguments)
        self._loop: ControlLoop | None = None  # exists while the node is configured
        self._is_built = False
        self._description: DescriptionKey | None = None
        self._start_requested = False
        self._configuration_error = ""
        self._last_fault = ""  # that deactivated the node
        self._statistics = ControlStatistics()
        self._fault_log = FaultLog(self.get_logger())
        declare_parameters(self, PARAMETERS)
        self._specs = dict(PARAMETERS)  # and those of the controlled joints
        self._values = read_parameters(self, PARAMETERS)
        self._worker = ThreadPoolExecutor(1, thread_name_prefix="robot")
        self._robot = RobotSource(self, self._on_new_robot, self._worker, self._require_changeable, controls=True)
        self.add_on_set_parameters_callback(self._before_change)
        self.add_post_set_parameters_callback(self._after_change)
        self._times = MessageTimes(self.get_clock())
        self._outputs = ControlOutputs(self)
        self._clock_monitor = ClockMonitor(self)
        self._sequence_steps = SequenceSteps()
        self._publisher_monitor = PublisherMonitor(
            self, self._outputs.effort_topics, "joint_states", self._sequence_steps
        )
        states_topic = self.resolve_topic_name("joint_states")
        self._agreement = StateAgreement(
            lambda: self.count_publishers(states_topic), lambda: describe_publishers(self, "joint_states")
        )
        self._diagnostics = Diagnostics(self, "control", self._report)
        self._references = ReferenceInputs(self, lambda: self._loop)
        self._adapted_model = AdaptedModel(self, lambda: self._loop, self._worker)
        self._action = self._make_action()
        self._collision = CollisionInput(self, lambda: self._loop, lambda: self._values["collision_reaction"])
        self._subscribe()
        # a timer of the machine's time: that of a simulation may stand still
        self._timer = self.create_timer(
            self._tick_period(), self._on_tick, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._is_built = True
        self._description = self._robot.description
        if self._values["autostart"]:
            self._start()

    def _make_action(self) -> TrajectoryAction | None:
        if FollowJointTrajectory is None:
            self.get_logger().info(
                "control_msgs is not installed: there are neither ~/follow_joint_trajectory nor ~/controller_state "
                "(sudo apt install ros-jazzy-control-msgs)"
            )
            return None
        return TrajectoryAction(
            self,
            FollowJointTrajectory,
            lambda: self._loop,
            self._references,
            self._default_tolerances,
            lambda: self._values["action_monitor_rate"],
        )

    def _default_tolerances(self, joints: tuple[str, ...]) -> GoalTolerances:
        return default_tolerances(self._values, joints)

    def _subscribe(self) -> None:
        qos = INPUT_STREAM_QOS
        on_joint_states = MessageInfoCallback(self._on_joint_states)
        on_odometry = MessageInfoCallback(self._on_odometry)
        self._input_subscriptions = [
            self.create_subscription(
                JointState, "joint_states", on_joint_states, qos, qos_overriding_options=QOS_OVERRIDES
            ),
            self.create_subscription(Odometry, "odom", on_odometry, qos, qos_overriding_options=QOS_OVERRIDES),
        ]

    def _tick_period(self) -> float:
        return min(MAX_TICK, self._values["state_timeout"] / 4)

    @property
    def _is_active(self) -> bool:
        return self._loop is not None and self._loop.is_active

    # Transitions

    def _start(self) -> None:
        """Configure and activate the node if there is a robot, else when there is one."""
        self._start_requested = not self._robot.name
        if self._start_requested:
            return
        if self._loop is None and self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Make the control loop of the robot; fails if robot and parameters do not fit."""
        logger = self.get_logger()
        try:
            dynamics = self._robot.dynamics
            law = self._make_law(dynamics, self._values["joints"] or actuated_joint_names(dynamics))
            settings = self._settings(self._values, dynamics, law.joints)
            self._declare_joint_tolerances(law.joints)
        except RobotDynamicsError as error:
            self._configuration_error = f"not configured: {error}"
            logger.error(self._configuration_error)
            return TransitionCallbackReturn.FAILURE
        self._configuration_error = ""
        self._references.refusal = ""
        self._loop = ControlLoop(
            law,
            settings,
            self.get_namespace(),
            self._times,
            self._outputs,
            self._statistics,
            self._sequence_steps,
            self._agreement,
            self._on_sent,
            logger,
        )
        self._outputs.configure(law.joints)
        logger.info(describe_settings(settings))
        logger.info(f"controls {', '.join(law.joints)}, limits {settings.limits.tolist()}")
        idle = [name for name, limit in zip(law.joints, settings.limits, strict=True) if limit == 0]
        if idle:
            logger.warning(f"the effort of {', '.join(idle)} is limited to 0: set effort_limits")
        excess = limits_warning(dynamics, law.joints, settings.limits)
        if excess:
            logger.warning(excess)
        return super().on_configure(state)

    def _declare_joint_tolerances(self, joints: Sequence[str]) -> None:
        """Declare constraints.<joint>.trajectory and .goal. Raises InvalidInputError."""
        specs = joint_tolerance_parameters(joints)
        new = {name: spec for name, spec in specs.items() if not self.has_parameter(name)}
        declare_parameters(self, new)
        self._specs = {**PARAMETERS, **specs}
        self._values.update(read_parameters(self, specs))
        for name in getattr(self, "_parameter_overrides", {}):  # rclpy has no public access to them
            if name.startswith("constraints.") and not self.has_parameter(name):
                known = [known for known in self._specs if known.startswith("constraints.")]
                self.get_logger().warning(f"{describe_unknown_name('parameter', name, known)} Nothing reads it")

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Start to send efforts, from zero."""
        assert self._loop is not None, "only a configured node is activated"
        gc.freeze()  # the objects that exist by now stay: garbage collection need not search them while efforts are due
        self._loop.activate()
        self._last_fault = ""
        self._collision.update()
        self._fault_log.restart(self._loop.controller.watchdog.rejection_reason)
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Send zero efforts, and stop."""
        self._stop()
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Remove the control loop."""
        self._loop = None
        self._last_fault = ""
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Send zero efforts if the node is active."""
        self._stop()
        return super().on_shutdown(state)

    def _stop(self) -> None:
        if self._action is not None:
            self._action.abort(DEACTIVATED)
        if self._loop is not None:
            self._loop.deactivate()

    def destroy_node(self) -> None:
        """Send zero efforts if the node is active, and destroy it."""
        self._stop()
        if self._action is not None:
            self._action.close()
        self._references.close()
        self._worker.shutdown(wait=False, cancel_futures=True)
        super().destroy_node()

    # Robot and parameters

    def _on_new_robot(self, dynamics: Dynamics) -> None:
        """Prepare the law of another robot, or of another payload, while the present one goes on."""
        if not self._is_built:
            return
        if self._action is not None and self._robot.description != self._description:
            self._action.abort("the robot description changed", hold=True)
        self._description = self._robot.description
        if self._loop is None:
            self._start_requested = self._values["autostart"]  # in the thread of the executor, at the next tick
        else:
            self._worker.submit(self._prepare_law, self._loop, dynamics)

    def _prepare_law(self, loop: ControlLoop, dynamics: Dynamics) -> None:
        joints = loop.law.joints
        try:
            law = self._make_law(dynamics, joints)
            loop.prepared = PreparedLaw(law, self._settings(self._values, dynamics, joints))
        except Exception as error:
            reason = failure_reason(self.get_logger(), error)
            loop.prepared = RejectedLaw(f"the description of {dynamics.robot.name!r} does not fit: {reason}")

    def _make_law(self, dynamics: Dynamics, joints: Sequence[str]) -> ControlLaw:
        is_adaptive = self._values["mode"] == ADAPTIVE
        law = ControlLaw(dynamics, joints, adaptation_limits(self._values) if is_adaptive else None)
        if law.adaptive is not None and law.adaptive.constant_links:
            self.get_logger().warning(
                f"links {', '.join(law.adaptive.constant_links)} are not adapted: their inertia is not that of a body "
                "with mass and an extent in all directions"
            )
        return law

    def _settings(self, values: ParameterValues, dynamics: Dynamics, joints: Sequence[str]) -> Settings:
        return settings_from_parameters(values, dynamics, joints, self._robot.is_massless(dynamics))

    def _before_change(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        def change() -> None:
            for parameter in parameters:
                self._require_changeable(parameter.name)
            changes = validate_changes(self._specs, parameters)
            if self._loop is not None:
                law = self._loop.law
                settings = self._settings({**self._values, **changes}, law.dynamics, law.joints)
                if settings.mode == ADAPTIVE and law.adaptive is None:
                    raise InvalidInputError(
                        f"parameter mode: {ADAPTIVE} is prepared when the node is configured: call cleanup first"
                    )

        return try_parameter_change(change)

    def _require_changeable(self, name: str) -> None:
        """Raise InvalidInputError if a parameter cannot change in the present state of the node."""
        spec = PARAMETERS.get(name)
        if self._loop is not None and spec is not None and spec.read_at == "configuration":
            raise InvalidInputError(f"parameter {name} is read when the node is configured: call cleanup first")
        if self._is_active and name in ROBOT_PARAMETERS and not name.startswith("payload."):
            raise InvalidInputError(f"parameter {name} cannot change while efforts are sent: deactivate the node")

    def _after_change(self, parameters: Sequence[Parameter]) -> None:
        changes = validate_changes(self._specs, parameters)
        if not changes:
            return
        self._values.update(changes)
        if self._loop is not None:
            law = self._loop.law
            self._loop.controller.apply(self._settings(self._values, law.dynamics, law.joints))
            self._collision.update()
        elif self._configuration_error:  # the change may have removed the error
            self._start_requested = self._values["autostart"]
        self._timer.timer_period_ns = int(self._tick_period() * 1e9)

    # Streams

    def _on_joint_states(self, message: JointState, info: MessageInfo) -> None:
        if self._loop is not None:
            self._follow_references()
            self._loop.on_joint_states(message, info)

    def _on_odometry(self, message: Odometry, info: MessageInfo) -> None:
        if self._loop is not None:
            self._loop.on_odometry(message, info)

    def _on_tick(self) -> None:
        if self._start_requested:
            self._start()
        self._follow_references()
        if self._loop is not None:
            self._loop.on_tick()

    def _follow_references(self) -> None:
        self._references.follow_read()
        if self._action is not None:
            self._action.follow_accepted()

    def _on_sent(self, time: float) -> None:
        """Publish ~/state if it is due at a time [s], and log and publish what has changed."""
        if self._loop is None:
            return
        controller = self._loop.controller
        if self._action is not None:
            self._action.step(time)
        self._outputs.publish_state(controller, time, self._values["state_rate"])
        self._fault_log.update(controller.fault)
        self._diagnostics.publish_if_changed(
            controller.fault, controller.activity, controller.no_reference_reason, self._refusal
        )
        if self._values["deactivate_on_fault"] and self._loop.has_ended_by_fault:
            self._last_fault = controller.fault
            self.get_logger().error(f"deactivated by a fault: {self._last_fault}")
            self.trigger_deactivate()

    # Diagnostics

    @property
    def _refusal(self) -> str:
        return self._configuration_error or self._references.refusal

    def _report(self, elapsed: float) -> tuple[Level, str, str, Values]:
        self._clock_monitor.check()
        self._publisher_monitor.check()
        conflicts = [*filter(None, [self._clock_monitor.conflict]), *self._publisher_monitor.conflicts]
        misses = self._statistics.deadline_misses
        values = {
            **self._statistics.take(elapsed),
            "standstills": self._loop.controller.watchdog.stall_count if self._loop is not None else 0,
            "references refused": self._references.refused_count,
            "last refusal": self._references.last_refusal,
            **self._adapted_model.diagnostics(),
        }
        health = control_health(
            self._robot,
            self._loop,
            self._configuration_error,
            self._last_fault,
            self._references.refusal,
            conflicts,
            misses,
        )
        return *health, self._robot.name, values


def main(arguments: list[str] | None = None) -> None:
    """Run the node."""
    sys.setswitchinterval(SWITCH_INTERVAL)
    run_node(ComputedTorque, arguments, executor=make_events_executor, transports=without_shared_memory)
