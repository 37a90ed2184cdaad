"""Dynamics of robots from URDF, MDH tables or SYMORO+ files: inverse and direct models in Python and as ROS 2 nodes.

The names in `__all__` are the public API. All other names and modules are internal and may change in any release.
"""

from importlib import import_module
from typing import TYPE_CHECKING

from robot_dynamics.errors import (
    CompilationError,
    DescriptionError,
    InvalidInputError,
    MissingPackageError,
    RecordingError,
    RobotDynamicsError,
    SimulationError,
    SingularModelError,
)
from robot_dynamics.notebook_display import register_formatter

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics
    from robot_dynamics.flexible.elastodynamics import Elastodynamics, NaturalFrequencies
    from robot_dynamics.flexible.flexible_arm import FlexibleArm, FlexibleDynamicsResult
    from robot_dynamics.flexible.frequency_map import FrequencyMap, frequency_map
    from robot_dynamics.identification.base_parameters import BaseParameters, compute_base_parameters
    from robot_dynamics.inputs import Base
    from robot_dynamics.model.formats.mdh_yaml.writer import write_mdh_yaml
    from robot_dynamics.model.formats.par.writer import write_par
    from robot_dynamics.model.formats.urdf.writer import write_urdf
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.joint import Joint, Spring
    from robot_dynamics.model.loading import load_robot, shipped_robots
    from robot_dynamics.model.robot import Link, Robot
    from robot_dynamics.parallel.platform_dynamics import PlatformDynamics
    from robot_dynamics.parallel.pose_map import PoseMap, pose_map
    from robot_dynamics.results import DynamicsResult, Equilibrium, JointMotion
    from robot_dynamics.simulation.ground import Ground
    from robot_dynamics.simulation.simulation import Simulation
    from robot_dynamics.simulation.simulation_state import SimulationState
    from robot_dynamics.simulation.wheels import Wheel
    from robot_dynamics.viewing.notebook_view import notebook_view
    from robot_dynamics.viewing.skeleton import add_skeleton

__all__ = [
    "Base",
    "BaseParameters",
    "CompilationError",
    "DescriptionError",
    "Dynamics",
    "DynamicsResult",
    "Elastodynamics",
    "Equilibrium",
    "FlexibleArm",
    "FlexibleDynamicsResult",
    "FrequencyMap",
    "Ground",
    "Inertia",
    "InvalidInputError",
    "Joint",
    "JointMotion",
    "Link",
    "MissingPackageError",
    "NaturalFrequencies",
    "PlatformDynamics",
    "PoseMap",
    "RecordingError",
    "Robot",
    "RobotDynamicsError",
    "Simulation",
    "SimulationError",
    "SimulationState",
    "SingularModelError",
    "Spring",
    "Wheel",
    "add_skeleton",
    "compute_base_parameters",
    "frequency_map",
    "load_robot",
    "notebook_view",
    "pose_map",
    "shipped_robots",
    "simulate",
    "write_mdh_yaml",
    "write_par",
    "write_urdf",
]

# modules of the names that are imported at their first use: `import robot_dynamics` alone imports no other package
_MODULES = {
    "Base": "inputs",
    "BaseParameters": "identification.base_parameters",
    "Dynamics": "dynamics",
    "DynamicsResult": "results",
    "Elastodynamics": "flexible.elastodynamics",
    "Equilibrium": "results",
    "FlexibleArm": "flexible.flexible_arm",
    "FlexibleDynamicsResult": "flexible.flexible_arm",
    "FrequencyMap": "flexible.frequency_map",
    "Ground": "simulation.ground",
    "Inertia": "model.inertia",
    "Joint": "model.joint",
    "JointMotion": "results",
    "Link": "model.robot",
    "NaturalFrequencies": "flexible.elastodynamics",
    "PlatformDynamics": "parallel.platform_dynamics",
    "PoseMap": "parallel.pose_map",
    "Robot": "model.robot",
    "Simulation": "simulation.simulation",
    "SimulationState": "simulation.simulation_state",
    "Spring": "model.joint",
    "Wheel": "simulation.wheels",
    "add_skeleton": "viewing.skeleton",
    "compute_base_parameters": "identification.base_parameters",
    "frequency_map": "flexible.frequency_map",
    "load_robot": "model.loading",
    "notebook_view": "viewing.notebook_view",
    "pose_map": "parallel.pose_map",
    "shipped_robots": "model.loading",
    "simulate": "simulation.rollouts",
    "write_mdh_yaml": "model.formats.mdh_yaml.writer",
    "write_par": "model.formats.par.writer",
    "write_urdf": "model.formats.urdf.writer",
}


def _format_for_notebook(value: object) -> str | None:
    """Return the HTML of an object; the layout is imported where a notebook first shows something."""
    from robot_dynamics.notebook.formatters import format_html

    return format_html(value)


register_formatter(_format_for_notebook)


def __getattr__(name: str) -> object:
    if name == "__version__":
        from robot_dynamics.version import package_version

        return package_version()
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        value = getattr(import_module(f"{__name__}.{_MODULES[name]}"), name)
    except ModuleNotFoundError as error:
        from robot_dynamics.optional_packages import missing_package_error

        raise missing_package_error(error, __name__) from None
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
