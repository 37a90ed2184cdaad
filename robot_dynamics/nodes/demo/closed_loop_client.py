"""A simulator and computed_torque in one namespace, as seen by another process: motions in, states out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from time import monotonic
from typing import TYPE_CHECKING

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import Odometry
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_srvs.srv import SetBool
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.errors import RobotDynamicsError
from robot_dynamics.nodes.codecs.fields import to_nanoseconds, to_time_message
from robot_dynamics.nodes.codecs.geometry import read_twist
from robot_dynamics.nodes.demo.motion import trajectory_points

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.nodes.client import ServiceClient
    from robot_dynamics.nodes.demo.motion import Motion

LEAD_TIME = 0.3  # [s] of simulated time from the reference to the start of its motion
REST_TIME = 0.3  # [s] of simulated time after a motion
GOAL_TOLERANCE = 0.05  # [rad] at the end of a motion
RETRY_INTERVAL = 0.05  # [s] after which a reference is published again
PATIENCE = 120.0  # [s] of the machine for one motion


class ClosedLoopClient:
    """Executes motions, and keeps the states.

    Parameters
    ----------
    client : whose node subscribes and publishes.
    names : of the joints, in the order of all arrays.

    Attributes
    ----------
    now_ns : simulated time [ns].
    states : {time [ns]: (positions, velocities) (n,)}.
    base : {time [ns]: (position (3,), Rotation, twist (6,))}.
    """

    def __init__(self, client: ServiceClient, namespace: str, names: Sequence[str]) -> None:
        self._client = client
        self._namespace = namespace
        self._names = list(names)
        self.now_ns = 0
        self.states: dict[int, tuple[Array, Array]] = {}
        self.base: dict[int, tuple[Array, Rotation, Array]] = {}
        self._diagnostics: list[str] = []
        node = client.node
        self._subscriptions = [
            node.create_subscription(Clock, f"{namespace}/clock", self._on_clock, 2000),
            node.create_subscription(JointState, f"{namespace}/joint_states", self._on_state, 2000),
            node.create_subscription(Odometry, f"{namespace}/odom", self._on_odometry, 2000),
            node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100),
        ]
        self._reference = node.create_publisher(JointTrajectory, f"{namespace}/computed_torque/reference", 1)

    def close(self) -> None:
        """Destroy the subscriptions and the publisher."""
        for subscription in self._subscriptions:
            self._client.node.destroy_subscription(subscription)
        self._client.node.destroy_publisher(self._reference)

    def execute_motion(self, motion: Motion) -> float:
        """Execute a motion, and return the time [s] of its start. Raises TimeoutError and RobotDynamicsError."""
        self._wait_until(self.now_ns * 1e-9 + 1e-3)
        with self._paused():
            start_ns = self.now_ns + round(LEAD_TIME * 1e9)
            self._publish_reference(self._reference_message(motion, start_ns))
        start = start_ns * 1e-9
        self._wait_until(start + motion.duration + REST_TIME)
        positions, _ = self.states[max(self.states)]
        if not np.abs(positions - motion.goal).max() < GOAL_TOLERANCE:
            raise RobotDynamicsError(f"the robot did not reach its goal; diagnostics: {self._diagnostics}")
        return start

    def tracking_errors(self, motion: Motion, start: float) -> tuple[Array, Array]:
        """Return times (N,) [s] since the start [s] of a motion, and errors (N, n) [rad], until the robot rests."""
        samples = {1e-9 * ns - start: q for ns, (q, _) in sorted(self.states.items())}
        end = motion.duration + REST_TIME
        times = np.array([time for time in samples if 0 <= time <= end])
        positions = np.array([q for time, q in samples.items() if 0 <= time <= end])
        reference, _, _ = motion.sample(times)
        return times, reference - positions

    def _reference_message(self, motion: Motion, start_ns: int) -> JointTrajectory:
        positions = np.stack([motion.start, motion.goal])
        rest = np.zeros_like(positions)
        message = JointTrajectory(joint_names=self._names)
        message.header.stamp = to_time_message(start_ns)
        message.points = trajectory_points(
            [0.0, motion.duration], positions=positions, velocities=rest, accelerations=rest
        )
        return message

    def _publish_reference(self, message: JointTrajectory) -> None:
        """Publish a reference until computed_torque follows it: the first may come before it is discovered."""
        deadline = monotonic() + PATIENCE
        self._reference.publish(message)
        while not self._follows_reference():
            if monotonic() > deadline:
                raise TimeoutError(f"computed_torque accepts no reference; diagnostics: {self._diagnostics}")
            self._client.spin(RETRY_INTERVAL)
            self._reference.publish(message)

    def _follows_reference(self) -> bool:
        messages = [text for text in self._diagnostics if "computed_torque: " in text]
        return bool(messages) and "no reference" not in messages[-1]

    @contextmanager
    def _paused(self) -> Iterator[None]:
        """Pause the simulation in the block, after all messages until then have been received: they may be seconds
        late if the simulation is faster than this process reads."""
        service = f"{self._namespace}/mobile_base_simulator/pause"
        self._client.call(SetBool, service, SetBool.Request(data=True))
        previous = None
        while previous != self.now_ns:  # a paused simulator publishes its time again and again
            previous = self.now_ns
            self._client.spin(4 * RETRY_INTERVAL)
        yield
        self._client.call(SetBool, service, SetBool.Request(data=False))

    def _wait_until(self, time: float) -> None:
        """Wait until a simulated time [s]. Raises TimeoutError."""
        for _ in range(round(PATIENCE / 0.05)):
            if self.now_ns * 1e-9 >= time and self._reference.get_subscription_count():
                return
            self._client.spin(0.05)
        raise TimeoutError(f"simulated time reached only {self.now_ns * 1e-9:.3f} s within {PATIENCE:g} s")

    def _on_clock(self, message: Clock) -> None:
        self.now_ns = to_nanoseconds(message.clock)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        own = [status for status in message.status if status.name.startswith(self._namespace)]
        self._diagnostics += [f"{status.name}: {status.message}" for status in own]

    def _on_state(self, message: JointState) -> None:
        order = [list(message.name).index(name) for name in self._names]
        state = np.array(message.position)[order], np.array(message.velocity)[order]
        self.states[to_nanoseconds(message.header.stamp)] = state

    def _on_odometry(self, message: Odometry) -> None:
        position = message.pose.pose.position
        q = message.pose.pose.orientation
        self.base[to_nanoseconds(message.header.stamp)] = (
            np.array([position.x, position.y, position.z]),
            Rotation.from_quat([q.x, q.y, q.z, q.w]),
            read_twist(message.twist.twist, "odom"),
        )
