"""The simulation that follows from the parameters and a robot, at its initial state."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Sized
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.inputs import Base
from robot_dynamics.nodes.codecs.geometry import QUATERNION_NORM_TOLERANCE
from robot_dynamics.simulation.ground import Ground
from robot_dynamics.simulation.simulation import Simulation
from robot_dynamics.simulation.wheels import Wheel

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, IntArray
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.nodes.parameters import ParameterValues


@dataclass(frozen=True, eq=False)
class SimulationSetup:
    """A simulation, and the joints that ~/commands is for.

    Attributes
    ----------
    joints : (k,) their indices in the joint_names of the simulation.
    joint_names : their names.
    """

    simulation: Simulation
    joints: IntArray
    joint_names: tuple[str, ...]


def build_simulation(values: ParameterValues, robot: Robot) -> SimulationSetup:
    """Return the setup of validated parameters and a robot. Raises RobotDynamicsError."""
    simulation = Simulation(
        robot,
        wheels=_wheels(values),
        ground=_ground(values),
        step=values["step"],
        drive_time=values["drive_time"],
        base=values["base_motion"] or None,
    )
    _start(simulation, values)
    names = _commanded_joints(simulation, values["joints"])
    indices = np.array([simulation.joint_names.index(name) for name in names], dtype=int)
    return SimulationSetup(simulation, indices, names)


def _wheels(values: ParameterValues) -> list[Wheel]:
    joints = values["wheels.joints"]
    radii = values["wheels.radii"]
    angles = values["wheels.roller_angles"]
    _require_same_length("wheels.radii", radii, "wheels.joints", joints)
    if angles:
        _require_same_length("wheels.roller_angles", angles, "wheels.joints", joints)
    rows = zip(joints, radii, angles or [None] * len(joints), strict=True)
    return [Wheel(name, radius, angle) for name, radius, angle in rows]


def _ground(values: ParameterValues) -> Ground | None:
    if not values["ground.points"]:
        return None
    return Ground(**{name: values[f"ground.{name}"] for name in Ground.__dataclass_fields__})


def _commanded_joints(simulation: Simulation, names: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints that ~/commands is for: those of parameter `joints`, else all with a motor."""
    unactuated = simulation.dynamics.unactuated_joint_names
    actuated = [name for name in simulation.joint_names if name not in unactuated]
    for name in names:
        if name not in actuated:
            raise InvalidInputError(f"parameter joints: {name!r} has no motor; {', '.join(actuated)} have")
    if len(set(names)) < len(names):
        raise InvalidInputError("parameter joints names a joint more than once")
    return tuple(names or actuated)


def _start(simulation: Simulation, values: ParameterValues) -> None:
    """Set the initial state."""
    joints = values["initial.joints"]
    indices = []
    for name in joints:
        if name not in simulation.joint_names:
            raise InvalidInputError(
                f"parameter initial.joints: {name!r} is none of the joints {', '.join(simulation.joint_names)}"
            )
        indices.append(simulation.joint_names.index(name))
    if joints and not (values["initial.positions"] or values["initial.velocities"]):
        raise InvalidInputError(
            "parameter initial.joints has names, but neither initial.positions nor initial.velocities"
        )
    positions = initial_positions(simulation)
    velocities = simulation.state.velocities.copy()
    for parameter, state in (("initial.positions", positions), ("initial.velocities", velocities)):
        if values[parameter]:
            _require_same_length(parameter, values[parameter], "initial.joints", joints)
            state[indices] = values[parameter]
    pose = _initial_pose(values["initial.pose"])
    simulation.start(positions, velocities, base=Base(pose, np.array(values["initial.twist"])))


def _initial_pose(values: Sequence[float]) -> Array:
    """Return the pose (4, 4) of a position and a quaternion x, y, z, w."""
    quaternion = np.array(values[3:])
    norm = np.linalg.norm(quaternion)
    if not abs(norm - 1) < QUATERNION_NORM_TOLERANCE:
        raise InvalidInputError(f"parameter initial.pose has a quaternion of norm {norm:g}, not 1")
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    pose[:3, 3] = values[:3]
    return pose


def initial_positions(simulation: Simulation) -> Array:
    """Return the positions (n,) at which the joints start if no parameter sets them.

    They are those of the description. If it has none and zero is beyond the limits of the joint, the joint starts in
    the middle of its limits, or at the only finite one, as joint_state_publisher does.
    """
    robot = simulation.robot
    positions: Array = simulation.state.positions.copy()
    for index, name in enumerate(simulation.joint_names):
        number = robot.joint_numbers[name]
        joint = robot.joints[number]
        lower = joint.limits.lower
        upper = joint.limits.upper
        if positions[index] or lower <= 0 <= upper or lower > upper or number in robot.joints_in_loops or joint.spring:
            continue
        middle = (lower + upper) / 2
        if np.isfinite(middle):
            positions[index] = middle
        else:
            positions[index] = lower if lower > 0 else upper
    return positions


def joint_limit_warnings(simulation: Simulation) -> Iterator[str]:
    """Yield a sentence for each joint that is beyond the limits of its description."""
    for name, position in zip(simulation.joint_names, simulation.state.positions, strict=True):
        limits = simulation.robot.joints[simulation.robot.joint_numbers[name]].limits
        if not limits.lower <= position <= limits.upper:
            yield (
                f"joint {name!r} starts at {position:.6g}, its limits are {limits.lower:.6g} and {limits.upper:.6g}: "
                "set initial.joints and initial.positions. The simulation does not enforce limits"
            )


def _require_same_length(name: str, values: Sized, other_name: str, names: Sized) -> None:
    if len(values) != len(names):
        raise InvalidInputError(
            f"parameter {name} has {len(values)} values and {other_name} {len(names)}: one for each is needed"
        )
