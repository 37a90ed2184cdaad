"""External torques and contacts of a robot: ros2 launch robot_dynamics contact_monitor.launch.py robot:=panda

robot:=none takes the robot from the topic robot_description. use_sim_time in the parameter file has priority over the
argument.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from robot_dynamics.nodes.launching import robot_parameters, time_parameters, value_of


def generate_launch_description() -> LaunchDescription:
    """Return the node and the arguments."""
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "contact_monitor.yaml"])
    time = time_parameters(LaunchConfiguration("use_sim_time"))
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
            DeclareLaunchArgument("use_sim_time", default_value="false", description="whether to use simulated time"),
            DeclareLaunchArgument("clock", default_value="/clock", description="topic of the simulated time"),
            DeclareLaunchArgument("joint_states", default_value="joint_states", description="topic of the state"),
            Node(
                package="robot_dynamics",
                executable="contact_monitor",
                namespace=value_of("namespace"),
                parameters=[time, LaunchConfiguration("parameters"), robot],
                remappings=[
                    ("/clock", LaunchConfiguration("clock")),
                    ("joint_states", LaunchConfiguration("joint_states")),
                ],
                output="screen",
            ),
        ]
    )
