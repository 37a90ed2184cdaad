"""What a simulated robot tells: a SimulationState as messages."""

from array import array

import numpy as np
from geometry_msgs.msg import AccelStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.geometry import write_accel, write_pose, write_transform, write_twist


def joint_state_message(simulation, efforts, noise, stamp):
    """sensor_msgs/JointState of all joints. efforts: (n,); noise: (position, velocity) standard deviations and a
    Generator."""
    state, dynamics = simulation.state, simulation.dynamics
    q, qd, efforts = state.joint_positions, state.joint_velocities, dynamics.embed_efforts(efforts)
    of_position, of_velocity, random = noise
    if of_position:
        q = q + of_position * random.standard_normal(len(q))
    if of_velocity:
        qd = qd + of_velocity * random.standard_normal(len(qd))
    message = JointState(name=list(dynamics.all_joint_names))
    message.header.stamp = stamp
    message.position, message.velocity, message.effort = (array("d", np.ascontiguousarray(v)) for v in (q, qd, efforts))
    return message


def odometry_message(state, stamp, odom_frame, base_frame):
    """nav_msgs/Odometry: the pose of the base in the world, its twist in its own frame."""
    message = Odometry(child_frame_id=base_frame)
    message.header.stamp, message.header.frame_id = stamp, odom_frame
    message.pose.pose = write_pose(state.pose[:3, 3], to_scipy_rotation(state.pose[:3, :3]).as_quat())
    message.twist.twist = write_twist(state.twist)
    return message


def transform(state, stamp, odom_frame, base_frame):
    """geometry_msgs/TransformStamped of the same pose, for /tf."""
    message = TransformStamped(child_frame_id=base_frame)
    message.header.stamp, message.header.frame_id = stamp, odom_frame
    message.transform = write_transform(state.pose[:3, 3], to_scipy_rotation(state.pose[:3, :3]).as_quat())
    return message


def acceleration_message(acceleration, stamp, base_frame):
    """geometry_msgs/AccelStamped of the base (6,), true and classical, in its own frame."""
    message = AccelStamped(accel=write_accel(acceleration))
    message.header.stamp, message.header.frame_id = stamp, base_frame
    return message
