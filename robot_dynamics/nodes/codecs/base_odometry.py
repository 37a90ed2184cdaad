"""The motion of a moving base out of nav_msgs/Odometry, in the form that the models of a robot use."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nav_msgs.msg import Odometry

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.geometry import read_pose, read_twist
from robot_dynamics.nodes.codecs.joint_order import resolve_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot


class BaseOdometryReader:
    """Copies the twist of the base (6,) and gravity (3,), both in the base frame, into arrays, and tracks their age.

    For a robot with a fixed base no message is needed.
    """

    def __init__(self, robot: Robot, namespace: str, twist: Array, gravity: Array) -> None:
        self._robot = robot
        self._namespace = namespace
        self._twist = twist
        self._gravity = gravity
        self._published: float | None = None  # [s] when the last accepted message was published
        self._rejection_reason = "no odom yet, and the base of the robot moves"

    def read(self, message: Odometry, published: float) -> None:
        """Copy a message that was published at a time [s]; `require_current` raises the reason of a refusal."""
        try:
            self._copy(message)
        except InvalidInputError as error:
            self._rejection_reason = f"odom refused: {error}"
        else:
            self._published = published
            self._rejection_reason = ""

    def continue_from(self, predecessor: BaseOdometryReader) -> None:
        """Take over the age of the motion from another reader of the same arrays."""
        self._published = predecessor._published
        self._rejection_reason = predecessor._rejection_reason

    def require_current(self, now: float, timeout: float) -> None:
        """Raise InvalidInputError if the base moves and its motion is older than `timeout` [s] at a time [s]."""
        if not self._robot.moving_base:
            return
        if self._rejection_reason:
            raise InvalidInputError(self._rejection_reason)
        if self._published is None or not abs(now - self._published) <= timeout:
            raise InvalidInputError(f"no odom for more than {timeout * 1e3:g} ms")

    def _copy(self, message: Odometry) -> None:
        if message.child_frame_id:
            resolve_name("base link", message.child_frame_id, [self._robot.base_link], self._namespace)
        pose = read_pose(message.pose.pose, "pose")
        twist = read_twist(message.twist.twist, "twist")
        self._twist[:] = twist
        self._gravity[:] = pose[:3, :3].T @ self._robot.gravity
