"""Closed loops as data: the two frames of a cut chain that must coincide (Khalil, section 2.2)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.joint import check_placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray


class LoopEnd(NamedTuple):
    """A frame at an end of a cut chain.

    Attributes
    ----------
    link : int
        Number of the link that carries the frame.
    placement : (4, 4) array
        Placement of the frame in the frame of that link.
    """

    link: int
    placement: ScalarArray


@dataclass(frozen=True, eq=False)
class Loop:
    """A closed loop: two frames of the tree that coincide.

    A loop is cut at a joint. A revolute or prismatic cut joint is a joint of the tree, at the end of its branch: it
    moves a link without inertia, whose frame is frame k.

    Parameters
    ----------
    name : str
        Name of the loop: the name of its cut joint.
    moved : LoopEnd
        Frame k.
    closed_on : LoopEnd
        Frame k+B.
    is_spherical : bool
        Whether the loop is cut at a ball joint: only the origins of the two frames coincide. Else all six coordinates
        of the frames coincide.

    Notes
    -----
    Source: Khalil, section 2.2.
    """

    name: str
    moved: LoopEnd
    closed_on: LoopEnd
    is_spherical: bool = False

    @property
    def ends(self) -> tuple[LoopEnd, LoopEnd]:
        """Frame k and frame k+B."""
        return self.moved, self.closed_on

    def with_placements(self, relocate: Callable[[LoopEnd], ScalarArray]) -> Loop:
        """Return the same loop with new placements of its ends.

        Parameters
        ----------
        relocate : callable
            Function of a LoopEnd that returns its new placement (4, 4).
        """
        moved, closed_on = (LoopEnd(end.link, relocate(end)) for end in self.ends)
        return replace(self, moved=moved, closed_on=closed_on)


def check_loop(loop: Loop, link_count: int) -> None:
    """Raise DescriptionError where a tree with `link_count` links cannot have this loop."""
    for key, end in (("moved", loop.moved), ("closed_on", loop.closed_on)):
        if not 0 <= end.link < link_count:
            raise DescriptionError(f"loop {loop.name!r}: {key} is on link {end.link}, of 0 to {link_count - 1}")
        check_placement(f"loop {loop.name!r}, {key}", end.placement)
    if loop.moved.link == loop.closed_on.link:
        raise DescriptionError(f"loop {loop.name!r}: both its ends are on the same link, so that it closes nothing")
