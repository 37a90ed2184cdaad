"""A robot as a separate process that publishes joint_states at a rate; tests stop and kill it.

python state_publisher.py /namespace 500 panda_joint1=0.1 panda_joint2=-0.3 ...

Each line on its standard input is a number of seconds that its clock is ahead of that of the machine.
"""

import argparse
import sys
import threading
import time
from array import array

import rclpy
from builtin_interfaces.msg import Time
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

SWEEP = 20  # [s] after which a moving robot starts again


def parse_arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("namespace")
    parser.add_argument("rate", type=float)
    parser.add_argument("joints", nargs="+")
    parser.add_argument("--subscribers", type=int, default=0, help="number of subscribers to wait for")
    parser.add_argument("--unstamped", action="store_true", help="header.stamp is zero")
    parser.add_argument("--drift", type=float, default=0.0, help="velocity of the second joint [rad/s]")
    parser.add_argument("--clock", action="store_true", help="publish the time on /clock before each state")
    return parser.parse_args()


class AdjustedClock:
    """The clock of the machine plus the last offset [s] that was read from the standard input."""

    def __init__(self):
        self._offset = 0
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in sys.stdin:
            self._offset = round(float(line) * 1e9)

    def now(self):
        """The time [ns]."""
        return time.time_ns() + self._offset


def drifted(position, drift, now):
    """Position of a joint with a drift [rad/s] at a time [ns]."""
    return position + drift * (now % (SWEEP * 10**9)) * 1e-9


def main():
    options = parse_arguments()
    rclpy.init(args=["--ros-args", "-r", f"__ns:={options.namespace}"])
    node = rclpy.create_node("robot")
    publisher = node.create_publisher(JointState, "joint_states", 1)
    clock_publisher = node.create_publisher(Clock, "/clock", 1) if options.clock else None
    clock = AdjustedClock()
    joints = [joint.split("=") for joint in options.joints]
    message = JointState(name=[name for name, _ in joints])
    positions = array("d", [float(value) for _, value in joints])
    message.velocity = array("d", bytes(8 * len(joints)))
    while publisher.get_subscription_count() < options.subscribers:
        time.sleep(0.02)
    if options.subscribers:
        time.sleep(0.3)  # until they have discovered this publisher as well
    next_time = time.monotonic()
    while True:
        now = clock.now()
        stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        message.position = positions
        if options.drift:
            message.position[1] = drifted(positions[1], options.drift, now)
        if not options.unstamped:
            message.header.stamp = stamp
        if clock_publisher is not None:
            clock_publisher.publish(Clock(clock=stamp))
        publisher.publish(message)
        next_time = max(next_time + 1 / options.rate, time.monotonic() - 0.01)
        time.sleep(max(0.0, next_time - time.monotonic()))


if __name__ == "__main__":
    main()
