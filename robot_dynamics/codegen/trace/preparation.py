"""Equivalent descriptions of a robot from which the recursions trace the smallest programs."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.codegen.trace.parameter_grouping import group_inertial_parameters
from robot_dynamics.model.mdh import MDHParameters, cosine_sine, mdh_from_placement, placement_from_mdh
from robot_dynamics.model.minimal_frames import minimal_frames

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot


def prepare_robot(
    robot: Robot, group_parameters: bool = True, reoriented_joints: Collection[int] = ()
) -> tuple[Robot, Array]:
    """The robot whose recursions leave the smallest program, with the same efforts and accelerations.

    Its frames have the fewest numbers that are not zero. Constant angles about z_j are added to the joint variable,
    except right angles, whose sines and cosines are known.

    Parameters
    ----------
    robot : Robot
    group_parameters : bool
        Whether inertial parameters are grouped into base parameters.
    reoriented_joints : collection of int
        See `group_inertial_parameters`.

    Returns
    -------
    robot : Robot
        The prepared robot, without platforms: the recursions treat their links as any others.
    shifts : (n,)
        Added to the positions q of the original robot to give those of the prepared one [rad].
    """
    robot = replace(robot, platforms=()) if robot.platforms else robot
    robot = minimal_frames(robot, keep_origins_at_rest=True)
    if group_parameters:
        robot = group_inertial_parameters(robot, reoriented_joints)
    shifts, joints = np.zeros(len(robot.joints)), []
    for number, joint in enumerate(robot.joints):
        theta = mdh_from_placement(joint.placement)[-1].theta
        if not joint.prismatic and 0.0 not in cosine_sine(theta):
            shifts[number] = theta
            joint = replace(joint, placement=joint.placement @ placement_from_mdh(MDHParameters(theta=-theta)))
        joints.append(joint)
    return replace(robot, joints=tuple(joints)), shifts
