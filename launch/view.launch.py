"""A robot in RViz, with its loops closed: ros2 launch robot_dynamics view.launch.py robot:=delta

It shows the joints on the topic joint_states, of a robot or of a simulator. Wrenches that push a simulated robot are
shown as well. robot:=none takes the robot from the topic robot_description, and starts no robot_state_publisher;
rviz:=false starts no RViz.
"""

from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from robot_dynamics.nodes.launching import ViewedUrdf, ViewFrame, robot_parameters, value_of


def generate_launch_description() -> LaunchDescription:
    """Return the nodes and the arguments."""
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "rviz", "view.rviz"])
    robot = value_of("robot")
    frame = ViewFrame(value_of("fixed_frame"), robot)
    time = {"use_sim_time": ParameterValue(LaunchConfiguration("use_sim_time"), value_type=bool)}
    clock = ("/clock", LaunchConfiguration("clock"))
    description = {"robot_description": ParameterValue(ViewedUrdf(robot), value_type=str), "publish_frequency": 50.0}
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="delta",
                description="a shipped robot, or a path; none: the robot on the topic robot_description",
            ),
            DeclareLaunchArgument(
                "namespace", default_value="none", description="namespace of the nodes and their topics"
            ),
            DeclareLaunchArgument("use_sim_time", default_value="false", description="whether to use simulated time"),
            DeclareLaunchArgument("clock", default_value="/clock", description="topic of the simulated time"),
            DeclareLaunchArgument("joint_states", default_value="joint_states", description="topic of the state"),
            DeclareLaunchArgument(
                "external_wrench",
                default_value="mobile_base_simulator/external_wrench",
                description="topic of the wrenches to show",
            ),
            DeclareLaunchArgument("rviz", default_value="true", description="whether to start RViz"),
            DeclareLaunchArgument("config", default_value=shipped, description="configuration of RViz"),
            DeclareLaunchArgument(
                "fixed_frame",
                default_value="none",
                description="frame that does not move; none: the base link, or odom if the base moves",
            ),
            Node(
                package="robot_dynamics",
                executable="joint_state_completer",
                namespace=value_of("namespace"),
                parameters=[time, robot_parameters(robot)],
                remappings=[
                    clock,
                    ("joint_states", LaunchConfiguration("joint_states")),
                    ("~/external_wrench", LaunchConfiguration("external_wrench")),
                ],
                output="screen",
            ),
            Node(
                package="robot_state_publisher",
                executable="robot_state_publisher",
                namespace=value_of("namespace"),
                parameters=[time, description],
                remappings=[clock, ("joint_states", "joint_state_completer/joint_states")],
                condition=IfCondition(NotEqualsSubstitution(LaunchConfiguration("robot"), "none")),
                output="screen",
            ),
            Node(
                package="rviz2",
                executable="rviz2",
                namespace=value_of("namespace"),
                arguments=["-d", LaunchConfiguration("config"), "-f", frame],
                parameters=[time],
                remappings=[clock],
                condition=IfCondition(LaunchConfiguration("rviz")),
                output="screen",
            ),
        ]
    )
