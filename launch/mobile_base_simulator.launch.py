"""mobile_base_simulator alone: ros2 launch robot_dynamics mobile_base_simulator.launch.py robot:=free_flying_arm

publish_clock in the file that `parameters` names wins over `clock`.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import (
    EqualsSubstitution,
    IfElseSubstitution,
    LaunchConfiguration,
    PathJoinSubstitution,
)
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def value_of(argument):
    """The value of a launch argument: empty for `none`, since an empty one cannot be typed."""
    value = LaunchConfiguration(argument)
    return IfElseSubstitution(EqualsSubstitution(value, "none"), "", value)


def generate_launch_description():
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "mobile_base_simulator.yaml"])
    simulated = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "simulated_time.yaml"])
    machine = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "machine_time.yaml"])
    of_time = IfElseSubstitution(EqualsSubstitution(LaunchConfiguration("clock"), "none"), machine, simulated)
    robot = {"robot_file": ParameterValue(value_of("robot"), value_type=str)}
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a robot that ships, or the path of one; none: from the topic robot_description",
            ),
            DeclareLaunchArgument("namespace", default_value="none", description="of the node and its topics"),
            DeclareLaunchArgument("parameters", default_value=shipped, description="file of the node's parameters"),
            DeclareLaunchArgument(
                "clock", default_value="/clock", description="topic of the simulated time; none: the machine's time"
            ),
            Node(
                package="robot_dynamics",
                executable="mobile_base_simulator",
                namespace=value_of("namespace"),
                parameters=[of_time, LaunchConfiguration("parameters"), robot],
                remappings=[("/clock", LaunchConfiguration("clock"))],
                output="screen",
            ),
        ]
    )
