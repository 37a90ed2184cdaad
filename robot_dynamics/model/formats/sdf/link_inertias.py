"""Inertias of the links of an SDF, about the origins of their frames."""

from __future__ import annotations

from typing import TYPE_CHECKING

from lxml import etree

from robot_dynamics.model.inertia import Inertia, symmetric_matrix

if TYPE_CHECKING:
    from robot_dynamics.model.formats.sdf.document import SdfDocument
    from robot_dynamics.model.formats.urdf.document import Element

DEFAULT_MASS = 1.0
DEFAULT_INERTIA = {"ixx": 1.0, "ixy": 0.0, "ixz": 0.0, "iyy": 1.0, "iyz": 0.0, "izz": 1.0}
"""What SDF defines for a link where the description has nothing [kg, kg m²]."""


def read_inertia(document: SdfDocument, link: Element, name: str) -> Inertia:
    """Return the inertia of a link; name: its full name, for messages."""
    inertial = document.child(link, "inertial")
    moments = symmetric_matrix(*DEFAULT_INERTIA.values())
    if inertial is None:
        message = f"link {name!r} has no <inertial>: SDF defines 1 kg and 1 kg m² about each axis"
        document.warnings.add(link, message, "<inertial>")
        return Inertia(DEFAULT_MASS, second_moments=moments)
    document.check_children(inertial, "inertial")
    if inertial.get("auto", "false").lower() in ("true", "1"):
        document.fail(
            inertial,
            f"link {name!r} has an inertia from its shapes (auto), which is not computed: write <mass>, "
            "<pose> and <inertia>",
        )
    added = document.child(inertial, "fluid_added_mass")
    if added is not None and any(
        document.number(added, str(child.tag), 0.0) for child in added.iter(etree.Element) if child is not added
    ):
        document.fail(added, f"link {name!r} has <fluid_added_mass>: no model here has it. Remove it")
    mass = document.number(inertial, "mass", DEFAULT_MASS)
    if mass < 0:
        document.fail(inertial, f"link {name!r}: mass {mass:g} kg is negative")
    inertia = document.child(inertial, "inertia")
    if inertia is not None:
        document.check_children(inertia, "inertia")
        entries = [document.number(inertia, tag, default) for tag, default in DEFAULT_INERTIA.items()]
        moments = symmetric_matrix(*entries)
    missing = [tag for tag, element in (("mass", inertial.find("mass")), ("inertia", inertia)) if element is None]
    if missing:
        message = f"link {name!r} has no <{missing[0]}>: SDF defines 1 kg and 1 kg m² about each axis"
        document.warnings.add(inertial, message, "<inertial>")
    pose = document.child(inertial, "pose")
    if pose is not None and pose.get("relative_to"):
        document.fail(
            pose, f"link {name!r}: the <pose> of an <inertial> is in the frame of the link. Remove relative_to"
        )
    return Inertia.about_centre_of_mass(mass, moments, document.pose(pose))
