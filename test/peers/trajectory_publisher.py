"""A process that publishes a trajectory of many points, at a position: a planner that sends it as a whole.

python trajectory_publisher.py /namespace/computed_torque/reference 100000 panda_joint1=0.1 panda_joint2=-0.3 ...
"""

import argparse
from array import array

import rclpy
from rclpy.duration import Duration
from rclpy.serialization import serialize_message
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

PERIOD = 1_000_000  # [ns] between two points


def parse_arguments():
    parser = argparse.ArgumentParser()
    parser.add_argument("topic")
    parser.add_argument("points", type=int)
    parser.add_argument("joints", nargs="+")
    return parser.parse_args()


def main():
    options = parse_arguments()
    joints = [joint.split("=") for joint in options.joints]
    message = JointTrajectory(joint_names=[name for name, _ in joints])
    positions = array("d", [float(value) for _, value in joints])
    rest = array("d", bytes(8 * len(joints)))
    for k in range(options.points):
        point = JointTrajectoryPoint(positions=positions, velocities=rest, accelerations=rest)
        point.time_from_start.sec, point.time_from_start.nanosec = divmod(k * PERIOD, 10**9)
        message.points.append(point)
    data = serialize_message(message)
    rclpy.init()
    node = rclpy.create_node("planner")
    publisher = node.create_publisher(JointTrajectory, options.topic, 1)
    while not publisher.get_subscription_count():
        rclpy.spin_once(node, timeout_sec=0.02)
    publisher.publish(data)
    assert publisher.wait_for_all_acked(Duration(seconds=30)), "the trajectory did not arrive"


if __name__ == "__main__":
    main()
