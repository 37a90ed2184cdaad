"""The state of a simulation as messages."""

from __future__ import annotations

from array import array
from typing import TYPE_CHECKING

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import AccelStamped, TransformStamped
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState

from robot_dynamics.model.placement import to_scipy_rotation
from robot_dynamics.nodes.codecs.geometry import write_accel, write_pose, write_transform, write_twist

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation import Simulation, SimulationState


def joint_state_message(
    simulation: Simulation, efforts: Array, noise: tuple[float, float, np.random.Generator], stamp: Time
) -> JointState:
    """Return sensor_msgs/JointState of all joints, with noise.

    efforts: (n,); noise: standard deviations of positions and of velocities, and the generator.
    """
    state = simulation.state
    dynamics = simulation.dynamics
    q = state.joint_positions
    qd = state.joint_velocities
    position_deviation, velocity_deviation, random = noise
    if position_deviation:
        q = q + position_deviation * random.standard_normal(len(q))
    if velocity_deviation:
        qd = qd + velocity_deviation * random.standard_normal(len(qd))
    message = JointState(name=list(dynamics.all_joint_names))
    message.header.stamp = stamp
    message.position = array("d", np.ascontiguousarray(q))
    message.velocity = array("d", np.ascontiguousarray(qd))
    message.effort = array("d", np.ascontiguousarray(dynamics.embed_efforts(efforts)))
    return message


def odometry_message(state: SimulationState, stamp: Time, odom_frame: str, base_frame: str) -> Odometry:
    """Return nav_msgs/Odometry: the pose of the base in the world, and its twist in the base frame."""
    message = Odometry(child_frame_id=base_frame)
    message.header.stamp = stamp
    message.header.frame_id = odom_frame
    message.pose.pose = write_pose(state.pose[:3, 3], _quaternion(state))
    message.twist.twist = write_twist(state.twist)
    return message


def transform_message(state: SimulationState, stamp: Time, odom_frame: str, base_frame: str) -> TransformStamped:
    """Return geometry_msgs/TransformStamped of the pose of the base, for /tf."""
    message = TransformStamped(child_frame_id=base_frame)
    message.header.stamp = stamp
    message.header.frame_id = odom_frame
    message.transform = write_transform(state.pose[:3, 3], _quaternion(state))
    return message


def acceleration_message(acceleration: Array, stamp: Time, base_frame: str) -> AccelStamped:
    """Return geometry_msgs/AccelStamped of the base (6,), true and classical, in the base frame."""
    message = AccelStamped(accel=write_accel(acceleration))
    message.header.stamp = stamp
    message.header.frame_id = base_frame
    return message


def _quaternion(state: SimulationState) -> Array:
    quaternion: Array = to_scipy_rotation(state.pose[:3, :3]).as_quat()
    return quaternion
