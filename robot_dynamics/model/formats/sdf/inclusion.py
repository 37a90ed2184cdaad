"""Models that an SDF includes by a URI: `model://NAME`, `package://NAME/path`, or a relative path."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote

from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH, read_file_bytes
from robot_dynamics.model.formats.sdf.document import NEWEST, is_sdf, parse_sdf
from robot_dynamics.model.formats.urdf.document import parse_xml
from robot_dynamics.model.package_folders import package_folders

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robot_dynamics.model.formats.sdf.document import SdfDocument
    from robot_dynamics.model.formats.urdf.document import Element

PATH_VARIABLES = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH", "GAZEBO_MODEL_PATH")
"""Environment variables with the folders in which Gazebo searches models."""

MAX_DEPTH = 20  # of files that include each other


class MissingModelError(DescriptionError):
    """An included model is in no known folder."""


def included_document(document: SdfDocument, include: Element) -> SdfDocument:
    """Return the document of the file that an element <include> names.

    Raises
    ------
    MissingModelError
        If it is in no known folder.
    DescriptionError
        If it cannot be read.
    """
    uri = document.text(include, "uri")
    if not uri:
        document.fail(include, "<include> has no <uri>")
    where = f"{document.source}, line {include.sourceline}"
    if document.folder is None:
        raise MissingModelError(f"{where}: {uri[:200]!r} is not read: this text has no file, around which it could be")
    path = next(_candidates(uri, document.folder), None)
    if path is None:
        raise MissingModelError(
            f"{where}: model {uri[:200]!r} is not found: its folder belongs beside that of the file, or "
            f"the folder that contains it in {PATH_VARIABLES[0]}"
        )
    content = read_file_bytes(path, MAX_DESCRIPTION_LENGTH)
    if not is_sdf(content):
        raise DescriptionError(f"{where}: {uri[:200]!r} is no SDF: only SDF is included")
    if document.source.count(" < ") >= MAX_DEPTH:
        raise DescriptionError(f"{where}: more than {MAX_DEPTH} files include each other: {uri[:200]!r} is in a cycle")
    chain = f"{path.name} < {document.source}" if path.parent == document.folder else f"{path} < {document.source}"
    return parse_sdf(content, chain, path.parent, document.warnings)


def find_resource(uri: str, folder: Path | None) -> Path | None:
    """Return the existing file or folder of a URI, None where there is none; folder: of the file that names it."""
    return next(_paths(uri, folder), None) if folder is not None else None


def _candidates(uri: str, folder: Path) -> Iterator[Path]:
    """Yield the SDF files that a URI may mean."""
    for path in _paths(uri, folder):
        if path.is_file():
            yield path
        elif (model := _model_file(path)) is not None:
            yield model


def _paths(uri: str, folder: Path) -> Iterator[Path]:
    """Yield the existing files and folders that a URI may mean."""
    scheme, separator, rest = uri.partition("://")
    rest = unquote(rest) if separator else uri
    name, _, inner = rest.partition("/")
    if "\0" in rest or ".." in rest.split("/") or name in ("", "."):
        return
    if scheme == "model" and separator:
        folders = [base / name for base in _model_folders(folder)]
    elif scheme == "package" and separator:
        folders = list(package_folders(name, folder, {}))
    elif not separator:
        folders = [folder, *_model_folders(folder)]  # Gazebo takes a name without model:// for one with it too
        inner = rest
    else:
        return
    for base in folders:
        path = (base / inner).resolve()
        if path.exists() and path.is_relative_to(base.resolve()):
            yield path


def _model_folders(folder: Path) -> Iterator[Path]:
    """Yield the folders that may contain that of a model: those of Gazebo's variables, and around the file."""
    for variable in PATH_VARIABLES:
        yield from (Path(entry) for entry in os.environ.get(variable, "").split(os.pathsep) if os.path.isabs(entry))
    for path in (folder, *list(folder.parents)[:2]):
        yield path
        yield path / "models"


def _model_file(folder: Path) -> Path | None:
    """Return the SDF file of the folder of a model: the newest that its model.config names, else model.sdf."""
    config = folder / "model.config"
    default = folder / "model.sdf"
    if config.is_file():
        try:
            root = parse_xml(read_file_bytes(config, MAX_DESCRIPTION_LENGTH))
        except (etree.XMLSyntaxError, ValueError, DescriptionError):
            root = etree.Element("model")
        versions = {}
        for element in root.iterchildren("sdf"):
            numbers = tuple(int(word) for word in element.get("version", "0").split(".") if word.isdigit())
            versions[numbers] = folder / Path((element.text or "").strip()).name
        readable = [version for version in versions if version <= NEWEST and versions[version].is_file()]
        if readable:
            return versions[max(readable)]
    return default if default.is_file() else None
