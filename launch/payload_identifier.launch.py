"""payload_identifier alone: ros2 launch robot_dynamics payload_identifier.launch.py robot:=panda"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

from launch import LaunchDescription
from robot_dynamics.nodes.launching import robot_parameters, value_of


def generate_launch_description() -> LaunchDescription:
    """Return the nodes and the arguments."""
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a shipped robot, or a path, without load; none: the robot on the topic robot_description",
            ),
            DeclareLaunchArgument("drives", default_value="none", description="path of a file of drives, or none"),
            DeclareLaunchArgument(
                "namespace", default_value="none", description="namespace of the node and its topics"
            ),
            DeclareLaunchArgument("joint_states", default_value="joint_states", description="topic of the state"),
            Node(
                package="robot_dynamics",
                executable="payload_identifier",
                namespace=value_of("namespace"),
                parameters=[
                    robot_parameters(value_of("robot")),
                    {"drives": ParameterValue(value_of("drives"), value_type=str)},
                ],
                remappings=[("joint_states", LaunchConfiguration("joint_states"))],
                output="screen",
            ),
        ]
    )
