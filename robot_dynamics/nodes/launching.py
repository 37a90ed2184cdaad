"""What the launch files share. `launch` comes with ROS and is not among its wheels: only launch files import this."""

from launch.substitution import Substitution
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration, PathJoinSubstitution
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

NONE = "none"  # stands for an empty launch argument, which cannot be typed


def value_of(argument: str) -> IfElseSubstitution:
    """Return the value of a launch argument, empty for `none`."""
    value = LaunchConfiguration(argument)
    return IfElseSubstitution(EqualsSubstitution(value, NONE), "", value)


def robot_parameters(robot: IfElseSubstitution) -> dict[str, ParameterValue]:
    """Return the parameter that selects a robot; if the value is empty, the topic robot_description does."""
    return {"robot_file": ParameterValue(robot, value_type=str)}


def time_parameters(is_simulated: Substitution) -> IfElseSubstitution:
    """Return the parameter file of nodes that use the time of a simulation, or that of the machine.

    Launch files load it before the parameter file of the user, which has priority.
    """
    simulated = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "simulated_time.yaml"])
    machine = PathJoinSubstitution([FindPackageShare("robot_dynamics"), "config", "machine_time.yaml"])
    return IfElseSubstitution(is_simulated, simulated, machine)
