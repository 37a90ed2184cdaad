"""Folders of ROS packages, which `package://NAME` in a mesh and `$(find NAME)` in a xacro mean."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping

PACKAGE_FILE = "package.xml"
PACKAGE_NAME = re.compile(r"[A-Za-z0-9][\w.-]*", re.ASCII)


def package_folders(name: str, folder: Path | None, packages: Mapping[str, Path]) -> Iterator[Path]:
    """Yield the existing folders of a package: those that the caller gives, installed ones, and around the description.

    Parameters
    ----------
    name : str
        Name of the package.
    folder : Path or None
        Absolute folder of the description; None where it has no file.
    packages : mapping of str to Path
        Folders by name that come before all others.
    """
    if name in packages:
        yield Path(packages[name]).absolute()
        return
    candidates = [share / name for share in share_folders()]
    candidates += [path for path in _path_variable("ROS_PACKAGE_PATH") if path.name == name]
    if folder is not None:
        candidates += [path for path in enclosing_package(folder) if path.name == name]
        candidates += [path for path in folder.parents if path.name == name and (path / PACKAGE_FILE).is_file()]
    for path in dict.fromkeys(candidates):
        if path.is_dir():
            yield path


def enclosing_package(folder: Path) -> list[Path]:
    """Return the folders from that of the description up to the next one with package.xml; without one, itself only."""
    passed = []
    for path in (folder, *folder.parents):
        passed.append(path)
        if (path / PACKAGE_FILE).is_file():
            return passed
    return [folder]


def share_folders() -> list[Path]:
    """Return the folders in which ROS searches packages."""
    shares = [prefix / "share" for prefix in _path_variable("AMENT_PREFIX_PATH")]
    return shares + _path_variable("ROS_PACKAGE_PATH")


def _path_variable(name: str) -> list[Path]:
    """Return the absolute folders of an environment variable."""
    return [Path(entry) for entry in os.environ.get(name, "").split(os.pathsep) if os.path.isabs(entry)]


def source_package(path: Path) -> str | None:
    """Return the name of the package in whose source a file is, None where it is in none."""
    root = next((parent for parent in path.parents if (parent / PACKAGE_FILE).is_file()), None)
    if root is None:
        return None
    with (root / PACKAGE_FILE).open("rb") as file:
        match = re.search(rb"<name>\s*([\w.-]+)\s*</name>", file.read(100_000))
    return match.group(1).decode() if match else None
