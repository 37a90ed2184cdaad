"""The first solution of Khalil's section 5: the platform attached to one leg, the others closed on it as loops."""

from dataclasses import replace

import numpy as np

from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import End
from robot_dynamics.model.placement import inverse, placement
from robot_dynamics.model.robot import Frame, Link

TURNED = placement([[0, 0, 1], [1, 0, 0], [0, 1, 0]])  # z comes to lie along x, x along y, y along z


def attached(robot, leg=0):
    """The Robot without the coordinates of its platform, which its loop number `leg` carries instead: on the link that
    this loop is cut at, or, at a ball joint, on three joints without motor."""
    platform, loop = robot.platform, robot.loops[leg]
    gone = set(platform.joints)
    kept = [number for number in range(len(robot.joints)) if number not in gone]
    links, joints, number_of = [robot.links[0]], [], {0: 0}
    for number in kept:
        joint = robot.joints[number]
        joints.append(replace(joint, antecedent=number_of[joint.antecedent]))
        links.append(robot.links[number + 1])
        number_of[number + 1] = len(links) - 1
    carrier = number_of[loop.moved.link]
    stands = loop.moved.placement @ inverse(loop.closed_on.placement)  # the platform in the frame of its carrier
    if loop.ball:
        for k in range(3):
            placed = loop.moved.placement if k == 0 else TURNED
            joints.append(Joint(f"attached_{k}", carrier, False, placed, actuated=False, initial_position=0.1))
            links.append(Link(f"attached_{k}", Inertia()))
            carrier = len(links) - 1
        stands = inverse(loop.closed_on.placement)
    body = robot.links[platform.link].inertia.seen_from(stands)
    links[carrier] = Link(links[carrier].name, links[carrier].inertia + body)
    loops = [
        replace(
            other,
            moved=_moved(other.moved, number_of),
            closed_on=_on(other.closed_on, platform, carrier, stands, number_of),
        )
        for other in robot.loops
        if other is not loop
    ]
    frames = [Frame(link.name, number, np.eye(4)) for number, link in enumerate(links)]
    return replace(
        robot, links=tuple(links), joints=tuple(joints), frames=tuple(frames), loops=tuple(loops), platform=None
    )


def _moved(end, number_of):
    return End(number_of[end.link], end.placement)


def _on(end, platform, carrier, stands, number_of):
    if end.link == platform.link:
        return End(carrier, stands @ end.placement)
    return End(number_of[end.link], end.placement)
