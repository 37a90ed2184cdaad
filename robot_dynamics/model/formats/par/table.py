"""A Robot as the rows of a SYMORO+ .par: its links and fixed frames, then cut joints, then frames that close loops."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.mdh import ROUNDING, mdh_from_placement
from robot_dynamics.model.mdh_table import build_mdh_table

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.loop import Loop, LoopEnd
    from robot_dynamics.model.mdh import MDHParameters
    from robot_dynamics.model.robot import Frame, Robot


class ParRow(NamedTuple):
    """One row of the file: the number of its antecedent row, its six parameters, its joint and its inertia."""

    antecedent: int
    parameters: MDHParameters
    joint: Joint | None = None
    inertia: Inertia = Inertia()


class ParTable(NamedTuple):
    """The rows of a file, from row 1 on.

    Attributes
    ----------
    rows : list of ParRow
        All rows.
    links : int
        NL, the number of rows in the tree.
    loops : list of Loop
        The loops that the other rows close: for each a row of frame k, then for each a row of frame k+B.
    frames : dict of str to int
        Rows of the named frames, without those of links that are at their own row.
    """

    rows: list[ParRow]
    links: int
    loops: list[Loop]
    frames: dict[str, int]

    @property
    def joints(self) -> int:
        """NJ, the number of rows of the tree and of the frames k."""
        return self.links + len(self.loops)


def build_par_table(robot: Robot) -> ParTable:
    """Return the rows of a Robot, without loops that are cut at ball joints."""
    cut = cut_joints(robot, lambda number: _fits_in_row(robot, number))
    tree_joint_count = len(robot.joints) - len(cut)
    rows, row_of_link = _tree_rows(robot, tree_joint_count)
    loops = [(loop, cut.get(number)) for number, loop in enumerate(robot.loops) if not loop.is_spherical]
    ends = [*(loop.moved for loop, _ in loops), *(loop.closed_on for loop, _ in loops)]
    frame_rows: dict[str, int] = {}
    frame_ends: dict[str, int] = {}  # number of the end at which a frame is
    for frame in robot.frames:
        if frame.link <= tree_joint_count and np.array_equal(frame.placement, np.eye(4)):
            frame_rows[frame.name] = row_of_link[frame.link]
        elif (end := _find_end(frame, ends)) is not None:
            frame_ends[frame.name] = end
        else:
            rows.append(_make_row(rows, row_of_link[frame.link], frame.placement))
            frame_rows[frame.name] = len(rows)
    end_rows = [_end_row(robot, rows, row_of_link, loop.moved, joint) for loop, joint in loops]
    end_rows += [_end_row(robot, rows, row_of_link, loop.closed_on) for loop, _ in loops]
    links = len(rows)
    row_of_link += [links + row for row, (_, joint) in enumerate(loops, start=1) if joint is not None]
    frame_rows |= {name: links + 1 + end for name, end in frame_ends.items()}
    own_rows = {robot.links[link].name: row for link, row in enumerate(row_of_link)}
    frame_rows = {name: row for name, row in frame_rows.items() if own_rows.get(name) != row}
    return ParTable([*rows, *end_rows], links, [loop for loop, _ in loops], frame_rows)


def _find_end(frame: Frame, ends: Sequence[LoopEnd]) -> int | None:
    """Return the number of the loop end at which a frame is, but for rounding; None where it is at none."""
    for number, end in enumerate(ends):
        if frame.link != end.link:
            continue
        if np.allclose(frame.placement, end.placement, rtol=ROUNDING, atol=ROUNDING):
            return number
    return None


def _fits_in_row(robot: Robot, number: int) -> bool:
    """Return whether the row of a cut joint represents it completely: no friction, no frame apart from its link."""
    joint = robot.joints[number]
    is_at_link = [np.array_equal(frame.placement, np.eye(4)) for frame in robot.frames if frame.link == number + 1]
    return all(is_at_link) and joint.viscous_friction == joint.coulomb_friction == 0


def _tree_rows(robot: Robot, joint_count: int) -> tuple[list[ParRow], list[int]]:
    """Return the rows of the first joints, and the row of each link that they move, the base first."""
    rows: list[ParRow] = []
    row_of_link = [0]
    row_by_name = {robot.base_link: 0}
    for table_row in build_mdh_table(robot, joint_count):
        inertia = Inertia()
        if table_row.joint is not None:
            inertia = robot.links[len(row_of_link)].inertia
            row_of_link.append(len(rows) + 1)
        antecedent = row_by_name[table_row.antecedent]
        rows.append(ParRow(antecedent, table_row.parameters, table_row.joint, inertia))
        row_by_name[table_row.name] = len(rows)
    return rows, row_of_link


def _end_row(
    robot: Robot, rows: list[ParRow], row_of_link: Sequence[int], end: LoopEnd, number: int | None = None
) -> ParRow:
    """Return the row of a loop end, moved by joint `number` at a cut joint; append to `rows` the frames before it."""
    if number is None:
        return _make_row(rows, row_of_link[end.link], end.placement)
    joint = robot.joints[number]
    return _make_row(rows, row_of_link[joint.antecedent], joint.placement, joint)


def _make_row(rows: list[ParRow], antecedent: int, placement: ScalarArray, joint: Joint | None = None) -> ParRow:
    """Return the row of a frame placed in that of a row; append to `rows` the fixed frames before it."""
    *fixed_frames, last = mdh_from_placement(placement)
    for parameters in fixed_frames:
        rows.append(ParRow(antecedent, parameters))
        antecedent = len(rows)
    return ParRow(antecedent, last, joint)
