"""The page of a robot in a notebook."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape
from typing import TYPE_CHECKING

from robot_dynamics.dynamics import Dynamics
from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.robot import Robot
from robot_dynamics.optional_packages import missing_package_error

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from robot_dynamics.viewing.played_motion import PlayedMotion

HEIGHT = 480


@dataclass(frozen=True, repr=False)
class NotebookView:
    """A page that a notebook shows in a frame; `notebook_view` returns it.

    Attributes
    ----------
    page : str
        The HTML page.
    title : str
        What the frame shows, for those who do not see it.
    height : int
        Height of the frame [pixels].
    warnings : tuple of str
        A sentence for each mesh that is missing or refused.
    """

    page: str
    title: str
    height: int = HEIGHT
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"NotebookView({self.title!r}, {len(self.page) / 1e6:.1f} MB)"

    def _repr_html_(self) -> str:
        """Return a frame with the page. Its scripts run, but reach nothing of the notebook."""
        return (
            f'<iframe sandbox="allow-scripts" title="{escape(self.title)}" srcdoc="{escape(self.page)}" '
            f'style="width: 100%; height: {int(self.height)}px; border: 1px solid #ccc"></iframe>'
        )


def notebook_view(
    robot: Robot | Dynamics,
    motion: PlayedMotion | None = None,
    packages: Mapping[str, Path] | None = None,
    height: int = HEIGHT,
) -> NotebookView:
    """Show a robot in a notebook in three dimensions: it can be turned, and its joints move through their ranges.

    The page is part of the notebook, 0.8 MB and the meshes of the robot. It needs no network and no server.

    Parameters
    ----------
    robot : Robot or Dynamics
    motion : PlayedMotion, optional
        Default: each joint moves through its range.
    packages : mapping of str to Path, optional
        Folders of packages by name, which mesh files may be in.
    height : int
        Height of the frame [pixels]. Default: 480.

    Returns
    -------
    NotebookView
        The last expression of a cell shows it.

    Raises
    ------
    InvalidInputError
        `robot` is not a robot.
    MissingPackageError
        The packages of the extra `view` are not installed.
    """
    shown = robot.robot if isinstance(robot, Dynamics) else robot
    if not isinstance(shown, Robot):
        raise InvalidInputError(f"notebook_view takes a Robot, as load_robot returns it, not {robot!r:.60}")
    try:
        from robot_dynamics.viewing.page import robot_page  # here: it needs the packages of the extra `view`
    except ModuleNotFoundError as error:
        raise missing_package_error(error, "a view of a robot in three dimensions") from error
    page, warnings = robot_page(shown, motion, packages)
    return NotebookView(page, shown.name, height, warnings)
