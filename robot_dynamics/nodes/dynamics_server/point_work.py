"""The work of a request with many points, which the node does range by range."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics

FIRST_RANGE = 32
"""Points in the first range of a request. The time that they take determines the next range."""


class PointWork(Protocol):
    """The work of a request.

    Attributes
    ----------
    count : number of points.
    first_range : number of points of the first range.
    """

    count: int
    first_range: int

    def compute(self, rows: slice) -> None:
        """Compute a range of points; ranges follow each other. Raises RobotDynamicsError."""
        ...

    def finish(self) -> None:
        """Complete the response after the last point."""
        ...


Handler: TypeAlias = Callable[[Any, Any, "Dynamics", str], PointWork | None]
"""A service as a function of request, response, robot and namespace of the node. It fills the response, or returns the
work that does so. It raises RobotDynamicsError to refuse a request."""


def first_range_of(dynamics: Dynamics) -> int:
    """Return the number of points of the first range: a point of a robot with loops can take milliseconds."""
    return 1 if dynamics.robot.loops else FIRST_RANGE


def require_point_count(count: int, limit: int) -> None:
    """Refuse a request with more points than the limit of the node. Raises InvalidInputError."""
    if count > limit:
        raise InvalidInputError(
            f"the request has {count} points: {limit} at most are accepted. Send several requests, or raise the "
            "parameter max_points of this node"
        )
