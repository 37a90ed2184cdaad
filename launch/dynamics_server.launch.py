"""dynamics_server alone: ros2 launch robot_dynamics dynamics_server.launch.py robot:=panda"""

from launch.actions import DeclareLaunchArgument
from launch_ros.actions import Node

from launch import LaunchDescription
from robot_dynamics.nodes.launching import robot_parameters, value_of


def generate_launch_description() -> LaunchDescription:
    """Return the nodes and the arguments."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a shipped robot, or a path; none: the robot on the topic robot_description",
            ),
            DeclareLaunchArgument("namespace", default_value="none", description="namespace of the node"),
            Node(
                package="robot_dynamics",
                executable="dynamics_server",
                namespace=value_of("namespace"),
                parameters=[robot_parameters(value_of("robot"))],
                output="screen",
            ),
        ]
    )
