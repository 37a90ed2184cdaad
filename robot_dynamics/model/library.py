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
    if isinstance(description, bytes) or (isinstance(description, str) and "<" in description):
        text, source = description, "description"
    else:
        text, source = read_file(description)
    robot = read_urdf(text, source=source, moving_base=moving_base, gravity=gravity)
    if strict:
        robot.refuse_doubtful()
    for warning in robot.warnings:
        logger.warning("%s: %s", source, warning)
    return robot


def read_file(name):
    """(content in bytes, what to call it) of a path, or of the name of a robot that ships."""
    if not isinstance(name, str | Path) or not str(name).strip():
        what = "empty" if isinstance(name, str) else f"{name!r}"
        raise DescriptionError(
            f"the description is {what}: the text of a URDF, its path or the name of a robot that ships is needed"
        )
    shipped = shipped_robots()
    path = shipped.get(str(name), Path(name))
    told = repr(str(path)[:200])
    try:
        if path.exists() and not path.is_file():
            raise DescriptionError(f"{told} is no file")
        with path.open("rb") as file:
            content = file.read(LARGEST_DESCRIPTION + 1)
    except (OSError, ValueError) as error:
        message = f"{told} cannot be read as a file ({getattr(error, 'strerror', None) or error})"
        if "/" not in str(name):
            message += f", and no robot of that name ships: {unknown_name('robot', name, shipped)}"
        raise DescriptionError(message) from None
    if len(content) > LARGEST_DESCRIPTION:
        raise DescriptionError(f"{told} is larger than a description may be: {LARGEST_DESCRIPTION} bytes at most")
    return content, str(path)


def shipped_robots():
    """Paths of the descriptions that ship with the package, by name."""
    # beside the code in a checkout, else in share/ of the prefix that the package is installed in
    for folder in Path(__file__).resolve().parents:
        for robots in (folder / "config" / "robots", folder / "share" / "robot_dynamics" / "config" / "robots"):
            if robots.is_dir():
                return {path.stem: path for path in sorted(robots.glob("*.urdf"))}
    return {}
