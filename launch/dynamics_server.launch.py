"""dynamics_server alone: ros2 launch robot_dynamics dynamics_server.launch.py robot:=panda"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", default_value="panda", description="a robot that ships, or the path of one"),
            DeclareLaunchArgument("namespace", default_value="", description="of the node"),
            Node(
                package="robot_dynamics",
                executable="dynamics_server",
                namespace=LaunchConfiguration("namespace"),
                parameters=[{"robot_file": LaunchConfiguration("robot")}],
                output="screen",
            ),
        ]
    )
