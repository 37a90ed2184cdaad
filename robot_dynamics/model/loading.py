"""Loading of a robot from a text, from a file, or by the name of a robot that ships with the package."""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH, UTF16_MARKS, read_file_bytes
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.mjcf.document import is_mjcf
from robot_dynamics.model.formats.mjcf.reader import read_mjcf
from robot_dynamics.model.formats.par.reader import read_par
from robot_dynamics.model.formats.sdf.document import is_sdf
from robot_dynamics.model.formats.sdf.reader import read_sdf
from robot_dynamics.model.formats.urdf.reader import read_urdf
from robot_dynamics.model.formats.xacro.expansion import is_xacro, read_xacro
from robot_dynamics.model.locked_joints import lock_joints, lock_massless_joints

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike
    from robot_dynamics.model.robot import Robot

FORMATS = "a URDF, a xacro, an SDF, an MJCF, an MDH table in YAML or a SYMORO+ .par"
SUFFIXES = (".urdf", ".yaml", ".par")

logger = logging.getLogger(__name__)


class _ReaderOptions(TypedDict):
    """Options that all readers have."""

    source: str | Path
    moving_base: bool | None
    gravity: ArrayLike | None


def load_robot(
    description: str | bytes | Path,
    *,
    values: Mapping[str, float | str] | None = None,
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
    locked: Mapping[str, float] | None = None,
    lock_massless: bool = False,
    strict: bool = False,
) -> Robot:
    """Load a robot.

    Parameters
    ----------
    description : str, bytes or Path
        Text of a URDF, of an SDF, of an MJCF, of an MDH table in YAML, of a YAML that completes a URDF, or of a SYMORO+
        .par; the path of such a file, or of a xacro; or the name of a robot that ships with the package
        (`shipped_robots`). The package xacro expands a xacro, and reads the files that it names: load it only from a
        source that is trusted.
    values : mapping of str to float or str, optional
        Numbers or expressions for names without a value in a .par, or in place of `parameters` of a YAML.
    moving_base : bool, optional
        Whether the base can move freely. Default: from the description, else False.
    gravity : (3,) array_like, optional
        Acceleration of gravity in the world frame [m/s²]. Default: from the description, else the Earth's, along -z.
    locked : mapping of str to float, optional
        Positions [rad or m] at which joints are locked, by name, as for `Robot.with_locked_joints`. Default: none.
    lock_massless : bool
        Lock joints outside loops that move nothing with inertia, such as a finger without mass, with a warning: the
        direct model has no solution for them. Each is locked at its initial position, or at the nearest one within
        its limits; the inertias do not depend on it. Default: False.
    strict : bool
        Raise an error for all that `Robot.warnings` names, such as inertias that no physical body has, instead of
        logging warnings.

    Returns
    -------
    Robot
        The robot.

    Raises
    ------
    DescriptionError
        If the description cannot be read or describes an impossible robot, or a joint cannot be locked.
    InvalidInputError
        If `locked` names an unknown joint or has a position that is not a finite number.
    MissingPackageError
        If a package that reads the format is not installed.

    Examples
    --------
    >>> load_robot("panda")
    Robot('panda', 7 joints, fixed base)
    """
    text: str | bytes
    source: str | Path
    if isinstance(description, bytes) or (isinstance(description, str) and ("<" in description or "\n" in description)):
        text = description
        source = "description"
    else:
        text, source = read_description(description)
    robot = read_robot(text, source=source, values=values, moving_base=moving_base, gravity=gravity)
    robot = lock_joints(robot, {} if locked is None else locked)
    robot = lock_massless_joints(robot) if lock_massless else robot
    if strict:
        robot.raise_on_warnings()
    for warning in robot.warnings:
        logger.warning("%s: %s", source, warning)
    return robot


def read_robot(
    text: str | bytes,
    *,
    source: str | Path,
    values: Mapping[str, float | str] | None = None,
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
) -> Robot:
    """Return the robot of a text in any of the formats, which the first characters determine.

    Parameters
    ----------
    text : str or bytes
        The description.
    source : str or Path
        Name of the text in error messages; the Path of its file, if it has one: the folder in which a URDF that the
        text refers to is searched.
    values, moving_base, gravity
        As for `load_robot`.

    Raises
    ------
    DescriptionError
        If the description cannot be read or describes an impossible robot.
    """
    options: _ReaderOptions = {"source": source, "moving_base": moving_base, "gravity": gravity}
    if not isinstance(values, Mapping | None) or not all(isinstance(name, str) for name in values or ()):
        raise DescriptionError(f"{source}: values are {values!r:.60}: {{name: number or expression}} is needed")
    if not text.strip():
        raise DescriptionError(f"{source} is empty: the text of {FORMATS} is needed")
    if is_urdf(text):
        if isinstance(source, Path) and is_xacro(text, source):
            return read_xacro(source, values=values, moving_base=moving_base, gravity=gravity)
        if values:
            names = ", ".join(values)
            raise DescriptionError(f"{source}: values of {names} are given, but a URDF has no names without a value")
        if is_mjcf(text):
            return read_mjcf(text, **options)
        return read_sdf(text, **options) if is_sdf(text) else read_urdf(text, **options)
    if re.match(r"\s*(\(\*|\w+\s*=)", _beginning(text)):
        return read_par(text, values=values, **options)
    return read_mdh_yaml(text, values=values, **options)


def is_urdf(text: str | bytes) -> bool:
    """Return whether a text is read as a URDF: it begins as XML does."""
    return re.match(r"\s*<", _beginning(text)) is not None


def has_urdf(text: str | bytes) -> bool:
    """Return whether a text is a URDF or a YAML that contains one: its frames are then those of a URDF."""
    return is_urdf(text) or re.search(r"^urdf[ \t]*:", _beginning(text, None), re.MULTILINE) is not None


def _beginning(text: str | bytes, length: int | None = 1000) -> str:
    """Return the first characters of a text, decoded without errors; length None: all."""
    if isinstance(text, bytes):
        encoding = "utf-16" if text[:2] in UTF16_MARKS else "latin-1"
        beginning = text[:length].decode(encoding, "ignore").removeprefix("ï»¿")
    else:
        beginning = text[:length]
    return beginning.removeprefix("\ufeff")


def read_description(name: str | Path) -> tuple[bytes, Path]:
    """Return the content and the path of a description file, by its path or by the name of a shipped robot."""
    if not isinstance(name, str | Path) or not str(name).strip():
        value = "empty" if isinstance(name, str) else f"{name!r}"
        raise DescriptionError(
            f"the description is {value}: the text of {FORMATS}, its path or the name of a robot that ships is needed"
        )
    shipped = shipped_robots()
    path = shipped.get(str(name), Path(name))
    try:
        return read_file_bytes(path, MAX_DESCRIPTION_LENGTH), path
    except DescriptionError as error:
        if os.path.exists(path):
            raise
        raise DescriptionError(f"{error}{_shipped_hint(str(name), shipped)}") from None


def _shipped_hint(name: str, shipped: Mapping[str, Path]) -> str:
    """Return the end of an error message about a missing file: the shipped robots with a similar name."""
    path = Path(name)
    stem = (path.stem if path.suffix.lower() in SUFFIXES else path.name).lower()
    if stem in shipped:
        return f". The robot that ships is named {stem!r}, without a folder or a suffix"
    if "/" not in name:
        return f", and no robot of that name ships: {describe_unknown_name('robot', stem, shipped)}"
    similar = get_close_matches(stem, shipped, n=3, cutoff=0.75)
    return f". Did you mean the robot {' or '.join(map(repr, similar))} that ships?" if similar else ""


def shipped_robots() -> dict[str, Path]:
    """Return the paths of the descriptions that ship with the package.

    Returns
    -------
    dict of str to Path
        Path of the description file of each robot, by the name that `load_robot` takes.
    """
    robots = shipped_file("robots")
    if robots is None:
        return {}
    return {path.stem: path for path in sorted(robots.iterdir()) if path.suffix in SUFFIXES}


def shipped_file(name: str) -> Path | None:
    """Return the path of a file or folder of config/ that ships with the package; None where it does not exist."""
    # beside the code in a checkout, else in share/ of the prefix of the installation
    for folder in Path(__file__).resolve().parents:
        for config in (folder / "config", folder / "share" / "robot_dynamics" / "config"):
            if (config / name).exists():
                return config / name
    return None
