"""A process that records the messages between a robot and computed_torque with their times of reception.

python effort_observer.py /namespace/computed_torque records.bin

Each message on joint_states, ~/commands and ~/effort appends one `RECORD` to the file. Its time is that of reception by
the middleware of this process, by the clock of this process. The process uses no shared memory, by which others could
prevent reception, unless FASTDDS_BUILTIN_TRANSPORTS is DEFAULT.
"""

import os
import signal
import sys
import threading
from functools import partial

import numpy as np
import rclpy
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray

from robot_dynamics.nodes.message_info import MessageInfoCallback
from robot_dynamics.nodes.middleware import without_shared_memory
from robot_dynamics.nodes.runner import make_events_executor

JOINTS = 7
STATE, COMMAND, EFFORT = range(3)
# received, stamp: [ns] since the epoch, stamp 0 where the message has none; efforts: [N m], nan for states
RECORD = np.dtype([("kind", "i8"), ("received", "i8"), ("stamp", "i8"), ("efforts", "f8", JOINTS)])
DEEP = QoSProfile(depth=10_000, reliability=ReliabilityPolicy.RELIABLE)
ENCAPSULATION = 4  # bytes before a serialized message


def read_records(path):
    """The records that an observer has written, which may still run."""
    with open(path, "rb") as file:
        return np.frombuffer(file.read() or b"", dtype=RECORD)


def main():
    target, path, *arguments = sys.argv[1:]
    namespace = target.rpartition("/")[0]
    stopped = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stopped.set())
    with without_shared_memory():
        rclpy.init(args=arguments, signal_handler_options=SignalHandlerOptions.NO)
        node = rclpy.create_node("observer")
    file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
    record = np.zeros(1, dtype=RECORD)

    def write(kind, data, info):
        record["kind"], record["received"] = kind, info["received_timestamp"]
        record["stamp"], record["efforts"] = 0, np.nan
        if kind != COMMAND:
            seconds, nanoseconds = np.frombuffer(data, "u4", 2, ENCAPSULATION)
            record["stamp"] = int(seconds) * 10**9 + int(nanoseconds)
        if kind != STATE:
            record["efforts"] = np.frombuffer(data[-8 * JOINTS :])  # the efforts are the last field of both messages
        os.write(file, record.tobytes())

    for kind, message, topic in (
        (STATE, JointState, f"{namespace}/joint_states"),
        (COMMAND, Float64MultiArray, f"{target}/commands"),
        (EFFORT, JointState, f"{target}/effort"),
    ):
        node.create_subscription(message, topic, MessageInfoCallback(partial(write, kind)), DEEP, raw=True)
    executor = make_events_executor()
    executor.add_node(node)
    while not stopped.is_set():
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
