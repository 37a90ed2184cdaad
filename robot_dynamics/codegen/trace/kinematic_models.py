"""Kinematics of named frames, and centre of mass, momentum and energy of the robot, as straight-line programs.

Arguments are those of codegen.trace.models. Results have m columns for the twist of a moving base and the n independent
joints; vectors of the whole robot are in the axes of frame 0.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.model_trace import ModelTrace
from robot_dynamics.constraints.frame_motion import frame_bias_acceleration, frame_jacobian, frame_placement
from robot_dynamics.newton_euler import centroid

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.model.robot import Robot


def pose_model(robot: Robot, frame: str) -> Program:
    """q -> pose (4, 4) of a named frame in frame 0."""
    model = ModelTrace("pose", robot, ("q",), group_parameters=False, frames=(frame,))
    return model.program({"pose": frame_placement(model.robot, model.q, model.robot.frame(frame))})


def jacobian_model(robot: Robot, frame: str) -> Program:
    """q -> jacobian (6, m) of the twist of a named frame at its origin, in its own axes."""
    return _jacobian_model("jacobian", robot, frame, in_frame_axes=True)


def jacobian_in_base_axes_model(robot: Robot, frame: str) -> Program:
    """q -> jacobian (6, m) of the twist of a named frame at its origin, in the axes of frame 0."""
    return _jacobian_model("jacobian_in_base_axes", robot, frame, in_frame_axes=False)


def _jacobian_model(name: str, robot: Robot, frame: str, in_frame_axes: bool) -> Program:
    model = ModelTrace(name, robot, ("q",), group_parameters=False, frames=(frame,))
    J = frame_jacobian(model.constrained_state, model.robot.frame(frame), in_frame_axes)
    return model.program({"jacobian": J})


def bias_acceleration_model(robot: Robot, frame: str) -> Program:
    """q, qd (twist) -> acceleration (6,) of a named frame, in its axes, without those of joints and base."""
    return _bias_acceleration_model("bias_acceleration", robot, frame, in_frame_axes=True)


def bias_acceleration_in_base_axes_model(robot: Robot, frame: str) -> Program:
    """As `bias_acceleration_model`, in the axes of frame 0."""
    return _bias_acceleration_model("bias_acceleration_in_base_axes", robot, frame, in_frame_axes=False)


def _bias_acceleration_model(name: str, robot: Robot, frame: str, in_frame_axes: bool) -> Program:
    model = ModelTrace(name, robot, ("q", "qd"), group_parameters=False, frames=(frame,))
    acceleration = frame_bias_acceleration(
        model.constrained_state, model.robot.frame(frame), model.qd, _drift(model), model.twist[3:], in_frame_axes
    )
    return model.program({"acceleration": acceleration})


def centre_of_mass_model(robot: Robot) -> Program:
    """q -> centre_of_mass (3,) in frame 0."""
    model = ModelTrace("centre_of_mass", robot, ("q",), group_parameters=False)
    return model.program({"centre_of_mass": centroid.centre_of_mass(model.robot, model.q)})


def centroidal_momentum_matrix_model(robot: Robot) -> Program:
    """q -> matrix (6, m) of the momentum about the centre of mass."""
    model = ModelTrace("centroidal_momentum_matrix", robot, ("q",), group_parameters=False)
    matrix = centroid.centroidal_momentum_matrix(model.robot, model.q) @ model.projection_matrix
    return model.program({"centroidal_momentum_matrix": matrix})


def centroidal_momentum_bias_model(robot: Robot) -> Program:
    """q, qd (twist) -> derivative (6,) of the momentum about the centre of mass, without accelerations."""
    model = ModelTrace("centroidal_momentum_bias", robot, ("q", "qd"), group_parameters=False)
    bias = centroid.centroidal_momentum_bias(model.robot, model.q, model.qd, model.twist, _drift(model))
    return model.program({"centroidal_momentum_bias": bias})


def kinetic_energy_model(robot: Robot) -> Program:
    """q, qd (twist) -> kinetic_energy (1,) of bodies and rotors."""
    model = ModelTrace("kinetic_energy", robot, ("q", "qd"), group_parameters=False)
    energy = centroid.kinetic_energy(model.robot, model.q, model.qd, model.twist)
    return model.program({"kinetic_energy": energy})


def _drift(model: ModelTrace) -> ScalarArray:
    """Accelerations (all joints,) where those of the independent joints are zero."""
    return model.joint_accelerations(np.zeros(model.size, dtype=int))
