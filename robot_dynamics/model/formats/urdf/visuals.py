"""The elements <visual> of a URDF. Readers of URDFs disagree on faulty ones, and the dynamics do not need them.

A visual that cannot be read is therefore left out with a warning, never an error: such a URDF has loaded before.
Materials are found as urdfdom finds them: by name first among those of the robot, then among those of earlier links.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from lxml import etree

from robot_dynamics.model.formats.urdf.validation import check_numbers, check_origin
from robot_dynamics.model.placement import placement, rotation_from_roll_pitch_yaw
from robot_dynamics.model.visual import BoxShape, CylinderShape, MeshShape, SphereShape, Visual

if TYPE_CHECKING:
    from collections.abc import Iterator

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.urdf.document import Element, LineWarnings
    from robot_dynamics.model.visual import Shape

MAX_VISUALS = 10_000  # real robots have two hundred; the text of a URDF has room for 200 000
DIMENSIONS = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}}
"""Shapes with their attributes, all required, and how many numbers each has."""

Colour = tuple[float, float, float, float]


class _UnreadableError(Exception):
    """A visual or a material cannot be read."""


def read_visuals(root: Element, folder: Path | None, warnings: LineWarnings) -> list[Visual]:
    """Return the visuals of all links, in the order of the text.

    Parameters
    ----------
    root : Element
        The element <robot> with all its content.
    folder : Path or None
        Folder of the file of the description, None where it has none.
    warnings : LineWarnings
        Receives a warning for each visual that is left out, and for each unreadable colour.
    """
    return list(_Reader(root, folder, warnings).visuals())


class _Reader:
    """Reads the visuals link by link, and collects the materials that have a name."""

    def __init__(self, root: Element, folder: Path | None, warnings: LineWarnings) -> None:
        self._root = root
        self._folder = folder
        self._warnings = warnings
        self._colours: dict[str, Colour | None] = {}
        for material in root.iterchildren("material"):
            self._register(material, "the robot")

    def visuals(self) -> Iterator[Visual]:
        """Yield the visuals."""
        visuals = (visual for link in self._root.iterchildren("link") for visual in link.iterchildren("visual"))
        drawn = (element for element in visuals if element.find("geometry") is not None)
        for number, element in enumerate(drawn):
            if number >= MAX_VISUALS:
                self._warnings.add(element, f"more than {MAX_VISUALS} visuals: the others are not drawn")
                continue
            owner = f"link {element.getparent().get('name', '')[:60]!r}"
            try:
                yield self._visual(element, owner)
            except _UnreadableError as error:
                self._warnings.add(element, f"{error}; the <visual> is not drawn", "<visual>")

    def _visual(self, element: Element, owner: str) -> Visual:
        """Return the visual of an element; owner: its link, for messages."""
        check_origin(element, owner, _fail)
        origin = element.find("origin")
        return Visual(
            element.getparent().get("name", ""),
            np.eye(4) if origin is None else _placement(origin),
            self._shape(element, owner),
            self._colour(element.find("material"), owner),
            element.get("name"),
        )

    def _shape(self, element: Element, owner: str) -> Shape:
        """Return the shape of a visual: the first in its <geometry>."""
        shape = next(element.iterfind("geometry/*"), None)
        if shape is None:
            raise _UnreadableError(f"{owner}: <geometry> has no shape")
        if shape.tag == "mesh":
            return self._mesh(shape, owner)
        if shape.tag not in DIMENSIONS:
            known = ", ".join(("mesh", *DIMENSIONS))
            raise _UnreadableError(f"{owner}: <{str(shape.tag)[:60]}> is not a shape of URDF: known are {known}")
        numbers = {name: _numbers(shape, name, count, owner) for name, count in DIMENSIONS[shape.tag].items()}
        if any((values < 0).any() for values in numbers.values()):
            raise _UnreadableError(f"{owner}: <{shape.tag}> has a negative length")
        if shape.tag == "box":
            return BoxShape(numbers["size"])
        if shape.tag == "sphere":
            return SphereShape(float(numbers["radius"][0]))
        return CylinderShape(float(numbers["radius"][0]), float(numbers["length"][0]))

    def _mesh(self, element: Element, owner: str) -> MeshShape:
        """Return the shape of an element <mesh>."""
        file = element.get("filename")
        if not file:
            raise _UnreadableError(f"{owner}: <mesh> has no filename")
        scale = np.ones(3) if element.get("scale") is None else _numbers(element, "scale", 3, owner)
        return MeshShape(file, scale, self._folder)

    def _colour(self, material: Element | None, owner: str) -> Colour | None:
        """Return the colour of a visual, None where it has none."""
        if material is None:
            return None
        name = material.get("name", "")
        return self._colours[name] if name in self._colours else self._register(material, owner)

    def _register(self, material: Element, owner: str) -> Colour | None:
        """Return the colour that a material defines, None where it has none, and keep it by its name."""
        element, name = material.find("color"), material.get("name", "")
        if element is None and material.find("texture") is None:
            return None  # a reference by name
        colour = None if element is None else self._read_colour(element, owner)
        if name:
            self._colours.setdefault(name, colour)
        return colour

    def _read_colour(self, element: Element, owner: str) -> Colour | None:
        """Return the colour of an element <color>, None with a warning where it cannot be read."""
        try:
            red, green, blue, opacity = _numbers(element, "rgba", 4, owner).clip(0, 1).tolist()
        except _UnreadableError as error:
            self._warnings.add(element, f"{error}; the colour is ignored", "<color>")
            return None
        return red, green, blue, opacity


def _placement(origin: Element) -> Array:
    """Return the placement (4, 4) of a checked <origin>."""
    xyz, rpy = ([float(word) for word in origin.get(name, "0 0 0").split()] for name in ("xyz", "rpy"))
    return placement(rotation_from_roll_pitch_yaw(*rpy), xyz)


def _numbers(element: Element, attribute: str, count: int, owner: str) -> Array:
    """Return the numbers (count,) of an attribute that must exist."""
    text: str | None = element.get(attribute)
    if text is None:
        raise _UnreadableError(f"{owner}: <{element.tag}> has no {attribute}")
    check_numbers(element, attribute, count, owner, _fail)
    return np.array([float(word) for word in text.split()])


def _fail(_: etree._Element, message: str) -> NoReturn:
    """Raise the error of this file with the message of a check."""
    raise _UnreadableError(message)
