"""The motion of a moving base out of nav_msgs/Odometry, as the models of a robot take it."""

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.nodes.codecs.geometry import read_pose, read_twist
from robot_dynamics.nodes.codecs.joint_order import resolve_name


class BaseOdometryReader:
    """Writes twist (6,) of the base and gravity (3,), both in its frame, into arrays; knows how old they are.

    robot: whose base moves; where it does not, nothing is needed and nothing is stale.
    """

    def __init__(self, robot, namespace, twist, gravity):
        self._robot, self._namespace = robot, namespace
        self._twist, self._gravity = twist, gravity
        self._heard, self._refusal = None, "no odom yet, and the base of the robot moves"

    def read(self, message, published):
        """Take over a message that was published at a time [s]."""
        try:
            self._take(message)
            self._heard, self._refusal = published, ""
        except InvalidInputError as error:
            self._refusal = f"odom refused: {error}"

    def continue_from(self, before):
        """What another reader knew of the base holds for this one."""
        self._heard, self._refusal = before._heard, before._refusal

    def require_current(self, now, timeout):
        """Raise QuestionError where the motion of the base is not known at a time [s], but for timeout [s]."""
        if not self._robot.moving_base:
            return
        if self._refusal:
            raise InvalidInputError(self._refusal)
        if not abs(now - self._heard) <= timeout:
            raise InvalidInputError(f"no odom for more than {timeout * 1e3:g} ms")

    def _take(self, message):
        if message.child_frame_id:
            resolve_name("base link", message.child_frame_id, [self._robot.base_link], self._namespace)
        pose, twist = read_pose(message.pose.pose, "pose"), read_twist(message.twist.twist, "twist")
        self._twist[:] = twist
        self._gravity[:] = pose[:3, :3].T @ self._robot.gravity
