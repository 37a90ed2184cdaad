"""Times of messages in the clock of the node, and how long messages were in transit."""

from __future__ import annotations

from time import time_ns
from typing import TYPE_CHECKING

from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.clock import Clock, ROSClock
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from robot_dynamics.control.transit import TransitTimes
from robot_dynamics.nodes.codecs.fields import to_nanoseconds

if TYPE_CHECKING:
    from robot_dynamics.nodes.message_info import MessageInfo


class MessageTimes:
    """Times [s] since the node was made: small numbers, which a float resolves to the nanosecond."""

    def __init__(self, clock: Clock) -> None:
        assert isinstance(clock, ROSClock), "the clock of a node is one"
        self._clock = clock
        self._epoch = clock.now().nanoseconds
        self._transits = {kind: TransitTimes() for kind in (JointState, Odometry, JointTrajectory)}

    @property
    def is_simulated(self) -> bool:
        """Whether the time is that of a simulation, which is not the time of the machine."""
        return self._clock.ros_time_is_active

    @property
    def is_clock_missing(self) -> bool:
        """Whether the time is that of a simulation, and is zero, as it is until it comes on /clock."""
        return self.is_simulated and self._clock.now().nanoseconds == 0

    def now(self) -> float:
        """Return the present time."""
        return (self._clock.now().nanoseconds - self._epoch) * 1e-9

    def of_stamp(self, stamp: Time) -> float:
        """Return the time of a stamp."""
        return self.of_nanoseconds(to_nanoseconds(stamp))

    def of_nanoseconds(self, time: int) -> float:
        """Return the time of a stamp in ns."""
        return (time - self._epoch) * 1e-9

    def transit_time(self, message: JointState | Odometry | JointTrajectory, info: MessageInfo) -> float:
        """Return how long a message was in transit [s], as far as it is known; zero in simulated time."""
        if self.is_simulated:
            return 0.0
        return self._transits[type(message)].delay(time_ns(), info["source_timestamp"])

    def restart(self) -> None:
        """Forget the transit times of earlier messages."""
        for transit in self._transits.values():
            transit.restart()
