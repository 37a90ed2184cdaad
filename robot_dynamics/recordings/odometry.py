"""Motion of a moving base: pose, twist and acceleration from odometry, filtered as the joints are."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.errors import RecordingError
from robot_dynamics.inputs import Base
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.messages import stamp_nanoseconds
from robot_dynamics.recordings.signals import differentiate, lowpass

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.messages import OdometryMessage, QuaternionMessage, VectorMessage

POSE_SIGNALS = ("x", "y", "z", "qx", "qy", "qz", "qw")
TWIST_SIGNALS = ("velocity x", "velocity y", "velocity z", "rotation x", "rotation y", "rotation z")
BASE_SIGNALS = tuple(f"{name} of the base" for name in (*POSE_SIGNALS, *TWIST_SIGNALS))
EMPTY = np.zeros(0)


class OdometryReader:
    """Converts nav_msgs Odometry to joint samples: `BASE_SIGNALS` are the names, their values the positions.

    A quaternion and its negative are the same rotation. The reader chooses the sign that is closer to the previous
    quaternion, so that the signals can be interpolated.

    Parameters
    ----------
    link : name of the base link, whose pose and twist are needed.
    """

    def __init__(self, link: str) -> None:
        self.link = link
        self._previous_quaternion = np.array([0.0, 0.0, 0.0, 1.0])

    def sample(self, source: str, receive_time: int, message: OdometryMessage) -> JointSample:
        """Convert a message; an invalid quaternion becomes nan.

        Raises
        ------
        RecordingError
            Where the message describes another frame than the base link.
        """
        if message.child_frame_id.rpartition("/")[2] not in ("", self.link):
            raise RecordingError(
                f"{source} describes the motion of {message.child_frame_id!r}: {self.link!r} is the base of the robot"
            )
        pose = message.pose.pose
        twist = message.twist.twist
        quaternion = self._continuous_quaternion(pose.orientation)
        values = [
            *_components(pose.position),
            *quaternion,
            *_components(twist.linear),
            *_components(twist.angular),
        ]
        stamp = stamp_nanoseconds(message.header)
        return JointSample(source, stamp, receive_time, BASE_SIGNALS, np.array(values, dtype=float), EMPTY, EMPTY)

    def _continuous_quaternion(self, orientation: QuaternionMessage) -> Array:
        """Unit quaternion (4,) x, y, z, w with the sign of the previous one; nan where the message has none."""
        quaternion = np.array([orientation.x, orientation.y, orientation.z, orientation.w])
        length = np.linalg.norm(quaternion)
        quaternion = quaternion / length if 0 < length < np.inf else np.full(4, np.nan)
        if np.isfinite(quaternion).all():
            if quaternion @ self._previous_quaternion < 0:
                quaternion = -quaternion
            self._previous_quaternion = quaternion
        return quaternion


def _components(vector: VectorMessage) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


def filter_base_motion(signals: Array, rate: float, cutoff: float) -> Base:
    """Low-pass filter the motion of the base without delay, and compute its acceleration.

    Accelerations are derivatives of filtered twists. These have components in a rotating frame, so that the classical
    acceleration of the origin is the derivative of the components plus ω × v.

    Parameters
    ----------
    signals : (N, 13) values of `BASE_SIGNALS`.
    rate : samples per second.
    cutoff : cut-off frequency [Hz].
    """
    filtered = lowpass(signals, rate, cutoff)
    poses = np.tile(np.eye(4), (len(filtered), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(filtered[:, 3:7]).as_matrix()
    poses[:, :3, 3] = filtered[:, :3]
    twist = filtered[:, 7:]
    acceleration = differentiate(twist, rate)
    acceleration[:, :3] += np.cross(twist[:, 3:], twist[:, :3])
    return Base(poses, twist, acceleration)


def slice_base(base: Base | None, rows: slice) -> Base | None:
    """Some rows of a Base; None of None."""
    if base is None:
        return None
    pose, twist, acceleration = _arrays(base)
    return Base(pose[rows], twist[rows], acceleration[rows])


def concatenate_bases(first: Base | None, second: Base | None) -> Base | None:
    """The rows of both; None where the base was not recorded."""
    if first is None or second is None:
        return None
    return Base(*(np.concatenate(pair) for pair in zip(_arrays(first), _arrays(second), strict=True)))


def _arrays(base: Base) -> tuple[Array, Array, Array]:
    """Pose (N, 4, 4), twist and acceleration (N, 6) of a recorded base."""
    assert base.acceleration is not None, "a recorded base has accelerations"
    return np.asarray(base.pose), np.asarray(base.twist), np.asarray(base.acceleration)
