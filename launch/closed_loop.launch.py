"""A simulated robot under computed_torque: ros2 launch robot_dynamics closed_loop.launch.py robot:=panda

The reference goes to computed_torque/reference (trajectory_msgs/JointTrajectory). Simulated time is on the topic that
`clock` names, which is in the namespace: so two of them run side by side, as namespace:=left and namespace:=right.
clock:=/clock gives simulated time to all nodes; one simulator alone may do that. clock:=none keeps the time of the
machine. publish_clock and use_sim_time in the file that `parameters` names win over both.
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
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "closed_loop.yaml"])
    parameters = LaunchConfiguration("parameters")
    robot = {"robot_file": ParameterValue(value_of("robot"), value_type=str)}
    simulated = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "simulated_time.yaml"])
    machine = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "machine_time.yaml"])
    of_time = IfElseSubstitution(EqualsSubstitution(LaunchConfiguration("clock"), "none"), machine, simulated)
    common = {"package": "robot_dynamics", "namespace": value_of("namespace"), "output": "screen"}
    clock = ("/clock", LaunchConfiguration("clock"))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a robot that ships, or the path of one; none: from the topic robot_description",
            ),
            DeclareLaunchArgument("namespace", default_value="none", description="of the nodes and their topics"),
            DeclareLaunchArgument("parameters", default_value=shipped, description="file of the nodes' parameters"),
            DeclareLaunchArgument(
                "clock", default_value="clock", description="topic of the simulated time; none: the machine's time"
            ),
            Node(
                executable="mobile_base_simulator",
                parameters=[of_time, parameters, robot],
                remappings=[("~/commands", "computed_torque/commands"), clock],
                **common,
            ),
            Node(
                executable="computed_torque",
                parameters=[of_time, parameters, robot],
                remappings=[clock],
                **common,
            ),
        ]
    )
