"""Which joints of a robot are those at which its loops are cut, as descriptions tell them apart from the tree."""

import numpy as np


def cut_joints(robot, is_allowed=lambda number: True):
    """{number of a loop: number of the joint at which it is cut}, both in the order of the robot.

    Such a joint has the name of its loop, no motor and no leader. It ends a branch: the link that it moves has no
    inertia and carries nothing but frame k, at its own frame. These joints are the last of the robot, in the order of
    their loops; one that is elsewhere counts as a joint of the tree, and its loop as a weld. fits: what else is asked
    of a joint, by its number. Loops cut at ball joints, and welds, have no joint and are not among them.
    """
    carriers = {joint.antecedent for joint in robot.joints}
    ends = [end.link for loop in robot.loops for end in loop.ends]
    found, last = {}, len(robot.joints)
    for number, loop in reversed(list(enumerate(robot.loops))):
        if loop.is_spherical or last == 0 or loop.moved.link != last:
            continue
        joint = robot.joints[last - 1]
        alone = joint.mimic is None and not joint.actuated and joint.rotor_inertia == 0
        ends_there = last not in carriers and ends.count(last) == 1 and not np.any(robot.links[last].inertia.spatial)
        at_frame = np.array_equal(loop.moved.placement, np.eye(4))
        if joint.name == loop.name and alone and ends_there and at_frame and is_allowed(last - 1):
            last -= 1
            found[number] = last
    return dict(reversed(found.items()))
