"""The first solution of Khalil's section 5: the platform attached to one leg, the others closed on it as loops."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import LoopEnd
from robot_dynamics.model.placement import invert_placement, placement
from robot_dynamics.model.robot import Frame, Link

TURNED = placement([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # z comes to lie along x, x along y, y along z


def attached(robot, *legs):
    """Return the Robot without the coordinates of its platforms. The loops with numbers `legs` carry them instead: on
    the link at which a loop is cut, or, at a ball joint, on three unactuated joints."""
    removed = {number for platform in robot.platforms for number in platform.joints}
    remaining = [number for number in range(len(robot.joints)) if number not in removed]
    pending = list(zip(robot.platforms, (robot.loops[leg] for leg in legs or (0,)), strict=True))
    links, joints, placed = [robot.links[0]], [], {0: (0, np.eye(4))}
    while remaining or pending:
        for number in [number for number in remaining if robot.joints[number].antecedent in placed]:
            joint = robot.joints[number]
            link, pose = placed[joint.antecedent]
            joints.append(replace(joint, antecedent=link, placement=pose @ joint.placement))
            links.append(robot.links[number + 1])
            placed[number + 1] = len(links) - 1, np.eye(4)
            remaining.remove(number)
        if pending and not any(robot.joints[number].antecedent in placed for number in remaining):
            ready = next(pair for pair in pending if pair[1].moved.link in placed)
            pending.remove(ready)
            placed[ready[0].link] = _carried(robot, *ready, links, joints, placed)
    loops = [
        replace(loop, moved=_on(loop.moved, placed), closed_on=_on(loop.closed_on, placed))
        for number, loop in enumerate(robot.loops)
        if number not in (legs or (0,))
    ]
    frames = [Frame(link.name, number, np.eye(4)) for number, link in enumerate(links)]
    return replace(
        robot, links=tuple(links), joints=tuple(joints), frames=tuple(frames), loops=tuple(loops), platforms=()
    )


def _carried(robot, platform, loop, links, joints, placed):
    """Return (link, placement in its frame) of a platform on a leg; add the joints of a ball joint."""
    carrier = placed[loop.moved.link][0]
    pose = loop.moved.placement @ invert_placement(loop.closed_on.placement)  # the platform in the frame of its carrier
    if loop.is_spherical:
        name = robot.links[platform.link].name
        for k in range(3):
            placement = loop.moved.placement if k == 0 else TURNED
            joints.append(
                Joint(f"{name}_attached_{k}", carrier, False, placement, actuated=False, initial_position=0.1)
            )
            links.append(Link(f"{name}_attached_{k}", Inertia()))
            carrier = len(links) - 1
        pose = invert_placement(loop.closed_on.placement)
    body = robot.links[platform.link].inertia.transformed_by(pose)
    links[carrier] = Link(links[carrier].name, links[carrier].inertia + body)
    return carrier, pose


def _on(end, placed):
    link, pose = placed[end.link]
    return LoopEnd(link, pose @ end.placement)


def seed_of_attached(dynamics, first, q, *legs):
    """Return a seed (N, all joints) of the Dynamics `first` of an attached robot at q (N, all joints) of `dynamics`:
    positions of common joints and of the ball joints that carry the platforms; nan elsewhere."""
    robot, seed = dynamics.robot, np.full((len(q), len(first.all_joint_names)), np.nan)
    for column, joint in enumerate(first.all_joint_names):
        if joint in robot.joint_numbers:
            seed[:, column] = q[:, robot.joint_numbers[joint]]
    for link, leg in zip(robot.platform_links, legs, strict=True):
        loop = robot.loops[leg]
        if loop.is_spherical:
            carrier_pose, platform_pose = (
                dynamics.link_pose(robot.links[loop.moved.link].name, q),
                dynamics.link_pose(link, q),
            )
            carrier_pose = (
                carrier_pose
                @ invert_placement(robot.frame(robot.links[loop.moved.link].name).placement)
                @ loop.moved.placement
            )
            platform_pose = platform_pose @ invert_placement(robot.frame(link).placement) @ loop.closed_on.placement
            R = np.swapaxes(carrier_pose[:, :3, :3], 1, 2) @ platform_pose[:, :3, :3]
            # Rz(a) C Rz(b) C Rz(c) = R, with C the cyclic turn: Rz(a) Rx(b) Ry(c) C C = R
            columns = [first.all_joint_names.index(f"{link}_attached_{k}") for k in range(3)]
            seed[:, columns] = Rotation.from_matrix(R @ TURNED[:3, :3]).as_euler("ZXY")
    return seed
