"""Doubtful properties of a robot description: impossible inertias, suspicious limits, joints that move no inertia."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.joint import find_suspicious_limits

if TYPE_CHECKING:
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.robot import Robot

MASSLESS_WARNING = (
    "none of its moving links has a mass, so that weight and inertia are zero in all results: complete the "
    "description, or identify the masses from recordings (robot-dynamics identify)"
)


MAX_NAMES = 8  # in one warning


def find_warnings(robot: Robot) -> tuple[str, ...]:
    """Return sentences about inertias, joint limits, joints without inertia and platforms.

    Inertias are judged for whole links, with all bodies that are fixed to them.
    """
    warnings = _find_impossible_inertias(robot)
    for joint in robot.joints:
        warnings += find_suspicious_limits(joint)
    warnings += find_missing_inertials(robot)
    warnings += find_lock_warnings(robot)
    warnings += find_singular_joints(robot)
    joints_in_loops = [robot.joints_in_loop(loop) for loop in robot.loops] if robot.platforms else []
    for platform in robot.platforms:
        warnings += _find_missing_legs(robot, platform, joints_in_loops)
    return tuple(warnings)


def _find_impossible_inertias(robot: Robot) -> list[str]:
    """Return sentences about inertias that no physical body has.

    The inertia of a fixed base enters no equation and is not judged. For a link that turns about a fixed axis tables
    often give only the moment about this axis, which suffices.
    """
    first = 0 if robot.moving_base else 1
    known_by_moment = _links_known_by_moment(robot)
    warnings = [
        f"link {link.name!r}: {objection}"
        for number, link in enumerate(robot.links[first:], first)
        if number not in known_by_moment
        for objection in link.inertia.find_inconsistencies()
    ]
    if robot.moving_base and not any(link.inertia.mass for link in robot.links):
        warnings.append("the moving base and all that it carries have no mass, so no model has a solution")
    return warnings


def find_missing_inertials(robot: Robot) -> list[str]:
    """Return a sentence about the moving links that have a shape, but neither an inertia in the description nor a mass.

    Links without a shape are virtual, for example between the three joints of a wrist, and have no mass by intention.
    """
    first = 0 if robot.moving_base else 1
    names = [
        repr(link.name)
        for link in robot.links[first:]
        if link.lacks_inertial and not np.any(link.inertia.spatial) and not robot.is_massless
    ]
    if not names:
        return []
    shown = f"{', '.join(names[:MAX_NAMES])}{f' and {len(names) - MAX_NAMES} more' if len(names) > MAX_NAMES else ''}"
    if len(names) == 1:
        return [f"link {shown} has a shape and moves, but has no <inertial>: its mass is taken as 0"]
    return [f"links {shown} have shapes and move, but have no <inertial>: their masses are taken as 0"]


def _links_known_by_moment(robot: Robot) -> set[int]:
    """Return the numbers of links that turn about a fixed axis and have only a moment about it."""
    links_on_fixed_axes = set() if robot.moving_base else {0}
    known = set()
    for number, joint in enumerate(robot.joints, start=1):
        R, P = joint.placement[:3, :3], joint.placement[:3, 3]
        is_axis_fixed = joint.antecedent == 0 or not (np.any(R[:2, 2]) or np.any(P[:2]))
        if joint.antecedent in links_on_fixed_axes and is_axis_fixed and not joint.prismatic:
            links_on_fixed_axes.add(number)
            if robot.links[number].inertia.is_moment_about_z:
                known.add(number)
    return known


def find_singular_joints(robot: Robot) -> list[str]:
    """Return sentences about independent joints outside loops that move no inertia, one if this is true of all."""
    if robot.is_massless:
        return [MASSLESS_WARNING]
    return [
        f"link {robot.links[number + 1].name!r}: joint {robot.joints[number].name!r} moves nothing with inertia, so "
        "the direct model has no solution: complete the description, or lock the joint (option lock_massless)"
        for number in find_joints_without_inertia(robot)
    ]


def find_joints_without_inertia(robot: Robot) -> list[int]:
    """Return the numbers of the joints outside loops that mimic no other one and move no inertia."""
    moves_inertia = _joints_with_inertia(robot)
    return [
        number
        for number, (leader, _, _) in enumerate(robot.mimic_relations)
        if leader == number and not (moves_inertia[number] or number in robot.joints_in_loops)
    ]


def find_lock_warnings(robot: Robot) -> list[str]:
    """Return sentences about joints that are locked outside their limits, or because they move no inertia."""
    objections = (joint.find_objection() for joint in robot.locked_joints)
    return [objection for objection in objections if objection is not None]


def _joints_with_inertia(robot: Robot) -> list[bool]:
    """Return for each joint whether it, or a joint that mimics it, moves an inertia.

    At the end of a branch the inertia must be about the axis itself. Elsewhere any inertia counts, because its moment
    about the axis depends on the configuration.
    """
    leaves = set(range(1, len(robot.links))) - {joint.antecedent for joint in robot.joints}
    subtree_has_inertia = [bool(np.any(link.inertia.spatial)) for link in robot.links]
    moves_inertia = [False] * len(robot.joints)
    for number, joint in reversed(list(enumerate(robot.joints, start=1))):
        has_inertia = subtree_has_inertia[number]
        if number in leaves:
            diagonal = np.diagonal(robot.links[number].inertia.spatial)
            has_inertia = bool(diagonal[2 if joint.prismatic else 5] > 1e-12 * diagonal.max())
        moves_inertia[robot.mimic_relations[number - 1][0]] |= bool(has_inertia or joint.rotor_inertia > 0)
        subtree_has_inertia[joint.antecedent] |= subtree_has_inertia[number]
    return moves_inertia


def _find_missing_legs(robot: Robot, platform: Platform, joints_in_loops: Sequence[set[int]]) -> list[str]:
    """Return a sentence about a platform that fewer than two legs hold; joints_in_loops: those of each loop."""
    leg_count = sum(any(number in joints for number in platform.joints) for joints in joints_in_loops)
    if leg_count >= 2:
        return []
    legs = "no leg holds it" if leg_count == 0 else "only one leg holds it"
    return [f"platform {robot.links[platform.link].name!r}: {legs}, a parallel robot has at least two"]
