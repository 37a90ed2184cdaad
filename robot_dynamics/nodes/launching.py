"""What the launch files share. `launch` comes with ROS and is not among its wheels: only launch files import this."""

from typing import Any

from launch.substitution import Substitution
from launch.substitutions import EqualsSubstitution, IfElseSubstitution, LaunchConfiguration, PathJoinSubstitution
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

from robot_dynamics.model.loading import load_robot
from robot_dynamics.nodes.viewed_urdf import view_frame, viewed_urdf

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


class ViewedUrdf(Substitution):
    """The text of the URDF that robot_state_publisher shows of a robot."""

    def __init__(self, robot: Substitution) -> None:
        super().__init__()
        self._robot = robot

    def perform(self, context: Any) -> str:
        """Return the text; the value of the robot is a path, or the name of a robot that ships."""
        return viewed_urdf(self._robot.perform(context))


class ViewFrame(Substitution):
    """The fixed frame of a view: a name, or if that is empty the one of the robot.

    Without a robot it is `map`.
    """

    def __init__(self, name: Substitution, robot: Substitution) -> None:
        super().__init__()
        self._name = name
        self._robot = robot

    def perform(self, context: Any) -> str:
        """Return the name of the frame."""
        name: str = self._name.perform(context)
        robot = self._robot.perform(context)
        if name or not robot:
            return name or "map"
        return view_frame(load_robot(robot))
