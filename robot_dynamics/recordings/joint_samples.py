"""What a message on joint states tells, whoever read it: a bag, a table or a subscription."""

from typing import NamedTuple

import numpy as np


class JointSample(NamedTuple):
    """What one message tells. source: its topic; stamp, recorded: times of the header and of recording [ns]; names: of
    k joints; position, velocity, effort: (k,) arrays, or of another length where the message has none."""

    source: str
    stamp: int
    receive_time: int
    names: tuple
    position: np.ndarray
    velocity: np.ndarray
    effort: np.ndarray


def sample_of_joint_state(source, recorded, message):
    """The JointSample of a sensor_msgs JointState, of `rosbags` or of rclpy."""
    stamp = message.header.stamp
    arrays = (np.asarray(values, dtype=float) for values in (message.position, message.velocity, message.effort))
    return JointSample(source, stamp.sec * 1_000_000_000 + stamp.nanosec, recorded, tuple(message.name), *arrays)
