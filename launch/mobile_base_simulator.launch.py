"""mobile_base_simulator alone: ros2 launch robot_dynamics mobile_base_simulator.launch.py robot:=free_flying_arm"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "mobile_base_simulator.yaml"])
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", default_value="panda", description="a robot that ships, or the path of one"),
            DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
            DeclareLaunchArgument("parameters", default_value=shipped, description="file of the node's parameters"),
            Node(
                package="robot_dynamics",
                executable="mobile_base_simulator",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("parameters"), {"robot_file": LaunchConfiguration("robot")}],
                output="screen",
            ),
        ]
    )
