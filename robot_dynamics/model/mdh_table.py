"""A robot as the rows of an MDH table, in the order of its links."""

from __future__ import annotations

from collections.abc import Container
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.model.mdh import mdh_from_placement

if TYPE_CHECKING:
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.mdh import MDHParameters
    from robot_dynamics.model.robot import Robot


class MDHTableRow(NamedTuple):
    """One frame of the table.

    Attributes
    ----------
    name : str
        Name of the frame: the name of its link where a joint moves it.
    antecedent : str
        Name of the frame in which it is placed.
    parameters : MDHParameters
        Its six parameters at zero joint position.
    joint : Joint or None
        The joint that moves it, None for a fixed frame.
    """

    name: str
    antecedent: str
    parameters: MDHParameters
    joint: Joint | None


def build_mdh_table(robot: Robot, joint_count: int | None = None) -> list[MDHTableRow]:
    """Return the rows of a robot, in its own frames; `minimal_frames(robot)` has those with the fewest parameters.

    A joint whose axis is nearly parallel to the axis before it has a fixed frame before it.

    Parameters
    ----------
    robot : Robot
        The robot.
    joint_count : int, optional
        Number of joints that have rows, from the first on. Default: all.
    """
    taken = {*robot.frames_by_name}
    rows: list[MDHTableRow] = []
    for number, joint in enumerate(robot.joints[:joint_count], start=1):
        antecedent = robot.links[joint.antecedent].name
        name = robot.links[number].name
        *fixed_frames, last = mdh_from_placement(joint.placement)
        for parameters in fixed_frames:
            rows.append(MDHTableRow(make_unique_name(f"{name}_offset", taken), antecedent, parameters, None))
            antecedent = rows[-1].name
            taken.add(antecedent)
        rows.append(MDHTableRow(name, antecedent, last, joint))
    return rows


def make_unique_name(name: str, taken: Container[str]) -> str:
    """Return `name`, or where it is taken the first of name_2, name_3, ... that is not."""
    number = 1
    candidate = name
    while candidate in taken:
        number += 1
        candidate = f"{name}_{number}"
    return candidate
