"""mobile_base_simulator alone: ros2 launch robot_dynamics mobile_base_simulator.launch.py robot:=free_flying_arm

publish_clock in the parameter file has priority over `clock`.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from robot_dynamics.nodes.launching import robot_parameters, time_parameters, value_of


def generate_launch_description() -> LaunchDescription:
    """Return the nodes and the arguments."""
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "mobile_base_simulator.yaml"])
    time = time_parameters(NotEqualsSubstitution(LaunchConfiguration("clock"), "none"))
    robot = robot_parameters(value_of("robot"))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a shipped robot, or a path; none: the robot on the topic robot_description",
            ),
            DeclareLaunchArgument(
                "namespace", default_value="none", description="namespace of the node and its topics"
            ),
            DeclareLaunchArgument("parameters", default_value=shipped, description="parameter file of the node"),
            DeclareLaunchArgument(
                "clock",
                default_value="/clock",
                description="topic of the simulated time; none: use the time of the machine",
            ),
            Node(
                package="robot_dynamics",
                executable="mobile_base_simulator",
                namespace=value_of("namespace"),
                parameters=[time, LaunchConfiguration("parameters"), robot],
                remappings=[("/clock", LaunchConfiguration("clock"))],
                output="screen",
            ),
        ]
    )
