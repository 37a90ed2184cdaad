"""Units and frames in which a program computes forces, where no input or output depends on them.

The unit of length is the most frequent length of the robot. Torques keep their unit, so the unit of force is its
inverse. This needs no operations where only revolute joints move and the base is fixed: then no length or force is an
input or an output.

The x axis of the last link of a branch may have any direction about the joint axis: it is the one that makes an
inertial parameter of this link zero.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.placement import placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot

RELATIVE_ROUNDING = 1e-12
"""Relative difference of lengths that count as equal."""


class ForceFrames(NamedTuple):
    """A robot in the units and frames in which a program computes forces.

    Attributes
    ----------
    robot : Robot
        With the same torques as the original robot. Its named frames and loops are left as they are.
    shifts : (n,)
        Added to the positions q of the original robot to give those of `robot` [rad].
    length_unit : float
        [m]
    """

    robot: Robot
    shifts: Array
    length_unit: float


def choose_force_frames(robot: Robot, has_wrenches: bool) -> ForceFrames:
    """The ForceFrames of a robot; its own frames and metres where external wrenches are inputs."""
    if has_wrenches:
        return ForceFrames(robot, np.zeros(len(robot.joints)), 1.0)
    unit = program_length_unit(robot)
    shifts = np.zeros(len(robot.joints))
    if not robot.loops:
        robot, shifts = turn_last_frames(robot)
    return ForceFrames(with_length_unit(robot, unit) if unit != 1 else robot, shifts, unit)


def program_length_unit(robot: Robot) -> float:
    """The length [m] that is the unit of a program: 1 where a length or a force may be an input or an output."""
    if robot.moving_base or any(joint.prismatic for joint in robot.joints):
        return 1.0
    lengths = [
        abs(float(component))
        for joint in robot.joints
        if joint.antecedent > 0
        for component in joint.placement[:3, 3]
        if component != 0
    ]
    occurrences = Counter(_first_equal(length, lengths) for length in lengths)
    return max(occurrences, key=occurrences.__getitem__, default=1.0)


def _first_equal(length: float, lengths: list[float]) -> float:
    return next(candidate for candidate in lengths if abs(candidate - length) <= RELATIVE_ROUNDING * length)


def with_length_unit(robot: Robot, unit: float) -> Robot:
    """The robot with lengths in a unit [m] and torques in N m; its frames and loops are left as they are.

    A length that differs from the unit by rounding becomes 1.
    """
    joints = []
    for joint in robot.joints:
        P = joint.placement[:3, 3] / unit
        rounded = P.round()
        is_integer = abs(P - rounded) <= RELATIVE_ROUNDING
        P[is_integer] = rounded[is_integer]
        joints.append(replace(joint, placement=placement(joint.placement[:3, :3], P)))
    links = []
    for link in robot.links:
        body = link.inertia
        scaled = Inertia(body.mass * unit**2, body.first_moments * unit, body.second_moments)
        links.append(replace(link, inertia=scaled))
    return replace(robot, joints=tuple(joints), links=tuple(links), gravity=robot.gravity / unit)


def turn_last_frames(robot: Robot) -> tuple[Robot, Array]:
    """The robot with fewer inertial parameters of the last links, by other directions of their x axes.

    Parameters
    ----------
    robot : Robot
        Without loops.

    Returns
    -------
    robot : Robot
        Its named frames are left as they are.
    shifts : (n,)
        Added to the positions q of the original robot to give those of the result [rad].
    """
    shifts = np.zeros(len(robot.joints))
    links = list(robot.links)
    antecedents = {joint.antecedent for joint in robot.joints}
    for number, joint in enumerate(robot.joints, start=1):
        angle = 0.0 if number in antecedents or joint.prismatic else _best_direction(links[number].inertia)
        if angle:
            shifts[number - 1] = angle  # a turn about z_j after the joint: its placement at position zero stays
            links[number] = replace(links[number], inertia=_turned(links[number].inertia, angle))
    return replace(robot, links=tuple(links)) if shifts.any() else robot, shifts


def _best_direction(inertia: Inertia) -> float:
    """The angle about z of an x axis along which an inertial parameter is zero [rad]; 0 if the given axis is as good.

    The parameter is MY; YZ where MX = MY = 0; XY where XZ = YZ = 0 as well. It is 0 where the numbers are symbols.
    """
    if inertia.has_symbols:
        return 0.0
    J = inertia.second_moments
    for x, y in (inertia.first_moments[:2], J[:2, 2]):
        if x != 0 or y != 0:
            return math.atan2(y, x) if x != 0 and y != 0 else 0.0
    return 0.5 * math.atan2(2 * J[0, 1], J[0, 0] - J[1, 1]) if J[0, 1] != 0 else 0.0


def _turned(inertia: Inertia, angle: float) -> Inertia:
    """An inertia in axes that are turned about z by the angle of `_best_direction`; the parameter is exactly zero."""
    turned = inertia.transformed_by(placement_from_mdh(MDHParameters(theta=-angle)))
    first = turned.first_moments
    J = turned.second_moments
    if inertia.first_moments[:2].any():
        first[1] = 0.0
    elif inertia.second_moments[:2, 2].any():
        J[1, 2] = J[2, 1] = 0.0
    else:
        J[0, 1] = J[1, 0] = 0.0
    return Inertia(inertia.mass, first, J)
