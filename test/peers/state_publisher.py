"""A robot as a process of its own: joint_states at a rate, to be stopped and killed.

python state_publisher.py /namespace 500 panda_joint1=0.1 panda_joint2=-0.3 ...
"""

import argparse
import time
from array import array

import rclpy
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState

SWEEP = 20  # [s] after which a robot that moves begins anew


def arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("namespace")
    parser.add_argument("rate", type=float)
    parser.add_argument("joints", nargs="+")
    parser.add_argument("--subscribers", type=int, default=0, help="wait until there are as many, and get messages")
    parser.add_argument("--unstamped", action="store_true", help="header.stamp is zero")
    parser.add_argument("--drift", type=float, default=0.0, help="of the second joint in a sweep [rad/s]")
    return parser.parse_args()


def drifted(position, drift, now):
    """Where a joint is at a time [ns]."""
    return position + drift * (now % (SWEEP * 10**9)) * 1e-9


def main():
    given = arguments()
    rclpy.init(args=["--ros-args", "-r", f"__ns:={given.namespace}"])
    publisher = rclpy.create_node("robot").create_publisher(JointState, "joint_states", 1)
    told = [joint.split("=") for joint in given.joints]
    message = JointState(name=[name for name, _ in told])
    positions = array("d", [float(value) for _, value in told])
    message.velocity = array("d", bytes(8 * len(told)))
    while publisher.get_subscription_count() < given.subscribers:
        time.sleep(0.02)
    if given.subscribers:
        time.sleep(0.3)  # until they know this publisher as well
    following = time.monotonic()
    while True:
        now = time.time_ns()
        message.position = positions
        if given.drift:
            message.position[1] = drifted(positions[1], given.drift, now)
        if not given.unstamped:
            message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        publisher.publish(message)
        following = max(following + 1 / given.rate, time.monotonic() - 0.01)
        time.sleep(max(0.0, following - time.monotonic()))


if __name__ == "__main__":
    main()
