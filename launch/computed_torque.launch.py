"""Torques for a robot: ros2 launch robot_dynamics computed_torque.launch.py robot:=panda

With robot:=none it is taken from the topic robot_description. use_sim_time in the file that `parameters` names wins
over the argument.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def value_of(argument):
    """The value of a launch argument: empty for `none`, since an empty one cannot be typed."""
    value = LaunchConfiguration(argument)
    return IfElseSubstitution(EqualsSubstitution(value, "none"), "", value)


def generate_launch_description():
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "computed_torque.yaml"])
    simulated = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "simulated_time.yaml"])
    machine = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "machine_time.yaml"])
    of_time = IfElseSubstitution(LaunchConfiguration("use_sim_time"), simulated, machine)
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
            DeclareLaunchArgument("use_sim_time", default_value="false", description="whether time is that of a clock"),
            DeclareLaunchArgument("clock", default_value="/clock", description="topic of the simulated time"),
            DeclareLaunchArgument("joint_states", default_value="joint_states", description="topic of the state"),
            DeclareLaunchArgument("commands", default_value="~/commands", description="topic of the efforts"),
            Node(
                package="robot_dynamics",
                executable="computed_torque",
                namespace=value_of("namespace"),
                parameters=[of_time, LaunchConfiguration("parameters"), robot],
                remappings=[
                    ("/clock", LaunchConfiguration("clock")),
                    ("joint_states", LaunchConfiguration("joint_states")),
                    ("~/commands", LaunchConfiguration("commands")),
                ],
                output="screen",
            ),
        ]
    )
