"""Checks of the text of a mesh before a parser expands it: a small file can describe a mesh larger than the memory."""

from __future__ import annotations

import json
import math
import re
from typing import TYPE_CHECKING, Any, NamedTuple
from xml.parsers import expat

import numpy as np
from lxml import etree

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.viewing.mesh_materials import with_flat_gltf_materials

if TYPE_CHECKING:
    from robot_dynamics.model.formats.urdf.document import Element

MAX_FACES = 3_000_000
"""Most triangles of a mesh; the largest real ones have a few hundred thousand."""

MAX_TEXT_BYTES = 64 * 1024 * 1024  # of a .dae or .obj: their parsers need twenty times the size of the file
MAX_DEPTH = 200  # of nested nodes


class SafeMesh(NamedTuple):
    """A mesh that a parser may read.

    Attributes
    ----------
    content : bytes
        The content of the file, without what a parser should not see.
    unit : float
        Length of its unit [m].
    """

    content: bytes
    unit: float = 1.0


def check_mesh_text(content: bytes, kind: str) -> SafeMesh:
    """Return the content of a file of a kind (``".dae"``) for its parser.

    Raises
    ------
    InvalidInputError
        If it would read other files or is too large.
    """
    if kind in (".dae", ".obj") and len(content) > MAX_TEXT_BYTES:
        raise InvalidInputError(f"it has {len(content)} bytes, more than {MAX_TEXT_BYTES} of text")
    if kind == ".dae":
        return _check_collada(content)
    if kind == ".glb":
        return SafeMesh(with_flat_gltf_materials(content, _checked_gltf(content)))
    return SafeMesh(content)


def _checked_gltf(content: bytes) -> dict[str, Any]:
    """Return the header. InvalidInputError for accessors larger than a mesh may be, and for buffers in other files."""
    length = int.from_bytes(content[12:16], "little")
    header: dict[str, Any] = json.loads(content[20 : 20 + length])
    count = sum(int(accessor["count"]) for accessor in header.get("accessors", ()))
    if not 0 <= count <= 6 * MAX_FACES or any(accessor["count"] < 0 for accessor in header.get("accessors", ())):
        raise InvalidInputError(f"its accessors have {count} elements, more than {6 * MAX_FACES}")
    if any("uri" in buffer for buffer in header.get("buffers", ())):
        raise InvalidInputError("its buffers are in other files")
    return header


def _check_collada(content: bytes) -> SafeMesh:
    """Return a COLLADA file without images and textures, and its unit."""
    _refuse_document_type(content)
    # without a document type there are no entities to expand; coordinates of 10 MB need huge_tree
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True)
    root = etree.fromstring(content, parser)
    if root.getroottree().docinfo.internalDTD is not None or root.getroottree().docinfo.doctype:
        raise InvalidInputError("it has a document type")
    _remove_textures(root)
    _Corners(root).check()
    unit = root.find("{*}asset/{*}unit")
    metres = float(unit.get("meter", 1)) if unit is not None else 1.0
    if not 0 < metres < math.inf:
        raise InvalidInputError("its unit is not a length")
    return SafeMesh(etree.tostring(root, encoding="utf-8", xml_declaration=True), metres)


def _remove_textures(root: Element) -> None:
    """Remove images, and all in effects that refers to them: pycollada drops a geometry whose texture is missing."""
    unused = root.findall("{*}library_images")
    for effects in root.iterfind("{*}library_effects"):
        unused += [texture.getparent() for texture in effects.iter("{*}texture")]
        unused += [image.getparent() for image in effects.iter("{*}surface", "{*}sampler2D")]
    for element in dict.fromkeys(unused):
        element.getparent().remove(element)


def _refuse_document_type(content: bytes) -> None:
    """Raise InvalidInputError where a text declares a document type, in any encoding, before its entities are read."""
    parser = expat.ParserCreate()

    def refuse(*_: object) -> None:
        raise InvalidInputError("it has a document type")

    def stop(*_: object) -> None:
        raise StopIteration

    parser.StartDoctypeDeclHandler = refuse
    parser.StartElementHandler = stop
    try:
        parser.Parse(content, True)
    except StopIteration:
        return


class _Corners:
    """Counts the corners of the triangles that the nodes of a COLLADA file instantiate, some of them many times."""

    def __init__(self, root: Element) -> None:
        self._root = root
        self._nodes = {element.get("id"): element for element in root.iter("{*}node")}
        self._geometries = {
            element.get("id"): _geometry_corners(element)
            for element in root.iterfind("{*}library_geometries/{*}geometry")
        }
        self._counts: dict[Element, int] = {}
        self._open: set[Element] = set()

    def check(self) -> None:
        """Raise InvalidInputError where there are too many, or where a node contains itself."""
        count = sum(
            self._count(node) for node in self._root.iterfind("{*}library_visual_scenes/{*}visual_scene/{*}node")
        )
        if count > 3 * MAX_FACES:
            raise InvalidInputError(f"it has more than {MAX_FACES} triangles")

    def _count(self, node: Element) -> int:
        """Return the corners of a node and all that it contains, at least one for each node."""
        if node in self._counts:
            return self._counts[node]
        if node in self._open or len(self._open) > MAX_DEPTH:
            raise InvalidInputError("its nodes contain themselves, or are nested too deeply")
        self._open.add(node)
        count = 1
        for child in node.iterchildren("{*}node", "{*}instance_node", "{*}instance_geometry"):
            reference = child.get("url", "").removeprefix("#")
            if etree.QName(child).localname == "instance_geometry":
                count += 1 + self._geometries.get(reference, 0)
            else:
                inner = self._nodes.get(reference) if etree.QName(child).localname == "instance_node" else child
                count += 1 if inner is None else self._count(inner)
        self._open.remove(node)
        self._counts[node] = count
        return count


def _geometry_corners(geometry: Element) -> int:
    """Return an upper bound of three times the triangles of a geometry, from the indices of its primitives."""
    corners = 0
    for primitive in geometry.iterfind("{*}mesh/*"):
        indices = sum(len(_integers(element)) for element in primitive.iter("{*}p"))
        offsets = [int(element.get("offset", 0)) for element in primitive.iterfind("{*}input")]
        corners += 3 * indices // (1 + max(offsets, default=0))
        for element in primitive.iterfind("{*}vcount"):
            if not 0 <= int(_integers(element).sum()) <= indices or _integers(element).min(initial=0) < 0:
                raise InvalidInputError("its polygons have more corners than indices")
    return corners


def _integers(element: Element) -> Any:
    """Return the integers of the text of an element."""
    text = element.text or ""
    if not re.fullmatch(r"[\d\s+-]*", text):
        raise InvalidInputError("its indices are not integers")
    return np.array(text.split(), dtype=np.int64)
