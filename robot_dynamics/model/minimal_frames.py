"""Frames chosen anew so that the MDH table has the fewest numbers (Khalil, section 2.1), the robot staying the same.

Of frame j only z_j is given. About it x_j is free, and along it the origin; the joint variable keeps sign and zero,
whatever is chosen. So x_j is laid along the common normal of z_j and the axis of the first link that hangs on link j:
that link then needs neither γ nor b. Where this leaves a choice, θ_j or r_j becomes zero.
"""

import math
from dataclasses import replace

import numpy as np

from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.loop import LoopEnd
from robot_dynamics.model.mdh import NEARLY_PARALLEL, ROUNDING, MDHParameters, mdh_from_placement, placement_from_mdh
from robot_dynamics.model.placement import invert_placement, placement


def minimal_frames(robot):
    """The same robot in frames with γ = b = 0 for the first link on every link but the base, where the axes of the two
    are parallel or clearly not.

    Joint variables, inertias, reactions, loops and the named frames stay what and where they are; joint placements and
    the inertias' numbers change with the frames.
    """
    followers = {joint.antecedent: joint for joint in reversed(robot.joints)}  # the first that hangs on each link
    changes = [np.eye(4)]  # how the new frame j stands in the old one; frame 0 stays
    joints, links = [], [robot.links[0]]
    for number, (joint, link) in enumerate(zip(robot.joints, robot.links[1:], strict=True), start=1):
        placed = invert_placement(changes[joint.antecedent]) @ joint.placement
        change = _along_z(*_choice(placed, followers.get(number)))
        changes.append(change)
        joints.append(replace(joint, placement=_tidy(placed @ change)))
        links.append(link.transformed_by(invert_placement(change)))
    back = [invert_placement(change) for change in changes]
    frames = [replace(frame, placement=back[frame.link] @ frame.placement) for frame in robot.frames]
    cut = cut_joints(robot)
    loops = [_loop(loop, number in cut, changes, back) for number, loop in enumerate(robot.loops)]
    return replace(robot, joints=tuple(joints), links=tuple(links), frames=tuple(frames), loops=tuple(loops))


def _loop(loop, cut, changes, back):
    """The loop between the new frames. Where a joint is cut frame k is that of its link, and frame k+B goes with it."""
    if not cut:
        return loop.with_placements(lambda end: back[end.link] @ end.placement)
    (link, _), (other, closed_on) = loop.ends
    return replace(
        loop, moved=LoopEnd(link, np.eye(4)), closed_on=LoopEnd(other, back[other] @ closed_on @ changes[link])
    )


def _choice(placed, follower):
    """(angle, distance) by which frame j is to be turned about and moved along z_j.

    placed: iTj with the old frame j; follower: the joint whose axis x_j is to meet, None at the end of a branch.
    """
    last = mdh_from_placement(placed)[-1]
    straight, back = -last.theta, -last.r  # these would make θ_j or r_j zero
    if follower is None:
        return straight, back
    axis, point = follower.placement[:3, 2], follower.placement[:3, 3]
    sine = math.hypot(axis[0], axis[1])
    if sine >= NEARLY_PARALLEL:
        toward = axis[:2] / sine
        distance = point[2] - (point[:2] @ toward) / sine * axis[2]
        return _nearest(math.atan2(toward[0], -toward[1]), straight), distance
    if math.hypot(point[0], point[1]) > ROUNDING:
        return _nearest(math.atan2(point[1], point[0]), straight), back
    return straight, back


def _nearest(angle, wanted):
    """The angle, or its opposite, whichever is nearer to the one that is wanted: a normal has two directions."""
    return angle if math.cos(angle - wanted) > -ROUNDING else angle + math.pi


def _along_z(angle, distance):
    return placement_from_mdh(MDHParameters(theta=angle, r=distance))


def _tidy(matrix):
    """The placement with what is rounding made zero."""
    tidied = placement()
    for row in mdh_from_placement(matrix):
        tidied = tidied @ placement_from_mdh(row)
    return tidied


def snap_angles(robot, tolerance):
    """The robot with its axes where they were meant: URDFs write 1.5708 for π/2.

    Of each placement in an antecedent, angles that are within `tolerance` [rad] of a multiple of 15° become that
    multiple: between the two axes, and about each of them. Positions stay as they are.
    """
    joints = [replace(joint, placement=_snapped(joint.placement, tolerance)) for joint in robot.joints]
    frames = [replace(frame, placement=_snapped(frame.placement, tolerance)) for frame in robot.frames]
    loops = [loop.with_placements(lambda end: _snapped(end.placement, tolerance)) for loop in robot.loops]
    return replace(robot, joints=tuple(joints), frames=tuple(frames), loops=tuple(loops))


def _snapped(matrix, tolerance):
    def snap(angle):
        nearest = round(angle / (math.pi / 12)) * (math.pi / 12)
        return nearest if abs(angle - nearest) <= tolerance else angle

    row = mdh_from_placement(placement(matrix[:3, :3]))[0]
    alpha = snap(row.alpha)
    if alpha == 0 or abs(alpha) == math.pi:  # γ and θ turn about the same line: only what they come to has a meaning
        turn = MDHParameters(alpha=alpha, theta=snap(row.theta + (row.gamma if alpha == 0 else -row.gamma)))
    else:
        turn = MDHParameters(gamma=snap(row.gamma), alpha=alpha, theta=snap(row.theta))
    return placement(placement_from_mdh(turn)[:3, :3], matrix[:3, 3])
