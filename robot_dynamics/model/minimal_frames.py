"""Link frames that give the MDH table the fewest numbers (Khalil, section 2.1).

The axis z_j is fixed by joint j. The direction of x_j about it and the origin along it are free; neither changes the
sign or the zero of the joint variable. Here x_j lies along the common normal of z_j and the axis of the first joint on
link j: that joint then has neither γ nor b. Where freedom remains, θ_j or r_j becomes zero.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.loop import LoopEnd
from robot_dynamics.model.mdh import NEARLY_PARALLEL, ROUNDING, MDHParameters, mdh_from_placement, placement_from_mdh
from robot_dynamics.model.placement import invert_placement, placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.loop import Loop
    from robot_dynamics.model.robot import Robot


def minimal_frames(robot: Robot, keep_origins_at_rest: bool = False) -> Robot:
    """Return the same robot in the link frames with the fewest MDH parameters.

    The first link on every link but the base has γ = b = 0, where the axes of the two are parallel or clearly not.
    Joint variables, inertias, reactions, loops and named frames keep their meaning; only the joint placements and the
    numbers of the inertias change with the frames.

    keep_origins_at_rest: on a fixed base, whether the origin of a frame is a point at rest where its joint axis has
    one, as the centre of a shoulder; it then need not lie on the common normal.
    """
    # the first joint on each link
    successors = {joint.antecedent: joint for joint in reversed(robot.joints)}
    changes: list[ScalarArray] = [np.eye(4)]  # placement of the new frame j in the old one; frame 0 stays
    joints = []
    links = [robot.links[0]]
    at_rest = [keep_origins_at_rest and not robot.moving_base] + [False] * len(robot.joints)
    for number, (joint, link) in enumerate(zip(robot.joints, robot.links[1:], strict=True), start=1):
        pose = invert_placement(changes[joint.antecedent]) @ joint.placement
        angle, distance = _choose_frame(pose, successors.get(number))
        if at_rest[joint.antecedent] and not joint.prismatic:
            distance_to_origin = _distance_to_origin(pose) if joint.antecedent > 0 else distance
            at_rest[number] = distance_to_origin is not None
            distance = distance if distance_to_origin is None else distance_to_origin
        change = _screw_along_z(angle, distance)
        changes.append(change)
        joints.append(replace(joint, placement=_without_rounding(pose @ change)))
        links.append(link.transformed_by(invert_placement(change)))
    inverses = [invert_placement(change) for change in changes]
    frames = [replace(frame, placement=inverses[frame.link] @ frame.placement) for frame in robot.frames]
    cut = cut_joints(robot)
    loops = [_transform_loop(loop, number in cut, changes, inverses) for number, loop in enumerate(robot.loops)]
    return replace(robot, joints=tuple(joints), links=tuple(links), frames=tuple(frames), loops=tuple(loops))


def _transform_loop(loop: Loop, has_cut_joint: bool, changes: list[ScalarArray], inverses: list[Array]) -> Loop:
    """Return a loop in the new frames; frame k of a cut joint is that of its link, and frame k+B changes with it."""
    if not has_cut_joint:
        return loop.with_placements(lambda end: inverses[end.link] @ end.placement)
    cut_link = loop.moved.link
    closing_link, closing_frame = loop.closed_on
    return replace(
        loop,
        moved=LoopEnd(cut_link, np.eye(4)),
        closed_on=LoopEnd(closing_link, inverses[closing_link] @ closing_frame @ changes[cut_link]),
    )


def _choose_frame(pose: ScalarArray, successor: Joint | None) -> tuple[float, float]:
    """Return (angle, distance) by which frame j is to turn about and move along z_j.

    pose: iTj (4, 4) of the old frame j. successor: the joint whose axis x_j is to meet, None at the end of a branch.
    """
    last = mdh_from_placement(pose)[-1]
    zero_theta, zero_r = -last.theta, -last.r  # these make θ_j or r_j zero
    if successor is None:
        return zero_theta, zero_r
    axis, point = successor.placement[:3, 2], successor.placement[:3, 3]
    sine = math.hypot(axis[0], axis[1])
    if sine >= NEARLY_PARALLEL:
        direction = axis[:2] / sine
        distance = point[2] - (point[:2] @ direction) / sine * axis[2]
        return _nearest_normal(math.atan2(direction[0], -direction[1]), zero_theta), distance
    if math.hypot(point[0], point[1]) > ROUNDING:
        return _nearest_normal(math.atan2(point[1], point[0]), zero_theta), zero_r
    return zero_theta, zero_r


def _distance_to_origin(pose: ScalarArray) -> float | None:
    """Return the distance along z_j from O_j to O_i, None where the axis does not pass through O_i.

    pose: iTj (4, 4).
    """
    axis, point = pose[:3, 2], pose[:3, 3]
    distance = -float(axis @ point)
    return distance if np.abs(point + distance * axis).max() < ROUNDING else None


def _nearest_normal(angle: float, preferred: float) -> float:
    """Return the angle of a normal or of its opposite, whichever is nearer to the preferred angle [rad]."""
    return angle if math.cos(angle - preferred) > -ROUNDING else angle + math.pi


def _screw_along_z(angle: float, distance: float) -> Array:
    """Return the placement (4, 4) that turns about z and moves along it."""
    return placement_from_mdh(MDHParameters(theta=angle, r=distance))


def _without_rounding(matrix: ScalarArray) -> Array:
    """Return a placement (4, 4) with rounding errors replaced by zero."""
    cleaned = placement()
    for row in mdh_from_placement(matrix):
        cleaned = cleaned @ placement_from_mdh(row)
    return cleaned


def snap_angles(robot: Robot, tolerance: float) -> Robot:
    """Return the robot with the intended directions of its axes: URDFs write 1.5708 for π/2.

    Angles of a placement within `tolerance` [rad] of a multiple of 15° become that multiple: the angle between the two
    axes, and the angles about each of them. Positions stay.
    """
    joints = [replace(joint, placement=_snap_rotation(joint.placement, tolerance)) for joint in robot.joints]
    frames = [replace(frame, placement=_snap_rotation(frame.placement, tolerance)) for frame in robot.frames]
    loops = [loop.with_placements(lambda end: _snap_rotation(end.placement, tolerance)) for loop in robot.loops]
    return replace(robot, joints=tuple(joints), frames=tuple(frames), loops=tuple(loops))


def _snap_rotation(matrix: ScalarArray, tolerance: float) -> Array:
    """Return a placement (4, 4) whose rotation has snapped angles."""

    def snap(angle: float) -> float:
        """Return the multiple of 15° within the tolerance of an angle, else the angle [rad]."""
        nearest = round(angle / (math.pi / 12)) * (math.pi / 12)
        return nearest if abs(angle - nearest) <= tolerance else angle

    row = mdh_from_placement(placement(matrix[:3, :3]))[0]
    alpha = snap(row.alpha)
    if alpha == 0 or abs(alpha) == math.pi:  # γ and θ turn about the same line: only their sum has a meaning
        snapped = MDHParameters(alpha=alpha, theta=snap(row.theta + (row.gamma if alpha == 0 else -row.gamma)))
    else:
        snapped = MDHParameters(gamma=snap(row.gamma), alpha=alpha, theta=snap(row.theta))
    return placement(placement_from_mdh(snapped)[:3, :3], matrix[:3, 3])
