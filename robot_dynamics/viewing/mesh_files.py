"""Paths of mesh files. A description may name only files of its own folder and of packages.

The author of a description may be unknown. No name in it may lead a viewer to any other file: an absolute path, `..`, a
link of the file system, or a package that is really a whole disk. A file is refused before it is opened.
"""

from __future__ import annotations

import stat
from pathlib import Path
from typing import TYPE_CHECKING

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.package_folders import (
    PACKAGE_FILE,
    PACKAGE_NAME,
    enclosing_package,
    package_folders,
    share_folders,
    source_package,
)

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robot_dynamics.model.visual import MeshShape

MESH_SUFFIXES = (".dae", ".glb", ".obj", ".ply", ".stl")
MAX_MESH_BYTES = 200 * 1024 * 1024
"""Largest file that is read; the largest real ones have 30 MB."""

MAX_NAME_LENGTH = 1000  # characters of the name of a mesh


def resolve_mesh(shape: MeshShape, packages: Mapping[str, Path] | None = None) -> Path:
    """Return the path of the file of a mesh.

    Parameters
    ----------
    shape : MeshShape
        The mesh. Its file is `package://NAME/path`, `file:///path`, or a path that begins in the folder of the
        description.
    packages : mapping of str to Path, optional
        Folders of packages by name. Further packages are found in the folders of AMENT_PREFIX_PATH and
        ROS_PACKAGE_PATH, and around the description: folders from its own up to that of its package, and all above it
        with a `package.xml`. Default: none.

    Returns
    -------
    Path
        An existing regular file, without symbolic links. It is inside the named package; without a package, inside the
        folder of the description, inside its package or a known one.

    Raises
    ------
    InvalidInputError
        If there is no such file, or if it is not allowed. The message says why.
    UnknownPackageError
        If the package is not known.
    """
    file, packages = shape.file, packages or {}
    if "\0" in file or len(file) > MAX_NAME_LENGTH:
        raise _refusal(file, "that is not the name of a file")
    if Path(file).suffix.lower() not in MESH_SUFFIXES:
        raise _refusal(file, f"known are files {', '.join(MESH_SUFFIXES)}")
    scheme, separator, path = file.partition("://")
    if not separator:
        scheme, path = "file", file
    if scheme not in ("package", "file"):
        raise _refusal(file, f"{scheme}:// is not read, only package://, file:// and paths")
    folder = None if shape.folder is None else shape.folder.absolute()
    try:
        if scheme == "package":
            return _resolve_in_package(path, folder, packages)
        return _resolve_path(Path(path), folder, packages)
    except _RefusedError as error:
        raise _refusal(file, str(error)) from None
    except (OSError, ValueError, RuntimeError):  # such as a loop of links
        raise _refusal(file, "its path cannot be resolved") from None


class UnknownPackageError(InvalidInputError):
    """The package of a mesh is not known.

    Attributes
    ----------
    reason : str
        The end of the message, without the name of the mesh.
    """

    def __init__(self, file: str, package: str) -> None:
        remedy = f"give its folder (--package {package}=FOLDER), or source its workspace"
        self.reason = f"no package {package!r} is known: {remedy}"
        super().__init__(_refusal_text(file, self.reason))


class _RefusedError(Exception):
    """A file is refused; the message says why."""


def _refusal(file: str, reason: str) -> InvalidInputError:
    """Return the error for a file."""
    return InvalidInputError(_refusal_text(file, reason))


def _refusal_text(file: str, reason: str) -> str:
    return f"mesh {file[:200]!r} is not read: {reason}"


def _resolve_in_package(path: str, folder: Path | None, packages: Mapping[str, Path]) -> Path:
    """Return the file that package://`path` means; of several packages with the name the first that has it."""
    name, _, inner = path.lstrip("/").partition("/")
    if not PACKAGE_NAME.fullmatch(name):
        raise _RefusedError(f"{name[:60]!r} is not the name of a package")
    roots = list(package_folders(name, folder, packages))
    if not roots:
        raise UnknownPackageError(f"package://{path}", name)
    paths = [_resolve_inside(root / inner.lstrip("/"), [root], name) for root in roots]
    existing = [path for path in paths if path is not None and path.exists()]
    if not existing and None in paths:
        raise _RefusedError(f"it is not inside package {name!r}")
    return _check_file(existing[0] if existing else None)


def _resolve_path(path: Path, folder: Path | None, packages: Mapping[str, Path]) -> Path:
    """Return the file of a path without a package, whose relative form begins in the folder of the description."""
    if folder is None and not path.is_absolute():
        raise _RefusedError("the path is relative, but the description is a text that has no folder")
    target = path if folder is None else folder / path
    roots = list(packages.values())
    if folder is not None:
        roots += [folder, *enclosing_package(folder)[-1:]]
    for share in share_folders():
        if share in target.parents:
            package = share / target.relative_to(share).parts[0]
            roots += [package] if (package / PACKAGE_FILE).is_file() else []
    resolved = _resolve_inside(target, roots, None)
    if resolved is None:
        raise _RefusedError("it is outside the folder of the description and of its package")
    return _check_file(resolved)


def _resolve_inside(path: Path, roots: list[Path], package: str | None) -> Path | None:
    """Return a path without symbolic links, None unless it is then inside one of the roots.

    package: name of an installed package whose files may be links to its own source.
    """
    resolved = path.resolve()
    if any(resolved.is_relative_to(root.resolve()) for root in roots):
        return resolved
    if package is not None and any(share / package in roots for share in share_folders()):
        return resolved if source_package(resolved) == package else None
    return None


def _check_file(path: Path | None) -> Path:
    """Return an allowed path if it is a file to read. Raises _RefusedError otherwise."""
    if path is None or not path.exists():
        raise _RefusedError("there is no such file")
    if path.suffix.lower() not in MESH_SUFFIXES:  # of the file behind a link
        raise _RefusedError(f"known are files {', '.join(MESH_SUFFIXES)}")
    status = path.stat()
    if not stat.S_ISREG(status.st_mode):
        raise _RefusedError("it is not a regular file")
    if status.st_size > MAX_MESH_BYTES:
        raise _RefusedError(f"it has {status.st_size} bytes, more than {MAX_MESH_BYTES}")
    return path
