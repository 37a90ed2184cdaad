"""Dynamics of robots from URDF: inverse and direct models, for Python and as ROS 2 nodes."""

from robot_dynamics.dynamics import Answer, Base, Dynamics
from robot_dynamics.errors import DescriptionError, QuestionError, RobotDynamicsError, SingularModelError
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.library import load_robot, shipped_robots
from robot_dynamics.model.robot import Robot

__all__ = [
    "Answer",
    "Base",
    "DescriptionError",
    "Dynamics",
    "Inertia",
    "QuestionError",
    "Robot",
    "RobotDynamicsError",
    "SingularModelError",
    "load_robot",
    "shipped_robots",
]
