"""The elements <visual> of an SDF as shapes that a viewer draws. One that cannot be read is left out with a warning."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.sdf.inclusion import find_resource
from robot_dynamics.model.visual import BoxShape, CylinderShape, HullShape, MeshShape, SphereShape, Visual

if TYPE_CHECKING:
    from robot_dynamics.model.formats.sdf.document import SdfDocument
    from robot_dynamics.model.formats.urdf.document import Element
    from robot_dynamics.model.visual import Shape

SHAPES = ("box", "capsule", "cylinder", "mesh", "sphere")

Colour = tuple[float, float, float, float]


def read_visuals(document: SdfDocument, link: Element, name: str) -> list[Visual]:
    """Return the visuals of a link; name: its full name."""
    visuals = []
    for element in link.iterchildren("visual"):
        try:
            visual = _visual(document, element, name)
        except DescriptionError as error:
            message = f"link {name!r}: {str(error).split(': ', 1)[-1]}; the <visual> is not drawn"
            document.warnings.add(element, message, "<visual>")
            continue
        if visual is not None:
            visuals.append(visual)
    return visuals


def _visual(document: SdfDocument, element: Element, frame: str) -> Visual | None:
    """Return the visual of an element, None where it has a shape that is not drawn."""
    pose = document.child(element, "pose")
    if pose is not None and pose.get("relative_to") and pose.get("relative_to") != frame.rpartition("::")[2]:
        document.fail(pose, "the <pose> of a <visual> is read in the frame of its link only")
    geometry = document.child(element, "geometry")
    shape = None if geometry is None else _shape(document, geometry)
    if shape is None:
        return None
    return Visual(frame, document.pose(pose), shape, _colour(document, element), element.get("name"))


def _shape(document: SdfDocument, geometry: Element) -> Shape | None:
    """Return the shape of an element <geometry>, None where it is none of SHAPES."""
    tag = next((tag for tag in SHAPES if geometry.find(tag) is not None), None)
    if tag is None:
        return None
    element = geometry.find(tag)
    if tag == "mesh":
        uri = document.text(element, "uri") or ""
        scale = element.find("scale")
        path = find_resource(uri, document.folder)
        if path is None:
            document.fail(element, f"mesh {uri[:200]!r} is not found")
        return MeshShape(f"file://{path}", np.ones(3) if scale is None else document.vector(scale), document.folder)
    if tag == "box":
        size = document.child(element, "size")
        return BoxShape(np.ones(3) if size is None else document.vector(size))
    radius, length = document.number(element, "radius", 1.0), document.number(element, "length", 1.0)
    if tag == "sphere":
        return SphereShape(radius)
    if tag == "capsule":
        return HullShape(np.array([[0.0, 0.0, -length / 2], [0.0, 0.0, length / 2]]), radius)
    return CylinderShape(radius, length)


def _colour(document: SdfDocument, visual: Element) -> Colour | None:
    """Return the diffuse colour of a visual, None where it has none that is read."""
    element = visual.find("material/diffuse")
    words = (element.text or "").split() if element is not None else []
    if len(words) not in (3, 4):
        return None
    try:
        red, green, blue, opacity = np.clip([*map(float, words), 1.0][:4], 0.0, 1.0).tolist()
    except ValueError:
        return None
    return red, green, blue, opacity * (1.0 - min(max(document.number(visual, "transparency", 0.0), 0.0), 1.0))
