"""A simulated robot under computed_torque: ros2 launch robot_dynamics closed_loop.launch.py robot:=panda

The reference goes to computed_torque/reference (trajectory_msgs/JointTrajectory). Argument `clock` is the topic of the
simulated time, in the namespace of the nodes: two robots run side by side with namespace:=left and namespace:=right.
clock:=/clock publishes simulated time to all nodes; only one simulator may do that. clock:=none uses the time of the
machine. publish_clock and use_sim_time in the parameter file have priority.
"""

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, NotEqualsSubstitution, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

from launch import LaunchDescription
from robot_dynamics.nodes.launching import robot_parameters, time_parameters, value_of


def generate_launch_description() -> LaunchDescription:
    """Return the nodes and the arguments."""
    shipped = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "closed_loop.yaml"])
    parameters = LaunchConfiguration("parameters")
    robot = robot_parameters(value_of("robot"))
    time = time_parameters(NotEqualsSubstitution(LaunchConfiguration("clock"), "none"))
    common = {"package": "robot_dynamics", "namespace": value_of("namespace"), "output": "screen"}
    clock = ("/clock", LaunchConfiguration("clock"))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                "robot",
                default_value="panda",
                description="a shipped robot, or a path; none: the robot on the topic robot_description",
            ),
            DeclareLaunchArgument(
                "namespace", default_value="none", description="namespace of the nodes and their topics"
            ),
            DeclareLaunchArgument("parameters", default_value=shipped, description="parameter file of the nodes"),
            DeclareLaunchArgument(
                "clock",
                default_value="clock",
                description="topic of the simulated time; none: use the time of the machine",
            ),
            Node(
                executable="mobile_base_simulator",
                parameters=[time, parameters, robot],
                remappings=[("~/commands", "computed_torque/commands"), clock],
                **common,
            ),
            Node(
                executable="computed_torque",
                parameters=[time, parameters, robot],
                remappings=[clock],
                **common,
            ),
        ]
    )
