"""The model of a robot as control laws in C++ take it: programs of the laws, and a table of the joints and loops."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.emit.control_model import ControlLoops, ControlModel, ControlSpring, StateJoint
from robot_dynamics.codegen.jit.compiled_models import MODELS
from robot_dynamics.constraints.topology import build_topology
from robot_dynamics.control.law_models import separate_friction
from robot_dynamics.control.series_elastic_actuators import find_series_elastic_actuators
from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.version import package_version

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.codegen.trace.program import Program
    from robot_dynamics.control.series_elastic_actuators import SeriesElasticActuators
    from robot_dynamics.model.robot import Robot

MOVES_NO_LOOP, MOVES_LOOPS, MOVES_LOOPS_PERIODICALLY = range(3)
"""How a joint of the state moves loops, as in model_abi.h."""


def export_control_model(robot: Robot, payload_frame: str | None = None) -> ControlModel:
    """Trace the models of the control laws of a robot.

    Parameters
    ----------
    robot : Robot
    payload_frame : str, optional
        Frame that carries a payload, whose inertia the laws take as an argument.

    Returns
    -------
    ControlModel

    Raises
    ------
    InvalidInputError
        No joint has a motor, a robot with loops has a spring behind a motor, a spring cannot be compensated, or a
        number of the description is open.
    """
    dynamics = Dynamics(robot)
    actuated = [name for name in dynamics.joint_names if name not in dynamics.unactuated_joint_names]
    if not actuated:
        raise InvalidInputError(f"{robot.name!r} has no actuated joint: there is nothing to control")
    actuators = find_series_elastic_actuators(dynamics, actuated)
    if len(actuators.springs) and robot.loops:
        springs = ", ".join(dynamics.joint_names[index] for index in actuators.springs)
        raise InvalidInputError(
            f"{robot.name!r} has closed loops, and motors that drive their links through springs ({springs}): the "
            "control laws in C++ take one of both. Use the node computed_torque, or describe the joints without springs"
        )
    inverse_robot, friction_robot = separate_friction(dynamics, actuators)
    if payload_frame is None:
        inverse = MODELS["inverse"](inverse_robot)
    else:
        if robot.frame(payload_frame).link == 0:
            raise InvalidInputError(f"payload on {payload_frame}: it is fixed to the base, and no joint carries it")
        inverse = MODELS["inverse"](inverse_robot, payloads=[payload_frame])
    has_friction = any(joint.has_friction for joint in friction_robot.joints)
    friction = MODELS["friction"](friction_robot) if has_friction else None
    model = ControlModel(
        robot=robot.name,
        generator=f"robot_dynamics {package_version()}",
        joints=state_joints(dynamics),
        inverse=inverse,
        friction=friction,
        loops=_control_loops(robot, dynamics) if robot.loops else None,
        springs=_control_springs(dynamics, actuated, actuators),
        springs_are_decoupled=actuators.is_decoupled,
        gravity=np.asarray(robot.gravity, dtype=float),
        payload_frame=payload_frame,
        moving_base=robot.moving_base,
    )
    _refuse_parameters(robot, model.programs)
    return model


def state_joints(dynamics: Dynamics) -> list[StateJoint]:
    """Names, limits and kinds of the joints of the state of a robot, Dynamics.joint_names."""
    robot = dynamics.robot
    joints = []
    for name in dynamics.joint_names:
        joint = robot.joints[robot.joint_numbers[name]]
        limits = joint.limits
        joints.append(
            StateJoint(
                name=name,
                lower=limits.lower,
                upper=limits.upper,
                velocity=limits.velocity,
                effort=limits.effort,
                load_friction=joint.load_friction,
                actuated=joint.actuated,
                prismatic=joint.prismatic,
            )
        )
    return joints


def _control_springs(
    dynamics: Dynamics, actuated: Sequence[str], actuators: SeriesElasticActuators
) -> list[ControlSpring]:
    """The springs behind motors; motors of `actuators` count among the actuated joints."""
    springs = []
    numbers = zip(actuators.stiffness, actuators.rest, actuators.damping, strict=True)
    for motor, joint, values in zip(actuators.motors, actuators.springs, numbers, strict=True):
        motor_joint = dynamics.joint_names.index(actuated[motor])
        springs.append(ControlSpring(motor_joint, int(joint), *map(float, values)))
    return springs


def _control_loops(robot: Robot, dynamics: Dynamics) -> ControlLoops:
    topology = build_topology(robot)
    variable_of = {number: variable for variable, number in enumerate(topology.non_mimic_joints)}
    motion = []
    for moved, is_periodic in zip(topology.loop_joints_moved, topology.is_periodic, strict=True):
        in_loops = MOVES_LOOPS_PERIODICALLY if is_periodic else MOVES_LOOPS
        motion.append(in_loops if moved.any() else MOVES_NO_LOOP)
    positions = [
        (name, variable_of[leader], float(multiplier), float(offset))
        for name, (leader, multiplier, offset) in zip(dynamics.all_joint_names, robot.mimic_relations, strict=True)
    ]
    return ControlLoops(
        closure=MODELS["closure"](robot),
        independent=[int(column) for column in topology.independent_columns],
        dependent=[int(column) for column in topology.dependent_columns],
        units=topology.column_units,
        reference=topology.reference_positions,
        motion=motion,
        attitudes=[attitude.columns for attitude in topology.dependent_attitudes],
        positions=positions,
    )


def _refuse_parameters(robot: Robot, programs: list[Program]) -> None:
    for program in programs:
        if program.parameters:
            names = ", ".join(program.parameters)
            raise InvalidInputError(f"{robot.name!r} has numbers without a value ({names}): set them")
