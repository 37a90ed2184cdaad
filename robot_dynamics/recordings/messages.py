"""The fields of ROS messages that recordings use, of `rosbags` as of rclpy."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike

NANOSECONDS_PER_SECOND = 1_000_000_000


class TimeMessage(Protocol):
    """builtin_interfaces/msg/Time."""

    @property
    def sec(self) -> int: ...
    @property
    def nanosec(self) -> int: ...


class HeaderMessage(Protocol):
    """std_msgs/msg/Header."""

    @property
    def stamp(self) -> TimeMessage: ...


class JointStateMessage(Protocol):
    """sensor_msgs/msg/JointState."""

    @property
    def header(self) -> HeaderMessage: ...
    @property
    def name(self) -> Sequence[str]: ...
    @property
    def position(self) -> ArrayLike: ...
    @property
    def velocity(self) -> ArrayLike: ...
    @property
    def effort(self) -> ArrayLike: ...


class VectorMessage(Protocol):
    """geometry_msgs/msg/Point or Vector3."""

    @property
    def x(self) -> float: ...
    @property
    def y(self) -> float: ...
    @property
    def z(self) -> float: ...


class QuaternionMessage(VectorMessage, Protocol):
    """geometry_msgs/msg/Quaternion."""

    @property
    def w(self) -> float: ...


class PoseMessage(Protocol):
    """geometry_msgs/msg/Pose."""

    @property
    def position(self) -> VectorMessage: ...
    @property
    def orientation(self) -> QuaternionMessage: ...


class PoseWithCovarianceMessage(Protocol):
    """geometry_msgs/msg/PoseWithCovariance."""

    @property
    def pose(self) -> PoseMessage: ...


class TwistMessage(Protocol):
    """geometry_msgs/msg/Twist."""

    @property
    def linear(self) -> VectorMessage: ...
    @property
    def angular(self) -> VectorMessage: ...


class TwistWithCovarianceMessage(Protocol):
    """geometry_msgs/msg/TwistWithCovariance."""

    @property
    def twist(self) -> TwistMessage: ...


class OdometryMessage(Protocol):
    """nav_msgs/msg/Odometry."""

    @property
    def header(self) -> HeaderMessage: ...
    @property
    def child_frame_id(self) -> str: ...
    @property
    def pose(self) -> PoseWithCovarianceMessage: ...
    @property
    def twist(self) -> TwistWithCovarianceMessage: ...


def stamp_nanoseconds(header: HeaderMessage) -> int:
    """Stamp [ns] of the header of a message."""
    return header.stamp.sec * NANOSECONDS_PER_SECOND + header.stamp.nanosec
