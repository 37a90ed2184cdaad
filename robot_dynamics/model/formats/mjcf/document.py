"""The text of an MJCF file: with its includes, without what is only drawn or measured."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH, read_file_bytes
from robot_dynamics.model.formats.root_element import root_name
from robot_dynamics.model.formats.urdf.document import decode_urdf, parse_xml, refuse_external_references

if TYPE_CHECKING:
    from robot_dynamics.model.formats.urdf.document import Element

UNUSED_ELEMENTS = (
    *("camera", "contact", "custom", "keyframe", "light", "material", "sensor", "skin", "statistic", "texture"),
    "visual",
)
"""Elements without effect on the motion of a robot that touches nothing; many of them name files."""

SUBMODELS = ("attach", "model")
CHECKED_FILES = ("mesh", "hfield")  # whose files are checked, or not read, before the model is compiled


def is_mjcf(text: str | bytes) -> bool:
    """Return whether the root element of a text that begins as XML is <mujoco>."""
    return root_name(text) in ("mujoco", "mujocoInclude")


def read_document(text: str, folder: Path | None, source: str) -> Element:
    """Return the root element of an MJCF with the elements of its includes, without UNUSED_ELEMENTS.

    Parameters
    ----------
    text : str
        The MJCF.
    folder : Path or None
        Folder of its file, in which all files must be that it includes; None: it includes none.
    source : str
        Name of the text in error messages.

    Raises
    ------
    DescriptionError
        If the text is not well-formed, or includes what it may not.
    """
    root = _parse(text, source)
    _include(root, folder, folder, {source})
    for element in list(root.iter(etree.Element)):
        if element.tag in SUBMODELS:
            raise DescriptionError(
                f"<{element.tag}> is not read: it attaches another model. Save the compiled model as one file, by "
                "mujoco.mj_saveLastXML"
            )
        if element.tag == "flexcomp":
            raise DescriptionError(f"flexcomp {element.get('name', '')!r} is a soft body: only rigid bodies are read")
        element.attrib.pop("material", None)
        if element.tag in UNUSED_ELEMENTS and element.getparent() is not None:
            element.getparent().remove(element)
    for element in root.iter(etree.Element):  # the compiler would open these files, wherever they are
        name = next((name for name in element.attrib if str(name).startswith("file")), None)
        if name is not None and element.tag not in CHECKED_FILES:
            raise DescriptionError(f"<{element.tag}> names a file ({name}), which is not read: remove it")
    return root


def _parse(text: str | bytes, source: str) -> Element:
    """Return the root element of a text."""
    decoded = decode_urdf(text, source)
    refuse_external_references(decoded, source)
    try:
        return parse_xml(re.sub(r"^\s*<\?xml.*?\?>", "", decoded, count=1, flags=re.DOTALL).encode())
    except (etree.XMLSyntaxError, ValueError) as error:
        raise DescriptionError(f"{source} is not well-formed XML: {str(error)[:300]}") from None


def _include(root: Element, main: Path | None, folder: Path | None, included: set[str]) -> None:
    """Replace each <include> below an element by the content of its file; main: folder of the description."""
    for element in list(root.iter("include")):
        name = element.get("file", "")
        path = find_file(name, (folder, main), main)
        if str(path) in included:
            raise DescriptionError(f"file {name!r} is included more than once: MJCF includes a file once only")
        included.add(str(path))
        content = _parse(read_file_bytes(path, MAX_DESCRIPTION_LENGTH), name)
        _include(content, main, path.parent, included)
        parent = element.getparent()
        if parent is None:
            raise DescriptionError("the root element is <include>: MJCF has <mujoco>")
        position = parent.index(element)
        parent[position : position + 1] = list(content)


def find_file(name: str, folders: tuple[Path | None, ...], main: Path | None) -> Path:
    """Return the path of a file that a description names, relative to the first of some folders that has it.

    Raises DescriptionError unless it is a file inside the folder `main` of the description.
    """
    if main is None:
        raise DescriptionError(f"it names the file {name[:200]!r}, but this text has no file, whose folder has it")
    paths = [folder / name for folder in folders if folder is not None]
    path = next((path for path in paths if "\0" not in name and path.is_file()), None)
    if path is None:
        raise DescriptionError(f"file {name[:200]!r} does not exist in the folder of the description")
    path = path.resolve()
    if not path.is_relative_to(main.resolve()):
        raise DescriptionError(f"file {name[:200]!r} is not read: it is outside the folder of the description")
    return path
