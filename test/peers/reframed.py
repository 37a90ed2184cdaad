"""The same parallel robot, of which the pose of the platform is told between other frames."""

from dataclasses import replace

import numpy as np

from robot_dynamics import Dynamics
from robot_dynamics.model.placement import invert_placement
from robot_dynamics.model.platform import PLATFORM_FRAME, make_coordinate_joints
from robot_dynamics.model.robot import Frame
from robot_dynamics.parallel.platform_dynamics import coordinates_from_pose

STAND = "stand"


def reframed(robot, stand, own, free):
    """A Robot with the same bodies and legs as a robot with one platform.

    stand: (4, 4) frame on link 0 in which the pose is told; own: (4, 4) the platform's new own frame in its old one;
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

    frames = [replace(frame, placement=moved @ frame.placement) if frame.link == link else frame
              for frame in robot.frames if frame.name != name]  # fmt: skip
    frames += [Frame(name, link, PLATFORM_FRAME), Frame(STAND, 0, stand)]
    positions = dict(zip((joint.name for joint in robot.joints), dynamics.initial_joint_positions, strict=True))
    joints = [replace(joint, initial_position=float(positions.get(joint.name, joint.initial_position)))
              if not first - 1 <= number < first + 5 else joint for number, joint in enumerate(joints)]  # fmt: skip
    return replace(robot, links=tuple(links), joints=tuple(joints), frames=tuple(frames),
                   loops=tuple(loop.with_placements(ends) for loop in robot.loops),
                   platforms=(replace(platform, free=free, base=STAND),))  # fmt: skip


def pose_between(pose, stand, own):
    """(..., 4, 4) of the new robot's platform, for poses of the old one's."""
    return invert_placement(stand) @ pose @ own


def screw_of(screws, own):
    """(..., 6) twists or accelerations of the new own frame, for those of the old one; `own` only turns."""
    R = own[:3, :3]
    return np.concatenate([screws[..., :3] @ R, screws[..., 3:] @ R], axis=-1)
