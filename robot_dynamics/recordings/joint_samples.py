"""Joint samples: the content of one joint state message, read from a bag, a table or a subscription."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.recordings.messages import stamp_nanoseconds

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.recordings.messages import JointStateMessage


class JointSample(NamedTuple):
    """Signals of k joints at one time.

    Attributes
    ----------
    source : topic or file of the message.
    stamp, receive_time : time in the header and time of recording or arrival [ns]; 0: unknown.
    names : names of the k joints.
    position, velocity, effort : (k,), or an array of another length where the message does not have these values.
    """

    source: str
    stamp: int
    receive_time: int
    names: tuple[str, ...]
    position: Array
    velocity: Array
    effort: Array


def sample_of_joint_state(source: str, receive_time: int, message: JointStateMessage) -> JointSample:
    """Convert a sensor_msgs JointState of `rosbags` or rclpy; receive_time [ns]."""
    return JointSample(
        source,
        stamp_nanoseconds(message.header),
        receive_time,
        tuple(message.name),
        np.asarray(message.position, dtype=float),
        np.asarray(message.velocity, dtype=float),
        np.asarray(message.effort, dtype=float),
    )
