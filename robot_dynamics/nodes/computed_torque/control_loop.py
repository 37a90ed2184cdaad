"""The control loop of computed_torque: states and references in, efforts out, while the node is configured."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from time import perf_counter, sleep
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.impl.rcutils_logger import RcutilsLogger
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.control.controller import Controller
from robot_dynamics.control.modes import FEEDFORWARD, GRAVITY
from robot_dynamics.control.sending import send_in_time
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.base_odometry import BaseOdometryReader
from robot_dynamics.nodes.codecs.fields import to_nanoseconds
from robot_dynamics.nodes.codecs.joint_states import JointStateReader
from robot_dynamics.nodes.codecs.references import read_reference, read_reference_point
from robot_dynamics.nodes.codecs.serialized_trajectories import read_serialized_reference
from robot_dynamics.nodes.computed_torque.state_agreement import ReceivedState
from robot_dynamics.nodes.guarded_callbacks import failure_reason

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ByteArray
    from robot_dynamics.control.control_law import ControlLaw
    from robot_dynamics.control.controller_settings import Settings
    from robot_dynamics.control.reference import Trajectory
    from robot_dynamics.nodes.computed_torque.control_statistics import ControlStatistics
    from robot_dynamics.nodes.computed_torque.message_times import MessageTimes
    from robot_dynamics.nodes.computed_torque.outputs import ControlOutputs
    from robot_dynamics.nodes.computed_torque.publisher_monitor import SequenceSteps
    from robot_dynamics.nodes.computed_torque.state_agreement import StateAgreement
    from robot_dynamics.nodes.message_info import MessageInfo

STANDSTILL = 1.0  # [s] of the machine without a state, after which efforts go to zero although the clock stands still
READER_PAUSE = 1e-3  # [s] of a thread that reads a long trajectory, after each millisecond
OTHER_CLOCK_AGE = 10.0  # [s] age of a state that no delay explains


@dataclass(frozen=True, eq=False)
class PreparedLaw:
    """A law for a changed robot, and its settings: it replaces that of the loop."""

    law: ControlLaw
    settings: Settings


@dataclass(frozen=True, eq=False)
class TimedReference:
    """A trajectory that has been read.

    Attributes
    ----------
    received : time [s] by the clock of the node.
    stamp : of its start [ns]; zero for the present.
    trajectory : with times from the start; None for the end of the reference.
    """

    received: float
    stamp: int
    trajectory: Trajectory | None


@dataclass(frozen=True)
class RejectedLaw:
    """Why the loop cannot control a changed robot: efforts go to zero."""

    reason: str


class ControlLoop:
    """Streams efforts for states and references while it is active.

    Parameters
    ----------
    law, settings : of the controller.
    namespace : of the node, which may precede joint names.
    sequence_steps : takes the messages with the controlled joints.
    agreement : of the states of several publishers.
    on_sent : called with the time [s] of a state after its efforts have been sent, and with the present time after
        efforts without a state.
    """

    def __init__(
        self,
        law: ControlLaw,
        settings: Settings,
        namespace: str,
        times: MessageTimes,
        outputs: ControlOutputs,
        statistics: ControlStatistics,
        sequence_steps: SequenceSteps,
        agreement: StateAgreement,
        on_sent: Callable[[float], None],
        logger: RcutilsLogger,
    ) -> None:
        self.controller = Controller(law, settings)
        self.is_active = False
        self.activated_at = -inf  # [s] by the clock of the machine
        self._has_controlled = False  # since the activation
        self.prepared: PreparedLaw | RejectedLaw | None = None  # set by another thread, applied by the next callback
        self.namespace = namespace
        self._times = times
        self._outputs = outputs
        self._statistics = statistics
        self._sequence_steps = sequence_steps
        self._agreement = agreement
        self._on_sent = on_sent
        self._logger = logger
        self._joint_states = self._joint_state_reader(law)
        self._base = self._base_reader(law)
        self._last_state_time = -inf  # [s] by the clock of the node
        self._last_tick: float | None = None  # [s] by the clock of the node
        self._received_at = inf  # [s] by that of the machine

    @property
    def law(self) -> ControlLaw:
        """The present control law."""
        return self.controller.law

    @property
    def unreported_joint_names(self) -> list[str]:
        """Joints that no message has contained, and that the law needs."""
        springs = self.law.spring_names
        return [name for name in self._joint_states.unreported_joint_names if name not in springs]

    @property
    def has_ended_by_fault(self) -> bool:
        """Whether a fault has brought the efforts to zero, after others were sent."""
        controller = self.controller
        return self._has_controlled and bool(controller.fault) and not controller.last_efforts.any()

    def activate(self) -> None:
        """Start with no state, no reference and zero efforts."""
        self.controller.restart()
        self._last_state_time = -inf
        self._last_tick = None
        self._received_at = inf
        self._has_controlled = False
        self.activated_at = perf_counter()
        self._times.restart()
        self._agreement.restart()
        self.is_active = True

    def deactivate(self) -> None:
        """Stop; the last efforts that are sent are zero."""
        if self.is_active:
            self.is_active = False
            self.controller.restart()
            self._outputs.publish_efforts(self.controller.last_efforts)

    def on_joint_states(self, message: JointState, info: MessageInfo) -> None:
        """Send the efforts for a state."""
        if not self.is_active:
            return
        began = self._received_at = perf_counter()
        self._apply_prepared_law()
        controller = self.controller
        now = self._times.now()
        stamp: Time | None = message.header.stamp
        is_unstamped = message.header.stamp.sec == message.header.stamp.nanosec == 0
        time = now if is_unstamped else self._times.of_stamp(message.header.stamp)
        timeout = controller.settings.state_timeout
        state = ReceivedState(message, info.get("publication_sequence_number"), time)
        contradiction = self._agreement.check(self._joint_states.find_mapping(message), state, began, timeout)
        if 0.0 < self._last_state_time - time < timeout:
            self._statistics.out_of_order += 1
            return
        self._last_state_time = time
        until = began + self._lifetime()
        try:
            if not self._joint_states.read(message, controller.settings.mode not in (GRAVITY, FEEDFORWARD)):
                return
            self._sequence_steps.add(info)
            if contradiction:
                raise InvalidInputError(contradiction)
            published = now - self._times.transit_time(message, info)
            if is_unstamped:
                time = published
            if abs(now - time) > timeout:
                raise InvalidInputError(_describe_age(now - time, is_unstamped, self._times.is_clock_missing))
            self._base.require_current(now, timeout)
            efforts = controller.step(now, time, published)
            if controller.fault:  # efforts that go to zero do not answer the state
                stamp = None
            else:
                self._has_controlled = True
            until -= now - min(time, published)
        except Exception as error:
            stamp = None
            efforts = controller.reject_state(now, failure_reason(self._logger, error))
        self._send(efforts, stamp, until)
        self._record(time, perf_counter() - began)
        self._on_sent(time)

    def on_odometry(self, message: Odometry, info: MessageInfo) -> None:
        """Read the motion of the base."""
        if self.is_active:
            self._base.read(message, self._times.now() - self._times.transit_time(message, info))

    def on_tick(self) -> None:
        """Send efforts if states are missing; to be called more often than the state times out."""
        if not self.is_active:
            return
        self._apply_prepared_law()
        began = perf_counter()
        now = self._times.now()
        previous = self._last_tick
        self._last_tick = now
        until = inf
        if now != previous:
            efforts = self.controller.tick(now)
            until = began + self._lifetime()
        elif began - self._received_at > STANDSTILL:
            efforts = self.controller.halt(f"no joint_states for {STANDSTILL:g} s, and the clock stands still")
        else:
            return
        if efforts is not None:
            self._send(efforts, None, until)
            self._on_sent(now)

    def read_trajectory(self, data: ByteArray) -> TimedReference:
        """Read a serialized trajectory in a thread beside that of the efforts. Raises InvalidInputError."""
        received = self._times.now()
        stamp, times, points = read_serialized_reference(data, self.law.joints, self.namespace)
        trajectory = self.controller.prepare_trajectory(times, points, lambda: sleep(READER_PAUSE))
        return TimedReference(received, stamp, trajectory)

    def read_trajectory_message(self, message: JointTrajectory) -> TimedReference:
        """Read the trajectory of a goal in a thread beside that of the efforts. Raises InvalidInputError."""
        received = self._times.now()
        times, points = read_reference(message, self.law.joints, self.namespace)
        trajectory = self.controller.prepare_trajectory(times, points, lambda: sleep(READER_PAUSE))
        if trajectory is None:
            raise InvalidInputError("the trajectory has no points: at least one is needed")
        stamp = to_nanoseconds(message.header.stamp)
        age = received - self._times.of_nanoseconds(stamp) - trajectory.end
        if stamp and age > 0:
            raise InvalidInputError(
                f"the trajectory ended {age:.3f} s ago: header.stamp is when it starts, zero for now"
            )
        return TimedReference(received, stamp, trajectory)

    def now(self) -> float:
        """Return the time [s] by the clock of the node."""
        return self._times.now()

    def follow_trajectory(self, reference: TimedReference) -> None:
        """Follow a trajectory from its start. Raises InvalidInputError."""
        now = self._times.now()
        start = self._times.of_nanoseconds(reference.stamp) if reference.stamp else now
        self.controller.follow(now, start, reference.trajectory, reference.received)

    def track_point(self, message: JointTrajectory, info: MessageInfo) -> None:
        """Track a single point for reference_timeout. Raises InvalidInputError."""
        now = self._times.now()
        point = read_reference_point(message, self.law.joints, self.namespace)
        published = now - self._times.transit_time(message, info)
        self.controller.track_point(now, self._start_time(message, published), point)

    def _joint_state_reader(self, law: ControlLaw) -> JointStateReader:
        return JointStateReader(law.dynamics, law.joints, self.namespace, law.q, law.qd, law.dependent_positions)

    def _base_reader(self, law: ControlLaw) -> BaseOdometryReader:
        return BaseOdometryReader(law.dynamics.robot, self.namespace, law.twist, law.gravity)

    def _apply_prepared_law(self) -> None:
        """Replace the law by the one that has been prepared for a changed robot, if there is one."""
        prepared = self.prepared
        if prepared is None:
            return
        self.prepared = None
        if isinstance(prepared, RejectedLaw):
            self.controller.watchdog.block(prepared.reason)
            self._logger.error(prepared.reason)
            return
        self.controller.watchdog.block("")
        self.controller.replace_law(prepared.law)
        self.controller.apply(prepared.settings)
        self._joint_states = self._joint_state_reader(prepared.law)
        base = self._base_reader(prepared.law)
        base.continue_from(self._base)
        self._base = base
        self._agreement.forget_states()
        self._logger.info(f"continues with {prepared.law.dynamics.robot!r}")

    def _lifetime(self) -> float:
        """How long efforts for a state are valid [s of the machine]; unlimited in simulated time."""
        return inf if self._times.is_simulated else self.controller.settings.state_timeout

    def _send(self, efforts: Array, stamp: Time | None, until: float) -> None:
        """Send efforts that are valid until a time [s] of perf_counter; after it, those that are valid then."""
        send_in_time(self.controller, self._outputs.publish_efforts, self._times.now, efforts, stamp, until)

    def _record(self, state_time: float, latency: float) -> None:
        age = max(self._times.now() - state_time, latency)
        statistics = self._statistics
        statistics.latencies.add(latency)
        statistics.state_ages.add(age)
        controller = self.controller
        controller.watchdog.record_latency(age)
        statistics.deadline_misses += age > controller.settings.deadline
        statistics.saturated += bool(controller.saturated.any())

    def _start_time(self, message: JointTrajectory, default: float) -> float:
        """Return the time of the stamp of a reference [s], `default` for a stamp of zero."""
        stamp = message.header.stamp
        return default if stamp.sec == stamp.nanosec == 0 else self._times.of_stamp(stamp)


def _describe_age(age: float, is_unstamped: bool, is_clock_missing: bool) -> str:
    """Return the reason to reject a state of this age [s], which is a time in transit if the state has no stamp."""
    if is_clock_missing:
        return (
            "use_sim_time is set, and nothing came on /clock yet: joint_states have a stamp of another clock, "
            f"{-age:.3f} s ahead"
        )
    if is_unstamped:
        return f"joint_states were in transit for {age:.3f} s"
    if age > 0:
        hint = "; do both use the same time (use_sim_time)?" if age > OTHER_CLOCK_AGE else ""
        return f"joint_states are {age:.3f} s old by their stamp{hint}"
    return (
        f"joint_states have a stamp {-age:.3f} s ahead of the clock of this node: do both use the same time "
        "(use_sim_time), and are the clocks of both machines synchronized?"
    )
