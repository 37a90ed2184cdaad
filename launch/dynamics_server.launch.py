"""dynamics_server alone: ros2 launch robot_dynamics dynamics_server.launch.py robot:=panda"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription


def value_of(argument):
    """The value of a launch argument: empty for `none`, since an empty one cannot be typed."""
    value = LaunchConfiguration(argument)
    return IfElseSubstitution(EqualsSubstitution(value, "none"), "", value)


def generate_launch_description():
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a robot that ships, or the path of one; none: from the topic robot_description",
            ),
            DeclareLaunchArgument("namespace", default_value="none", description="of the node"),
            Node(
                package="robot_dynamics",
                executable="dynamics_server",
                namespace=value_of("namespace"),
                parameters=[{"robot_file": ParameterValue(value_of("robot"), value_type=str)}],
                output="screen",
            ),
        ]
    )
