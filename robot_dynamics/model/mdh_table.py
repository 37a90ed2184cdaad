"""A robot as the rows of an MDH table, in the order in which its links are numbered."""

from typing import NamedTuple

from robot_dynamics.model.joint import Joint
from robot_dynamics.model.mdh import MDHParameters, mdh_from_placement


class MDHTableRow(NamedTuple):
    """One frame of the table.

    name: of the frame, the name of its link where a joint moves it; antecedent: name of the frame that it is placed in;
    row: its six parameters, the joint variable zero; joint: what moves it, None for a fixed frame.
    """

    name: str
    antecedent: str
    parameters: MDHParameters
    joint: Joint | None


def build_mdh_table(robot, joints=None):
    """The TableRows of a Robot. A joint whose axis is nearly parallel to the one before has a fixed frame before it.

    The frames are the robot's own: `minimal_frames(robot)` has those with the fewest parameters. joints: how many of
    its joints have rows, the first ones; None: all.
    """
    taken = {*robot.frames_by_name}
    rows = []
    for number, joint in enumerate(robot.joints[:joints], start=1):
        antecedent, name = robot.links[joint.antecedent].name, robot.links[number].name
        *before, last = mdh_from_placement(joint.placement)
        for row in before:
            rows.append(MDHTableRow(make_unique_name(f"{name}_offset", taken), antecedent, row, None))
            antecedent = rows[-1].name
            taken.add(antecedent)
        rows.append(MDHTableRow(name, antecedent, last, joint))
    return rows


def make_unique_name(name, taken):
    """`name`, or where it is taken the first of name_2, name_3, ... that is not."""
    number, found = 1, name
    while found in taken:
        number += 1
        found = f"{name}_{number}"
    return found
