"""The cut joints of a robot: which of its joints descriptions write as part of a loop, not of the tree."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot


def cut_joints(robot: Robot, is_allowed: Callable[[int], bool] = lambda number: True) -> dict[int, int]:
    """Return {number of a loop: number of its cut joint}, both in the order of the robot.

    A cut joint has the name of its loop, no motor and no mimic relation. It ends a branch: the link that it moves has
    no inertia and carries only frame k, at its own frame. Cut joints are the last joints of the robot, in the order of
    their loops; a joint elsewhere counts as a joint of the tree, and its loop as a weld. Spherical loops and welds have
    no cut joint and are not in the result.

    Parameters
    ----------
    robot : Robot
        The robot.
    is_allowed : callable
        A further condition on a joint, by its number.
    """
    carriers = {joint.antecedent for joint in robot.joints}
    end_links = [end.link for loop in robot.loops for end in loop.ends]
    cuts: dict[int, int] = {}
    last = len(robot.joints)
    for number, loop in reversed(list(enumerate(robot.loops))):
        if loop.is_spherical or last == 0 or loop.moved.link != last:
            continue
        joint = robot.joints[last - 1]
        is_free = joint.mimic is None and not joint.actuated and joint.rotor_inertia == 0
        is_leaf = last not in carriers and end_links.count(last) == 1
        inertia = robot.links[last].inertia
        is_massless_leaf = is_leaf and not inertia.has_symbols and not np.any(inertia.spatial)
        is_at_frame = np.array_equal(loop.moved.placement, np.eye(4))
        if joint.name == loop.name and is_free and is_massless_leaf and is_at_frame and is_allowed(last - 1):
            last -= 1
            cuts[number] = last
    return dict(reversed(cuts.items()))
