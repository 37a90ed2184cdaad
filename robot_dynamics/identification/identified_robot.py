"""The robot and the drives that the parameters of an identification model describe."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.identification.friction_terms import MAX_LOAD_FRICTION, STRIBECK_PARAMETER
from robot_dynamics.model.inertia import Inertia, symmetric_matrix
from robot_dynamics.newton_euler.regressor import JOINT_PARAMETERS, LINK_PARAMETERS
from robot_dynamics.recordings.drives import DRIVE_PARAMETERS

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.identification.identification_model import IdentificationModel
    from robot_dynamics.model.robot import Robot
    from robot_dynamics.recordings.drives import Drives


def identified_robot(model: IdentificationModel, values: dict[str, float]) -> Robot:
    """Return the robot of a model with other parameters; values: by the names of IdentificationModel.robot_names."""
    robot = model.dynamics.robot
    velocities = {
        model.dynamics.joint_names[term.joint]: term.velocity
        for term in model.terms
        if term.parameter == STRIBECK_PARAMETER
    }
    links = list(robot.links)
    for index, link in enumerate(links):
        if index == 0 and not robot.moving_base:
            continue
        entries = {key: values[f"{key}.{link.name}"] for key in LINK_PARAMETERS}
        first_moments = np.array([entries["MX"], entries["MY"], entries["MZ"]])
        second_moments = symmetric_matrix(*(entries[key] for key in LINK_PARAMETERS[:6]))
        links[index] = replace(link, inertia=Inertia(entries["M"], first_moments, second_moments))
    joints = []
    for joint in robot.joints:
        rotor_inertia, viscous, coulomb = (max(0.0, values[f"{key}.{joint.name}"]) for key in JOINT_PARAMETERS)
        stribeck = max(-coulomb, values.get(f"Fst.{joint.name}", 0.0))
        dry = coulomb + min(stribeck, 0.0)
        joints.append(
            replace(
                joint,
                rotor_inertia=rotor_inertia,
                viscous_friction=viscous,
                coulomb_friction=coulomb,
                viscous_asymmetry=min(max(values.get(f"Fva.{joint.name}", 0.0), -viscous), viscous),
                coulomb_asymmetry=min(max(values.get(f"Fsa.{joint.name}", 0.0), -dry), dry),
                stribeck_friction=stribeck,
                stribeck_velocity=velocities.get(joint.name, joint.stribeck_velocity),
                load_friction=min(max(values.get(f"mu.{joint.name}", 0.0), 0.0), MAX_LOAD_FRICTION),
            )
        )
    return replace(robot, links=tuple(links), joints=tuple(joints))


def identified_drives(model: IdentificationModel, values: Array) -> Drives:
    """Return the drives with the offsets and the losses of coupled motors among values (P,)."""
    b = model.robot_count
    n = len(model.dynamics.joint_names)
    losses = values[b + n :].reshape(-1, len(DRIVE_PARAMETERS)).tolist()
    coupling_parameters = {
        motor: tuple(motor_losses) for motor, motor_losses in zip(model.drives.coupling_ratios, losses, strict=True)
    }
    return replace(model.drives, effort_offsets=values[b : b + n].copy(), coupling_parameters=coupling_parameters)
