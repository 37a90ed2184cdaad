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
    """The Robot without the coordinates of its platforms. Each is carried instead by a loop, of which `legs` has the
    number: on the link that this loop is cut at, or, at a ball joint, on three joints without motor."""
    gone = {number for platform in robot.platforms for number in platform.joints}
    left = [number for number in range(len(robot.joints)) if number not in gone]
    waiting = list(zip(robot.platforms, (robot.loops[leg] for leg in legs or (0,)), strict=True))
    links, joints, placed = [robot.links[0]], [], {0: (0, np.eye(4))}
    while left or waiting:
        for number in [number for number in left if robot.joints[number].antecedent in placed]:
            joint = robot.joints[number]
            link, stands = placed[joint.antecedent]
            joints.append(replace(joint, antecedent=link, placement=stands @ joint.placement))
            links.append(robot.links[number + 1])
            placed[number + 1] = len(links) - 1, np.eye(4)
            left.remove(number)
        if waiting and not any(robot.joints[number].antecedent in placed for number in left):
            ready = next(pair for pair in waiting if pair[1].moved.link in placed)
            waiting.remove(ready)
            placed[ready[0].link] = _carried(robot, *ready, links, joints, placed)
    loops = [
        replace(other, moved=_on(other.moved, placed), closed_on=_on(other.closed_on, placed))
        for number, other in enumerate(robot.loops)
        if number not in (legs or (0,))
    ]
    frames = [Frame(link.name, number, np.eye(4)) for number, link in enumerate(links)]
    return replace(
        robot, links=tuple(links), joints=tuple(joints), frames=tuple(frames), loops=tuple(loops), platforms=()
    )


def _carried(robot, platform, loop, links, joints, placed):
    """(link, placement in its frame) of a platform on a leg; adds the joints of a ball joint."""
    carrier = placed[loop.moved.link][0]
    stands = loop.moved.placement @ invert_placement(
        loop.closed_on.placement
    )  # the platform in the frame of its carrier
    if loop.is_spherical:
        name = robot.links[platform.link].name
        for k in range(3):
            placement = loop.moved.placement if k == 0 else TURNED
            joints.append(
                Joint(f"{name}_attached_{k}", carrier, False, placement, actuated=False, initial_position=0.1)
            )
            links.append(Link(f"{name}_attached_{k}", Inertia()))
            carrier = len(links) - 1
        stands = invert_placement(loop.closed_on.placement)
    body = robot.links[platform.link].inertia.transformed_by(stands)
    links[carrier] = Link(links[carrier].name, links[carrier].inertia + body)
    return carrier, stands


def _on(end, placed):
    link, stands = placed[end.link]
    return LoopEnd(link, stands @ end.placement)


def seed_of_attached(dynamics, other, q, *legs):
    """Positions (N, all joints) of the Dynamics `other` of an attached robot, where `dynamics` has q (N, all joints):
    of joints that both have, and of the ball joints on which the platforms stand; nan of the rest."""
    robot, seed = dynamics.robot, np.full((len(q), len(other.all_joint_names)), np.nan)
    for place, joint in enumerate(other.all_joint_names):
        if joint in robot.joint_numbers:
            seed[:, place] = q[:, robot.joint_numbers[joint]]
    for link, leg in zip(robot.platform_links, legs, strict=True):
        loop = robot.loops[leg]
        if loop.is_spherical:
            carrier, moved = dynamics.link_pose(robot.links[loop.moved.link].name, q), dynamics.link_pose(link, q)
            carrier = (
                carrier
                @ invert_placement(robot.frame(robot.links[loop.moved.link].name).placement)
                @ loop.moved.placement
            )
            moved = moved @ invert_placement(robot.frame(link).placement) @ loop.closed_on.placement
            R = np.swapaxes(carrier[:, :3, :3], 1, 2) @ moved[:, :3, :3]
            # Rz(a) C Rz(b) C Rz(c) = R, with C the cyclic turn: Rz(a) Rx(b) Ry(c) C C = R
            places = [other.all_joint_names.index(f"{link}_attached_{k}") for k in range(3)]
            seed[:, places] = Rotation.from_matrix(R @ TURNED[:3, :3]).as_euler("ZXY")
    return seed
