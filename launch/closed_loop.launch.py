"""A simulated robot under computed_torque: ros2 launch robot_dynamics closed_loop.launch.py robot:=panda

The reference goes to computed_torque/reference (trajectory_msgs/JointTrajectory).
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "closed_loop.yaml"])
    common = {
        "package": "robot_dynamics",
        "namespace": LaunchConfiguration("namespace"),
        "parameters": [LaunchConfiguration("parameters"), {"robot_file": LaunchConfiguration("robot")}],
        "output": "screen",
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", default_value="panda", description="a robot that ships, or the path of one"),
            DeclareLaunchArgument("namespace", default_value="", description="of the nodes and their topics"),
            DeclareLaunchArgument("parameters", default_value=shipped, description="file of the nodes' parameters"),
            Node(
                executable="mobile_base_simulator",
                remappings=[("~/commands", "computed_torque/commands")],
                **common,
            ),
            Node(executable="computed_torque", **common),
        ]
    )
