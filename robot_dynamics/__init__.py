"""Dynamics of robots from URDF or MDH tables: inverse and direct models, for Python and as ROS 2 nodes."""

from robot_dynamics.errors import (
    DescriptionError,
    InvalidInputError,
    MissingPackageError,
    RecordingError,
    RobotDynamicsError,
    SingularModelError,
)

try:
    from robot_dynamics.dynamics import Base, Dynamics, DynamicsResult, Equilibrium
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.joint import Spring
    from robot_dynamics.model.loading import load_robot, shipped_robots
    from robot_dynamics.model.robot import Robot
except ModuleNotFoundError as error:
    # A required package is missing. Whatever is used of this one says so; its commands can, in a line of their own.
    _missing = error

    def __getattr__(name):
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from robot_dynamics.optional_packages import missing_package_error

        raise missing_package_error(_missing, __name__) from None


__all__ = [
    "Base",
    "DescriptionError",
    "Dynamics",
    "DynamicsResult",
    "Equilibrium",
    "Inertia",
    "InvalidInputError",
    "MissingPackageError",
    "RecordingError",
    "Robot",
    "RobotDynamicsError",
    "SingularModelError",
    "Spring",
    "load_robot",
    "shipped_robots",
]
