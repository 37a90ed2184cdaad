"""Dynamics of robots from URDF or MDH tables: inverse and direct models, for Python and as ROS 2 nodes."""

from robot_dynamics.dynamics import Answer, Base, Dynamics, Equilibrium
from robot_dynamics.errors import (
    DescriptionError,
    QuestionError,
    RecordingError,
    RobotDynamicsError,
    SingularModelError,
)
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Spring
from robot_dynamics.model.library import load_robot, shipped_robots
from robot_dynamics.model.robot import Robot

__all__ = [
    "Answer",
    "Base",
    "DescriptionError",
    "Dynamics",
    "Equilibrium",
    "Inertia",
    "QuestionError",
    "RecordingError",
    "Robot",
    "RobotDynamicsError",
    "SingularModelError",
    "Spring",
    "load_robot",
    "shipped_robots",
]
