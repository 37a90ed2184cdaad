"""How a moving base moves: from odometry to its pose, twist and acceleration, filtered as the joints are."""

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.errors import RecordingError
from robot_dynamics.inputs import Base
from robot_dynamics.recordings.joint_samples import JointSample
from robot_dynamics.recordings.signals import differentiate, lowpass

BASE_SIGNALS = tuple(f"{name} of the base" for name in (
    "x", "y", "z", "qx", "qy", "qz", "qw", "velocity x", "velocity y", "velocity z", "rotation x", "rotation y",
    "rotation z"))  # fmt: skip
EMPTY = np.zeros(0)


class OdometryReader:
    """Makes JointSamples of nav_msgs Odometry, in which SIGNALS stand as positions of joints would.

    A quaternion and its negative are the same rotation: they come without a jump, so that they can be interpolated.
    link: name of the base link, whose pose and twist are needed.
    """

    def __init__(self, link):
        self.link = link
        self._before = np.array([0.0, 0.0, 0.0, 1.0])

    def sample(self, source, recorded, message):
        """The JointSample of a message, with nan where its quaternion is none. Raises RecordingError where it tells of
        another frame."""
        if message.child_frame_id.rpartition("/")[2] not in ("", self.link):
            raise RecordingError(
                f"{source} tells how {message.child_frame_id!r} moves: {self.link!r} is the base of the robot"
            )
        stamp, pose, twist = message.header.stamp, message.pose.pose, message.twist.twist
        q = np.array([getattr(pose.orientation, axis) for axis in "xyzw"])
        length = np.linalg.norm(q)
        q = q / length if 0 < length < np.inf else np.full(4, np.nan)
        if np.isfinite(q).all():
            self._before = q = -q if q @ self._before < 0 else q
        parts = (pose.position, twist.linear, twist.angular)
        place, linear, angular = ([getattr(part, axis) for axis in "xyz"] for part in parts)
        values = np.array([*place, *q, *linear, *angular], dtype=float)
        return JointSample(source, stamp.sec * 1_000_000_000 + stamp.nanosec, recorded, BASE_SIGNALS, values, EMPTY,
                           EMPTY)  # fmt: skip


def filter_base_motion(signals, rate, cutoff):
    """The Base of SIGNALS (N, 13) at a rate [1/s]: what is above the cut-off [Hz] is taken away, without delay.

    Accelerations are derivatives of filtered twists. Those are expressed in a frame that turns: of the velocity of its
    origin, the derivative of the components lacks ω × v.
    """
    smooth = lowpass(signals, rate, cutoff)
    poses = np.tile(np.eye(4), (len(smooth), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(smooth[:, 3:7]).as_matrix()
    poses[:, :3, 3] = smooth[:, :3]
    twist = smooth[:, 7:]
    acceleration = differentiate(twist, rate)
    acceleration[:, :3] += np.cross(twist[:, 3:], twist[:, :3])
    return Base(poses, twist, acceleration)


def slice_base(base, rows):
    """The Base of some rows, a slice; None of None."""
    return None if base is None else Base(base.pose[rows], base.twist[rows], base.acceleration[rows])


def concatenate_bases(first, second):
    """The Base of the rows of both; None of None."""
    if first is None:
        return None
    pairs = ((getattr(first, name), getattr(second, name)) for name in ("pose", "twist", "acceleration"))
    return Base(*map(np.concatenate, pairs))
