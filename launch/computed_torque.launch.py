"""Torques for a robot: ros2 launch robot_dynamics computed_torque.launch.py robot:=panda

With robot:="" it is taken from the topic robot_description.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription


def generate_launch_description():
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "computed_torque.yaml"])
    told = {
        "robot_file": ParameterValue(LaunchConfiguration("robot"), value_type=str),
        "use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool),
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", default_value="panda", description="a robot that ships, or the path of one"),
            DeclareLaunchArgument("namespace", default_value="", description="of the node and its topics"),
            DeclareLaunchArgument("parameters", default_value=shipped, description="file of the node's parameters"),
            DeclareLaunchArgument("use_sim_time", default_value="false", description="whether time is that of /clock"),
            DeclareLaunchArgument("joint_states", default_value="joint_states", description="topic of the state"),
            DeclareLaunchArgument("commands", default_value="~/commands", description="topic of the efforts"),
            Node(
                package="robot_dynamics",
                executable="computed_torque",
                namespace=LaunchConfiguration("namespace"),
                parameters=[LaunchConfiguration("parameters"), told],
                remappings=[
                    ("joint_states", LaunchConfiguration("joint_states")),
                    ("~/commands", LaunchConfiguration("commands")),
                ],
                output="screen",
            ),
        ]
    )
