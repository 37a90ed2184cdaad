"""Where descriptions come from: a text, a file, or the name of a robot that ships with the package."""

import logging
from pathlib import Path

from robot_dynamics.errors import DescriptionError, unknown_name
from robot_dynamics.model.robot import EARTH
from robot_dynamics.model.urdf import read_urdf
from robot_dynamics.model.urdf_document import LARGEST_DESCRIPTION

logger = logging.getLogger(__name__)


def load_robot(description, *, moving_base=None, gravity=EARTH, strict=False):
    """Load a robot.

    description: the text of a URDF, the path of such a file, or the name of a robot that ships (`shipped_robots()`).
    moving_base: whether the base is free to move; None: as the description says. gravity: (3,) [m/s²], in the world.
    strict: refuse inertias that no real body has, instead of warning.

    Raises DescriptionError.
    """
    text, source = find_description(description)
    robot = read_urdf(text, source=source, moving_base=moving_base, gravity=gravity)
    if strict:
        robot.refuse_doubtful()
    for warning in robot.warnings:
        logger.warning("%s: %s", source, warning)
    return robot


def find_description(description):
    """(text, what to call it) of a description given as text, as a path or as the name of a robot that ships."""
    if isinstance(description, bytes) or "<" in str(description):
        return description, "description"
    if not str(description).strip():
        raise DescriptionError("the description is empty: a URDF, its path or the name of a robot that ships is needed")
    shipped = shipped_robots()
    path = shipped.get(str(description), Path(description))
    try:
        if path.stat().st_size > LARGEST_DESCRIPTION:
            raise DescriptionError(
                f"{path} has {path.stat().st_size} bytes: a description has {LARGEST_DESCRIPTION} at most"
            )
        return path.read_bytes(), str(path)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise DescriptionError(
            f"{str(description)[:200]!r} cannot be read as a file ({reason}), and no robot of that name ships: "
            f"{unknown_name('robot', str(description)[:200], shipped)}"
        ) from None


def shipped_robots():
    """Paths of the descriptions that ship with the package, by name."""
    # beside the code in a checkout, else in share/ of the prefix that the package is installed in
    for folder in Path(__file__).resolve().parents:
        for robots in (folder / "config" / "robots", folder / "share" / "robot_dynamics" / "config" / "robots"):
            if robots.is_dir():
                return {path.stem: path for path in sorted(robots.glob("*.urdf"))}
    return {}
