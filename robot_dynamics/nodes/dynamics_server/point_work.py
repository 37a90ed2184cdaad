"""The work of a request with many points, or many steps, which the node does range by range."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.dynamics import Dynamics

FIRST_RANGE = 32
"""Points in the first range of a request. The time that they take determines the next range."""


class Work(Protocol):
    """The work of a request, in parts: points of a trajectory, or steps at a single state.

    Attributes
    ----------
    count : number of parts.
    first_range : number of parts of the first range.
    """

    count: int
    first_range: int

    def compute(self, rows: slice) -> None:
        """Compute a range of parts; ranges follow each other. Raises RobotDynamicsError."""
        ...

    def finish(self) -> None:
        """Complete the response after the last part."""
        ...


class StepWork:
    """Work at a single state, as steps that are made one after the other.

    Parameters
    ----------
    steps : functions without arguments; the last one completes the response.
    preparation : what must be done before the first step, beside the executor, since it cannot be divided and takes
        long; None: nothing.
    """

    first_range = 1

    def __init__(self, steps: Sequence[Callable[[], None]], preparation: Callable[[], None] | None = None) -> None:
        self._steps = steps
        self.count = len(steps)
        self.preparation = preparation

    def compute(self, rows: slice) -> None:
        """Make a range of steps. Raises RobotDynamicsError."""
        for step in self._steps[rows]:
            step()

    def finish(self) -> None:
        """Do nothing: the last step has completed the response."""


Handler: TypeAlias = Callable[[Any, Any, "Dynamics", str], Work | None]
"""A service as a function of request, response, robot and namespace of the node. It fills the response, or returns the
work that does so. It raises RobotDynamicsError to refuse a request."""


def first_range_of(dynamics: Dynamics) -> int:
    """Return the number of points of the first range: a point of a robot with loops can take milliseconds."""
    return 1 if dynamics.robot.loops else FIRST_RANGE


def require_point_count(work: Work, limit: int) -> None:
    """Refuse a request with more points than the limit of the node. Raises InvalidInputError."""
    if not isinstance(work, StepWork) and work.count > limit:
        raise InvalidInputError(
            f"the request has {work.count} points: {limit} at most are accepted. Send several requests, or raise the "
            "parameter max_points of this node"
        )
