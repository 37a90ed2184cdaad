"""Visuals of a robot to elements <visual>, which `read_visuals` reads back as the same visuals.

A hull, which URDF has not, is written as the primitives of `hull_primitives`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from robot_dynamics.model.formats.urdf.written_numbers import insert_origin, write_number, write_vector
from robot_dynamics.model.visual import BoxShape, CylinderShape, HullShape, MeshShape, SphereShape

if TYPE_CHECKING:
    from robot_dynamics.model.formats.urdf.document import Element
    from robot_dynamics.model.visual import Shape, Visual


def add_visual(link: Element, visual: Visual) -> None:
    """Add a <visual> to the element of the URDF link that stands at the frame of the visual."""
    element = etree.SubElement(link, "visual")
    if visual.name is not None:
        element.set("name", visual.name)
    _add_shape(etree.SubElement(element, "geometry"), visual.shape)
    if visual.colour is not None:
        # RViz finds the colour of a shape by its name on the link: one without a name has that of the first shape
        rgba = write_vector(visual.colour)
        material = etree.SubElement(element, "material", name=f"rgba {rgba}")
        etree.SubElement(material, "color", rgba=rgba)
    insert_origin(element, visual.placement, min(1.0, float(np.abs(visual.placement[:3, 3]).max())))


def _add_shape(geometry: Element, shape: Shape) -> None:
    """Add the element of a shape to <geometry>."""
    if isinstance(shape, BoxShape):
        etree.SubElement(geometry, "box", size=write_vector(shape.size))
    elif isinstance(shape, CylinderShape):
        radius, length = write_number(shape.radius), write_number(shape.length)
        etree.SubElement(geometry, "cylinder", radius=radius, length=length)
    elif isinstance(shape, SphereShape):
        etree.SubElement(geometry, "sphere", radius=write_number(shape.radius))
    elif isinstance(shape, MeshShape):
        mesh = etree.SubElement(geometry, "mesh", filename=shape.file)
        if not np.array_equal(shape.scale, np.ones(3)):
            mesh.set("scale", write_vector(shape.scale))
    else:
        raise TypeError("URDF has no hull: write its primitives")


def list_numbers(visual: Visual) -> tuple[object, ...]:
    """Return all numbers of a visual."""
    shape = visual.shape
    if isinstance(shape, CylinderShape):
        sizes: tuple[object, ...] = (shape.radius, shape.length)
    elif isinstance(shape, SphereShape):
        sizes = (shape.radius,)
    elif isinstance(shape, HullShape):
        sizes = (shape.points, shape.radius)
    else:
        sizes = (shape.size if isinstance(shape, BoxShape) else shape.scale,)
    return (visual.placement, *sizes, *(visual.colour or ()))


def list_texts(visual: Visual) -> list[str]:
    """Return all texts of a visual but the name of its frame."""
    texts = [] if visual.name is None else [visual.name]
    return [*texts, visual.shape.file] if isinstance(visual.shape, MeshShape) else texts
