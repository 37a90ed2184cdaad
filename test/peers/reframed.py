"""The same parallel robot, with the pose of the platform expressed between other frames."""

from dataclasses import replace

import numpy as np

from robot_dynamics import Dynamics
from robot_dynamics.model.placement import invert_placement
from robot_dynamics.model.platform import PLATFORM_FRAME, make_coordinate_joints
from robot_dynamics.model.robot import Frame
from robot_dynamics.parallel.platform_dynamics import coordinates_from_pose

STAND = "stand"


def reframed(robot, stand, own, free):
    """Return a Robot with the same bodies and legs as a robot with one platform.

    stand: (4, 4) frame on link 0, the reference of the pose; own: (4, 4) new own frame of the platform in the old one;
    free: the free coordinates of the new pose.
    """
    (platform,) = robot.platforms
    name, link, first = robot.links[platform.link].name, platform.link, platform.joints[0] + 1
    dynamics = Dynamics(robot, compiled=False)
    home = invert_placement(stand) @ dynamics.link_pose(name, dynamics.initial_joint_positions) @ own
    joints, links = list(robot.joints), list(robot.links)
    start = coordinates_from_pose(home)
    joints[first - 1 : first + 5] = make_coordinate_joints(name, first, start, (0, stand))
    moved = (
        PLATFORM_FRAME @ invert_placement(own) @ invert_placement(PLATFORM_FRAME)
    )  # the old link frame in the new one
    links[link] = replace(links[link], inertia=links[link].inertia.transformed_by(moved))
    for number, joint in enumerate(joints):
        if joint.antecedent == link:
            joints[number] = replace(joint, placement=moved @ joint.placement)

    def ends(end):
        return moved @ end.placement if end.link == link else end.placement

    frames = [
        replace(frame, placement=moved @ frame.placement) if frame.link == link else frame
        for frame in robot.frames
        if frame.name != name
    ]
    frames += [Frame(name, link, PLATFORM_FRAME), Frame(STAND, 0, stand)]
    positions = dict(zip((joint.name for joint in robot.joints), dynamics.initial_joint_positions, strict=True))
    joints = [
        replace(joint, initial_position=float(positions.get(joint.name, joint.initial_position)))
        if not first - 1 <= number < first + 5
        else joint
        for number, joint in enumerate(joints)
    ]
    return replace(
        robot,
        links=tuple(links),
        joints=tuple(joints),
        frames=tuple(frames),
        loops=tuple(loop.with_placements(ends) for loop in robot.loops),
        platforms=(replace(platform, free=free, base=STAND),),
    )


def pose_between(pose, stand, own):
    """Return the poses (..., 4, 4) of the new robot's platform, from those of the old one."""
    return invert_placement(stand) @ pose @ own


def screw_of(screws, own):
    """Return twists or accelerations (..., 6) of the new own frame, from those of the old one; `own` is a rotation."""
    R = own[:3, :3]
    return np.concatenate([screws[..., :3] @ R, screws[..., 3:] @ R], axis=-1)
