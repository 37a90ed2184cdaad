"""Where descriptions come from: a text, a file, or the name of a robot that ships with the package."""

import logging
import os
import re
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import UTF16_MARKS, read_file_bytes
from robot_dynamics.model.formats.mdh_yaml.reader import read_mdh_yaml
from robot_dynamics.model.formats.par.reader import read_par
from robot_dynamics.model.formats.urdf.document import MAX_DESCRIPTION_LENGTH
from robot_dynamics.model.formats.urdf.reader import read_urdf

FORMATS = "a URDF, an MDH table in YAML or a SYMORO+ .par"
SUFFIXES = (".urdf", ".yaml", ".par")

logger = logging.getLogger(__name__)


def load_robot(description, *, values=None, moving_base=None, gravity=None, strict=False):
    """Load a robot.

    description: the text of a URDF, of an MDH table in YAML or of a SYMORO+ .par, the path of such a file, or the name
    of a robot that ships (`shipped_robots()`); or a YAML that has a URDF and tells its loops. values: {name: number or
    expression} for names that a .par leaves open, or in the place of `parameters` of a YAML. moving_base: whether the
    base is free to move; gravity: (3,) [m/s²], in the world; None: as the description says, else fixed, and the
    Earth's. strict: refuse inertias that no real body has, instead of warning.

    Raises DescriptionError.
    """
    if isinstance(description, bytes) or (isinstance(description, str) and ("<" in description or "\n" in description)):
        text, source = description, "description"
    else:
        text, source = read_description(description)
    robot = read_robot(text, source=source, values=values, moving_base=moving_base, gravity=gravity)
    if strict:
        robot.raise_on_warnings()
    for warning in robot.warnings:
        logger.warning("%s: %s", source, warning)
    return robot


def read_robot(text, *, source, values=None, moving_base=None, gravity=None):
    """The Robot of a text (str or bytes) in any of the formats; which one it is, its first characters tell.

    source: what to call the text in errors, the Path of its file where it came from one, in whose folder a URDF that it
    names is looked for; the rest as for `load_robot`. Raises DescriptionError.
    """
    settings = {"source": source, "moving_base": moving_base, "gravity": gravity}
    if not isinstance(values, Mapping | None) or not all(isinstance(name, str) for name in values or ()):
        raise DescriptionError(f"{source}: values are {values!r:.60}: {{name: number or expression}} is needed")
    if is_urdf(text):
        if values:
            raise DescriptionError(f"{source}: values of {', '.join(values)} are given, but a URDF leaves no name open")
        return read_urdf(text, **settings)
    if re.match(r"\s*(\(\*|\w+\s*=)", _beginning(text)):
        return read_par(text, values=values, **settings)
    return read_mdh_yaml(text, values=values, **settings)


def is_urdf(text):
    """Whether a text (str or bytes) is to be read as a URDF: it begins as XML does."""
    return re.match(r"\s*<", _beginning(text)) is not None


def has_urdf(text):
    """Whether a text (str or bytes) is a URDF or a YAML that has one: its frames are then those of a URDF."""
    return is_urdf(text) or re.search(r"^urdf[ \t]*:", _beginning(text, None), re.MULTILINE) is not None


def _beginning(text, length=1000):
    beginning = text[:length]
    if isinstance(text, bytes):
        encoding = "utf-16" if text[:2] in UTF16_MARKS else "latin-1"
        beginning = beginning.decode(encoding, "ignore").removeprefix("ï»¿")
    return beginning.removeprefix("\ufeff")


def read_description(name):
    """(content in bytes, its Path, by which errors call it) of a path, or of the name of a robot that ships."""
    if not isinstance(name, str | Path) or not str(name).strip():
        what = "empty" if isinstance(name, str) else f"{name!r}"
        raise DescriptionError(
            f"the description is {what}: the text of {FORMATS}, its path or the name of a robot that ships is needed"
        )
    shipped = shipped_robots()
    path = shipped.get(str(name), Path(name))
    try:
        return read_file_bytes(path, MAX_DESCRIPTION_LENGTH), path
    except DescriptionError as error:
        if os.path.exists(path):
            raise
        raise DescriptionError(f"{error}{_shipped_hint(str(name), shipped)}") from None


def _shipped_hint(name, shipped):
    """What to add to an error about a file of this name that is not there: the robot that ships and may be meant."""
    path = Path(name)
    stem = (path.stem if path.suffix.lower() in SUFFIXES else path.name).lower()
    if stem in shipped:
        return f". The robot that ships is named {stem!r}, without a folder or a suffix"
    if "/" not in name:
        return f", and no robot of that name ships: {describe_unknown_name('robot', stem, shipped)}"
    near = get_close_matches(stem, shipped, n=3, cutoff=0.75)
    return f". Of the robots that ship, {' or '.join(map(repr, near))} may be meant" if near else ""


def shipped_robots():
    """Paths of the descriptions that ship with the package, by name."""
    robots = shipped_file("robots")
    if robots is None:
        return {}
    return {path.stem: path for path in sorted(robots.iterdir()) if path.suffix in SUFFIXES}


def shipped_file(name):
    """The Path of a file or folder of config/ that ships with the package; None where it is not there."""
    # beside the code in a checkout, else in share/ of the prefix that the package is installed in
    for folder in Path(__file__).resolve().parents:
        for config in (folder / "config", folder / "share" / "robot_dynamics" / "config"):
            if (config / name).exists():
                return config / name
    return None
