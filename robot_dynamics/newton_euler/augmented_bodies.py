"""Augmented bodies: links with the constant parts of others that move with them (Renaud; Khalil and Kleinfinger).

The points of a joint axis belong to both links of the joint. Masses at them can therefore be moved from the link to its
antecedent, and back: the joint efforts stay the same. Here

1. what a revolute link j can have on its axis moves to the antecedent i: the mass M, the first moment MZ, and the part
   of the second moments that leaves XX + YY = ZZ. Where this would give link i its first second moments, or link j has
   few, the part is one that leaves YY = 0;
2. a point mass at O_j moves back from link i to link j where that makes a first moment of link i zero.

Renaud's augmented body of link i is link i with the masses of the subtrees of its revolute joints at their origins:
step 1 for masses alone.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.inertia import Inertia

if TYPE_CHECKING:
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

MIN_RELATIVE_LEVER = 0.1
"""Least component of iPj for a point mass in step 2, relative to the largest component of all joints; shorter levers
need masses so large that digits are lost."""


class AugmentedBodies(NamedTuple):
    """Augmented bodies by link number.

    Attributes
    ----------
    inertias : list of Inertia
        About O_j, without the point mass.
    is_flat : list of bool
        Whether XX + YY = ZZ.
    point_masses : list of float
        Mass at O_j that is on link j, besides its inertia.
    """

    inertias: list[Inertia]
    is_flat: list[bool]
    point_masses: list[float]


def augmented_bodies(robot: Robot, with_point_masses: bool) -> AugmentedBodies:
    """The constant AugmentedBodies of a robot."""
    inertias = [link.inertia for link in robot.links]
    is_flat = [False] * len(inertias)
    point_masses = [0.0] * len(inertias)
    min_lever = _min_lever(robot) if with_point_masses else np.inf
    transmits_force = _links_that_transmit_forces(robot)
    has_force = [False] * len(inertias)
    for number in range(len(robot.joints), 0, -1):
        joint = robot.joints[number - 1]
        i = joint.antecedent
        for successor, next_joint in enumerate(robot.joints[number:], start=number + 1):
            if next_joint.antecedent == number and transmits_force[number] and has_force[successor]:
                inertias[number], point_masses[successor] = _move_point_mass(inertias[number], next_joint, min_lever)
        if not joint.prismatic:
            moved = Inertia(inertias[number].mass)
            if has_constant_orientation(joint):
                has_body = i == 0 or any(map(is_not_zero, inertias[i].second_moments.ravel()))
                is_flat[number] = has_body and _is_better_flat(inertias[number])
                moved = _part_on_axis(inertias[number], is_flat[number])
            inertias[number] = _subtract(inertias[number], moved)
            inertias[i] += moved.transformed_by(joint.placement)
        has_force[number] |= joint.prismatic or any(map(is_not_zero, inertias[number].first_moments))
        has_force[i] |= has_force[number]
    return AugmentedBodies(inertias, is_flat, point_masses)


def has_constant_orientation(joint: Joint) -> bool:
    """Whether the orientation of a joint in its antecedent is a matrix of numbers, the same for all samples."""
    return joint.rotation.ndim == 2 and not any(map(_is_symbol, joint.rotation.ravel()))


def is_not_zero(value: object) -> bool:
    """Whether a number is not zero; symbols count as not zero unless they are known to be zero."""
    return not getattr(value, "is_zero", False) if _is_symbol(value) else bool(value != 0)


def _is_symbol(value: object) -> bool:
    return not isinstance(value, int | float | np.number)


def _is_better_flat(inertia: Inertia) -> bool:
    """Whether the moment of a link takes fewer operations with XX + YY = ZZ than with YY = 0.

    Products of inertia take the same number of operations in both. The sums B21 and B20 that only the first form reads
    are other terms of the wrench already where XY, or MY and MX, are not zero.
    """
    J = inertia.second_moments
    reads_B21, reads_B20 = (
        any(map(is_not_zero, (J[0, 1], first_moment))) for first_moment in inertia.first_moments[[1, 0]]
    )
    XX = is_not_zero(J[0, 0] - J[1, 1])
    ZZ = is_not_zero(J[2, 2])
    difference = is_not_zero(J[0, 0] - J[1, 1] - J[2, 2])  # twice -YY where flat
    total = is_not_zero(J[0, 0] - J[1, 1] + J[2, 2])  # twice XX where flat
    sums = 2 * (XX and ZZ)
    operations = 2 * (XX + ZZ) + difference + sums
    flat_operations = total * (3 - reads_B21) + difference * (4 - 2 * reads_B20) + (total and difference)
    return flat_operations < operations


def _part_on_axis(inertia: Inertia, leave_flat: bool) -> Inertia:
    """The part of an inertia with M, MZ and equal second moments about x and y, that may be on the axis z.

    leave_flat: whether XX + YY = ZZ of the remaining part, else YY = 0.
    """
    J = inertia.second_moments
    moment = (J[0, 0] + J[1, 1] - J[2, 2]) / 2 if leave_flat else J[1, 1]
    zero = 0 * moment
    first = np.array([zero, zero, inertia.first_moments[2]])
    return Inertia(inertia.mass, first, np.array([[moment, zero, zero], [zero, moment, zero], [zero, zero, zero]]))


def _subtract(inertia: Inertia, part: Inertia) -> Inertia:
    """A body without a part of it; equal entries leave zero exactly."""
    return Inertia(
        inertia.mass - part.mass,
        inertia.first_moments - part.first_moments,
        inertia.second_moments - part.second_moments,
    )


def _links_that_transmit_forces(robot: Robot) -> list[bool]:
    """For each link whether its force has an effect on a joint between it and a fixed base, or on a moving base."""
    transmits = [robot.moving_base]
    for joint in robot.joints:
        has_lever = joint.antecedent > 0 and any(map(is_not_zero, joint.placement[:3, 3]))
        transmits.append(has_lever or joint.prismatic or transmits[joint.antecedent])
    return transmits


def _min_lever(robot: Robot) -> float:
    """Least component of iPj that is a lever in step 2; infinite where the numbers have symbols."""
    components = [component for joint in robot.joints for component in joint.placement[:3, 3]]
    inertias = [link.inertia for link in robot.links]
    if any(map(_is_symbol, components)) or any(inertia.has_symbols for inertia in inertias):
        return np.inf
    return MIN_RELATIVE_LEVER * max(map(abs, components), default=0.0)


def _move_point_mass(inertia: Inertia, joint: Joint, min_lever: float) -> tuple[Inertia, float]:
    """The inertia of a link without the mass at O_j, of a joint on it, that makes a first moment zero, and this mass.

    The mass is 0 where no first moment becomes zero, or another one would become different from zero.
    """
    P = joint.placement[:3, 3]
    axis = int(np.argmax(np.abs(P))) if np.isfinite(min_lever) else 0
    is_lever = not joint.prismatic and np.isfinite(min_lever) and abs(P[axis]) >= min_lever > 0
    if not is_lever or np.any((inertia.first_moments == 0) & (P != 0)):
        return inertia, 0.0
    mass = float(inertia.first_moments[axis] / P[axis])
    remaining = _subtract(inertia, Inertia(mass).transformed_by(joint.placement))
    first = remaining.first_moments.copy()
    first[axis] = 0.0
    return Inertia(remaining.mass, first, remaining.second_moments), mass
