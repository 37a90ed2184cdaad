"""Expansion of a xacro file to the text of a URDF."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH
from robot_dynamics.model.formats.isolated_call import call_isolated
from robot_dynamics.model.formats.urdf.document import XACRO_ELEMENTS, decode_urdf
from robot_dynamics.model.formats.urdf.reader import read_urdf

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robot_dynamics.array_types import ArrayLike
    from robot_dynamics.model.robot import Robot

XACRO_SUFFIX = ".xacro"
XACRO_ELEMENT = re.compile(rf"<xacro:({'|'.join((*XACRO_ELEMENTS, 'robot'))})\b")
PROCESS = "robot_dynamics.model.formats.xacro.xacro_process"

Values: TypeAlias = "Mapping[str, float | str]"


def is_xacro(text: str | bytes, source: str | Path) -> bool:
    """Return whether a text that begins as XML is a xacro to expand.

    Parameters
    ----------
    text : str or bytes
        The text.
    source : str or Path
        The Path of its file, or its name. A text without a file is never expanded: its author may be unknown, and an
        expansion can read any file.
    """
    if not isinstance(source, Path):
        return False
    if source.name.lower().endswith(XACRO_SUFFIX):
        return True
    # calls of macros alone do not count: a URDF with the rest of a call is read, with a warning
    return XACRO_ELEMENT.search(decode_urdf(text, source)) is not None


def expand_xacro(path: Path, values: Values | None = None) -> str:
    """Return the URDF that a xacro file expands to, as the command `xacro` prints it.

    The expansion runs in a process of its own. `$(find NAME)` finds packages where meshes do (`package_folders`).

    Parameters
    ----------
    path : Path
        The file. It and the files that it includes must come from a source that is trusted.
    values : mapping of str to float or str, optional
        Values of its arguments (`xacro:arg`) by name.

    Raises
    ------
    DescriptionError
        If xacro cannot expand the file, or it has no argument of such a name.
    MissingPackageError
        If xacro is not installed.
    """
    arguments = {name: str(value) for name, value in (values or {}).items()}
    request = {"file": str(path.absolute()), "values": arguments, "longest": MAX_DESCRIPTION_LENGTH}
    text: str = call_isolated(PROCESS, request, path, "xacro")
    return text


def read_xacro(
    path: Path, *, values: Values | None = None, moving_base: bool | None = None, gravity: ArrayLike | None = None
) -> Robot:
    """Read a robot from a xacro file; values as for `expand_xacro`, the other arguments as for `read_urdf`."""
    text = expand_xacro(path, values)
    try:
        return read_urdf(text, source=path, moving_base=moving_base, gravity=gravity)
    except DescriptionError as error:
        message = str(error)
        if ", line " in message:
            message += f" (a line of the expanded text: xacro {path.name})"
        raise DescriptionError(message) from error
