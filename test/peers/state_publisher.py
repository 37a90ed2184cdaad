"""A robot that stands still, as a process of its own: joint_states at a rate, to be killed.

python state_publisher.py /namespace 500 panda_joint1=0.1 panda_joint2=-0.3 ...
"""

import sys
import time
from array import array

import rclpy
from builtin_interfaces.msg import Time
from sensor_msgs.msg import JointState


def main():
    namespace, rate, *joints = sys.argv[1:]
    rclpy.init(args=["--ros-args", "-r", f"__ns:={namespace}"])
    publisher = rclpy.create_node("robot").create_publisher(JointState, "joint_states", 1)
    told = [joint.split("=") for joint in joints]
    message = JointState(name=[name for name, _ in told])
    message.position = array("d", [float(value) for _, value in told])
    message.velocity = array("d", bytes(8 * len(told)))
    following = time.monotonic()
    while True:
        now = time.time_ns()
        message.header.stamp = Time(sec=now // 10**9, nanosec=now % 10**9)
        publisher.publish(message)
        following = max(following + 1 / float(rate), time.monotonic() - 0.01)
        time.sleep(max(0.0, following - time.monotonic()))


if __name__ == "__main__":
    main()
