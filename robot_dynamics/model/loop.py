"""A closed loop as data: where a chain of links, cut open, is to meet itself again (Khalil, section 2.2)."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.joint import check_placement


class LoopEnd(NamedTuple):
    """A frame at an end of a cut chain: the number of the link that carries it, and its placement (4, 4) in it."""

    link: int
    placement: np.ndarray


@dataclass(frozen=True, eq=False)
class Loop:
    """Two frames of a tree that coincide: frame k, `moved`, and frame k+B, `closed_on`.

    A loop is cut at a joint. One that turns or slides is a joint of the tree as any other, at the end of its branch: it
    moves a link without inertia, whose frame is frame k. ball: the loop is cut at a ball joint, so that the origins of
    the two frames coincide and nothing is said of their axes; else the frames coincide whole.
    """

    name: str
    moved: LoopEnd
    closed_on: LoopEnd
    is_spherical: bool = False

    @property
    def ends(self):
        return self.moved, self.closed_on

    def with_placements(self, relocate):
        """The same Loop with the placement of each End as a function of the End tells."""
        moved, closed_on = (LoopEnd(end.link, relocate(end)) for end in self.ends)
        return replace(self, moved=moved, closed_on=closed_on)


def check_loop(loop, links):
    """Refuse a loop that could not be one of a tree with so many links."""
    for key, end in (("moved", loop.moved), ("closed_on", loop.closed_on)):
        if not 0 <= end.link < links:
            raise DescriptionError(f"loop {loop.name!r}: {key} is on link {end.link}, of 0 to {links - 1}")
        check_placement(f"loop {loop.name!r}, {key}", end.placement)
    if loop.moved.link == loop.closed_on.link:
        raise DescriptionError(f"loop {loop.name!r}: both its ends are on the same link, so that it closes nothing")
