"""A Robot as the rows of a SYMORO+ .par: its links and fixed frames, then cut joints, then frames that close loops."""

from typing import NamedTuple

import numpy as np

from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import Loop
from robot_dynamics.model.mdh import ROUNDING, MDHParameters, mdh_from_placement
from robot_dynamics.model.mdh_table import build_mdh_table


class ParRow(NamedTuple):
    """One row of the file: number of the row that it is placed in, its six parameters, and what a joint moves there."""

    antecedent: int
    parameters: MDHParameters
    joint: Joint | None = None
    inertia: Inertia = Inertia()


class ParTable(NamedTuple):
    """The rows of a file, from row 1 on.

    links: NL, how many are of the tree; loops: the Loops that the others close, for each a row of frame k, and after
    these for each a row of frame k+B; frames: {name: row} of the named frames, but of links that are at their own row.
    """

    rows: list[ParRow]
    links: int
    loops: list[Loop]
    frames: dict[str, int]

    @property
    def joints(self):
        """NJ, the rows of the tree and of the frames k."""
        return self.links + len(self.loops)


def build_par_table(robot):
    """The FileRows of a Robot; loops that are cut at ball joints are left out."""
    cut = cut_joints(robot, lambda number: _fits(robot, number))
    tree = len(robot.joints) - len(cut)
    rows, numbers = _tree_rows(robot, tree)
    loops = [(loop, cut.get(number)) for number, loop in enumerate(robot.loops) if not loop.is_spherical]
    ends = [*(loop.moved for loop, _ in loops), *(loop.closed_on for loop, _ in loops)]
    frames, at_end = {}, {}  # the row of a frame, or the number of the end that it is at
    for frame in robot.frames:
        if frame.link <= tree and np.array_equal(frame.placement, np.eye(4)):
            frames[frame.name] = numbers[frame.link]
        elif (end := _end_at(frame, ends)) is not None:
            at_end[frame.name] = end
        else:
            rows.append(_last_row(rows, numbers[frame.link], frame.placement))
            frames[frame.name] = len(rows)
    last = [_end_row(robot, rows, numbers, loop.moved, number) for loop, number in loops]
    last += [_end_row(robot, rows, numbers, loop.closed_on) for loop, _ in loops]
    links = len(rows)
    numbers += [links + row for row, (_, number) in enumerate(loops, start=1) if number is not None]
    frames |= {name: links + 1 + end for name, end in at_end.items()}
    own = {robot.links[link].name: number for link, number in enumerate(numbers)}
    frames = {name: number for name, number in frames.items() if own.get(name) != number}
    return ParTable([*rows, *last], links, [loop for loop, _ in loops], frames)


def _end_at(frame, ends):
    """The number of the End at which a Frame is, but for rounding; None where it is at none."""
    same = (frame.link == end.link and np.allclose(frame.placement, end.placement, rtol=ROUNDING, atol=ROUNDING)
            for end in ends)  # fmt: skip
    return next((number for number, found in enumerate(same) if found), None)


def _fits(robot, number):
    """Whether the row of a cut joint says all of it: it has no friction, and no frame beside its link."""
    joint = robot.joints[number]
    at_frame = [np.array_equal(frame.placement, np.eye(4)) for frame in robot.frames if frame.link == number + 1]
    return all(at_frame) and joint.viscous_friction == joint.coulomb_friction == 0


def _tree_rows(robot, joints):
    """(FileRows of the first so many joints, the row of each link that they move, the base first)."""
    rows, numbers, by_name = [], [0], {robot.base_link: 0}
    for told in build_mdh_table(robot, joints):
        inertia = Inertia()
        if told.joint is not None:
            inertia = robot.links[len(numbers)].inertia
            numbers.append(len(rows) + 1)
        rows.append(ParRow(by_name[told.antecedent], told.parameters, told.joint, inertia))
        by_name[told.name] = len(rows)
    return rows, numbers


def _end_row(robot, rows, numbers, end, number=None):
    """The FileRow of an End, moved by joint `number` where it is at a cut joint; what leads to it is added."""
    if number is None:
        return _last_row(rows, numbers[end.link], end.placement)
    joint = robot.joints[number]
    return _last_row(rows, numbers[joint.antecedent], joint.placement, joint)


def _last_row(rows, number, placement, joint=None):
    """The FileRow of a frame placed in that of a row; what leads to it is added."""
    *before, last = mdh_from_placement(placement)
    for row in before:
        rows.append(ParRow(number, row))
        number = len(rows)
    return ParRow(number, last, joint)
