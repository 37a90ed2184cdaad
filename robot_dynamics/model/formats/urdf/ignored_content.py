"""Checks of content that readers of URDFs drop without a message: misspelled, misplaced and foreign names.

A reader asks for the elements and attributes that it knows. `<Dynamics>`, `rpY`, a `<mass>` outside `<inertial>` and a
`<dynamics><damping>` are therefore ignored, and the dynamics are wrong. This package refuses such a text where it
changes the robot, and warns where the content may be an extension of another tool.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.similar_names import similar_name
from robot_dynamics.model.formats.urdf.document import USED_ELEMENTS, element_kind, local_name

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator

    from robot_dynamics.model.formats.urdf.document import Element, LineWarnings

ATTRIBUTES = {
    "origin": ("xyz", "rpy"),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "parent": ("link",),
    "child": ("link",),
    "axis": ("xyz",),
    "limit": ("lower", "upper", "velocity", "effort"),
    "dynamics": ("damping", "friction"),
    "mimic": ("joint", "multiplier", "offset"),
}
"""Attributes of the used elements that contain numbers or references."""

PARENTS = {tag: f"<{kind}>" for kind, tags in USED_ELEMENTS.items() if kind != "fixed joint" for tag in tags}
PARENTS |= {"origin": "<joint> or <inertial>"}  # the only element with two possible parents
SYNONYMS = dict.fromkeys(("pose", "com", "cog", "center_of_mass", "centre_of_mass"), "origin")
"""Names of the same thing in other formats."""

UNUSED_ELEMENTS = {
    "robot": ("material", "transmission", "gazebo", "sensor", "ros2_control"),
    "link": ("visual", "collision", "material", "contact"),
    "inertial": (),
    "joint": ("safety_controller", "calibration"),
}
"""Elements of URDF, or common in URDFs, that have no effect on dynamics."""

FOREIGN_ELEMENTS = ("gazebo", "ros2_control", "transmission", "sensor")  # their content has rules of its own
UNIT_ATTRIBUTES = ("unit", "units", "degrees", "degree")
ROTOR_ELEMENTS = ("rotorinertia", "motorinertia")  # compared without case, `_` and `-`


def check_ignored_content(root: Element, source: object, warnings: LineWarnings) -> None:
    """Check the content that the dynamics would ignore; root: the element <robot> with all its content.

    Raises DescriptionError, with the line and the correct name, where ignored content describes the robot. Adds a
    warning for names that are unknown but similar to none, and for springs, loops and rotors of simulators.
    """
    check = _IgnoredContent(source, warnings)
    check.container(root, "robot")
    check.simulator_content(root)


class _IgnoredContent:
    """Walks the used elements and their neighbours, and collects warnings."""

    def __init__(self, source: object, warnings: LineWarnings) -> None:
        self._source = source
        self.warnings = warnings

    def _fail(self, element: Element, message: str) -> NoReturn:
        """Raise DescriptionError with the line and the owner of an element."""
        raise DescriptionError(f"{self._source}, line {element.sourceline}: {_owner(element)}{message}")

    def container(self, element: Element, kind: str) -> None:
        """Check an element that contains used ones; kind: a key of USED_ELEMENTS."""
        used = USED_ELEMENTS[kind]
        if kind != "robot":
            self._container_attributes(element, used)
        for child in element.iterchildren(etree.Element):
            if child.tag not in used:
                self._unused_child(child, element, used)
            elif child.tag in USED_ELEMENTS:
                self.container(child, element_kind(child))
            else:
                self._leaf(child)

    def _container_attributes(self, element: Element, used: Iterable[str]) -> None:
        """Refuse attributes of <link>, <inertial> and <joint> that belong to an element inside."""
        inside = {
            tag: ATTRIBUTES.get(tag, ()) for tag in (*used, *(USED_ELEMENTS["inertial"] if "inertial" in used else ()))
        }
        for attribute in map(str, element.attrib):
            for tag, attributes in inside.items():
                if attribute not in ("name", "type") and attribute.lower() in (tag, *attributes):
                    self._fail(
                        element,
                        f"<{element.tag}> has {attribute}={element.get(attribute, '')[:60]!r}, which would be ignored: "
                        f"write it as an element <{tag}> inside",
                    )

    def _unused_child(self, child: Element, parent: Element, used: tuple[str, ...]) -> None:
        """Check a child that the dynamics do not use."""
        name = local_name(child)
        if child.tag != name:  # with a prefix or a namespace
            if name in used:
                self._fail(child, f"<{name}> has a namespace and would be ignored: remove its prefix or xmlns")
        elif name not in FOREIGN_ELEMENTS:
            self._unused_name(child, parent, used)
        if name not in FOREIGN_ELEMENTS:
            for element in child.iterdescendants(etree.Element):
                if _describes_robot(element):
                    self._fail(
                        element,
                        f"<{element.tag}> is inside <{name[:60]}> and would be ignored: "
                        f"it belongs in {PARENTS[element.tag]}",
                    )

    def _unused_name(self, child: Element, parent: Element, used: tuple[str, ...]) -> None:
        """Check the name of a child that is not an element of its parent."""
        name, parent_tag = str(child.tag), str(parent.tag)
        if name in (*UNUSED_ELEMENTS[parent_tag], *USED_ELEMENTS[parent_tag]):
            return
        if (parent_tag, name) == ("link", "origin"):
            if any(_has_nonzero_word(child.get(attribute, "")) for attribute in ATTRIBUTES["origin"]):
                self.warnings.add(child, "<origin> in <link> is ignored: the <origin> of its joint places a link")
            return
        if name in PARENTS:
            self._fail(child, f"<{name}> is in <{parent_tag}> and would be ignored: it belongs in {PARENTS[name]}")
        for tag in used:
            if name.lower() in ATTRIBUTES.get(tag, ()):
                self._fail(child, f"<{name}> would be ignored: it is an attribute, <{tag} {name.lower()}='...'>")
        intended = SYNONYMS.get(name.lower()) or similar_name(name, used)
        if intended in used and _is_needed(child, parent, str(intended)):
            self._fail(child, f"<{name[:60]}> is not an element of <{parent_tag}>: the name is <{intended}>")
        if parent_tag in ("inertial", "joint") and used != USED_ELEMENTS["fixed joint"]:
            self.warnings.add(child, f"<{name[:60]}> in <{parent_tag}> is ignored: it is not an element of URDF")

    def _leaf(self, element: Element) -> None:
        """Check a used element whose data are its attributes."""
        known = ATTRIBUTES[element.tag]
        example = " ".join(f"{name}='...'" for name in known)
        for child in element.iterchildren(etree.Element):
            if local_name(child).lower() in (*known, *PARENTS):
                self._fail(
                    child,
                    f"<{local_name(child)}> inside <{element.tag}> would be ignored: write <{element.tag} {example}/>, "
                    "and no element inside",
                )
        if _has_text(element):
            self._fail(element, f"<{element.tag}> contains text, which is ignored: write <{element.tag} {example}/>")
        unknown = [str(attribute) for attribute in element.attrib if attribute not in known]
        for attribute in unknown:
            self._unknown_attribute(element, attribute, known)
        if _attributes_matter(element):
            names = [name[:60] for name in unknown if "}" not in name]
            if names:
                self.warnings.add(
                    element,
                    f"<{element.tag}> has {', '.join(names[:10])}, ignored: its attributes are {', '.join(known)}",
                )

    def _unknown_attribute(self, element: Element, attribute: str, known: tuple[str, ...]) -> None:
        """Refuse an unknown attribute that replaces a known one or changes its meaning."""
        name = attribute.rpartition("}")[2]
        start = f"<{element.tag}> has {name[:60]}={element.get(attribute, '')[:60]!r}, which would be ignored: "
        if name.lower() in UNIT_ATTRIBUTES:
            self._fail(element, f"{start}URDF has the units m, rad, kg, N and s only. Convert the numbers")
        if element.tag == "origin" and name.lower().startswith("quat"):
            self._fail(element, f"{start}write the rotation as rpy='roll pitch yaw' [rad] alone")
        intended = similar_name(name, known)
        if intended is not None and element.get(intended) is None:
            self._fail(element, f"{start}the attribute is {intended}")
        missing = [name for name in known if element.get(name) is None]
        if element.tag == "origin" and missing and "}" not in attribute:
            self._fail(element, f"{start}{missing[0]} is missing, and zeros would be taken")

    def simulator_content(self, root: Element) -> None:
        """Warn of springs, closed loops and rotor inertias in the elements of simulators and drives."""
        for element in _content_of(root, "gazebo"):
            name = element.tag
            if name == "springStiffness" and _has_nonzero_word(element.text or ""):
                self.warnings.add(
                    element, "the <springStiffness> in <gazebo> is ignored: a YAML that completes the URDF has springs"
                )
            parent, child = element.findtext("parent"), element.findtext("child")
            if name == "joint" and parent and child:
                self.warnings.add(
                    element,
                    f"joint {element.get('name', '')[:60]!r} in <gazebo> from {parent.strip()[:60]!r} to "
                    f"{child.strip()[:60]!r} is ignored: a YAML that completes the URDF has closed loops",
                )
        for element in _content_of(root, "transmission"):
            name = local_name(element)
            if name.lower().replace("_", "").replace("-", "") in ROTOR_ELEMENTS:
                self.warnings.add(
                    element,
                    f"the <{name}> in <transmission> is ignored: an MDH table in YAML has rotor_inertia, "
                    "referred to the joint",
                )


def _owner(element: Element) -> str:
    """Return `link 'a': ` or `joint 'j': ` of the first link or joint around an element, else an empty text."""
    for ancestor in (element, *element.iterancestors()):
        if ancestor.tag in USED_ELEMENTS["robot"] and ancestor.get("name"):
            return f"{ancestor.tag} {ancestor.get('name')[:60]!r}: "
    return ""


def _is_needed(child: Element, parent: Element, intended: str) -> bool:
    """Return whether a child stands for `intended`: links and joints have a name, all other elements occur once."""
    return child.get("name") is not None if parent.tag == "robot" else parent.find(intended) is None


def _describes_robot(element: Element) -> bool:
    """Return whether an element at any level is the inertia of a link, or a joint between links, of URDF."""
    if element.tag == "inertial":
        return element.find("mass[@value]") is not None
    return element.tag == "joint" and element.find("parent[@link]") is not None


def _attributes_matter(element: Element) -> bool:
    """Return whether unknown attributes of an element deserve a warning."""
    if element.tag == "limit":  # tools add limits of their own; they matter where a limit of URDF is missing
        return any(element.get(name) is None for name in ATTRIBUTES["limit"])
    return True


def _has_text(element: Element) -> bool:
    """Return whether an element contains text besides blanks."""
    return any(text.strip() for text in (element.text or "", *(child.tail or "" for child in element)))


def _has_nonzero_word(text: str) -> bool:
    """Return whether a text has a word that is not the number 0."""
    return any(word.strip("+-0.") for word in text.split())


def _content_of(root: Element, tag: str) -> Iterator[Element]:
    """Return all elements inside the children of <robot> with a tag."""
    for element in root.iterchildren(tag):
        yield from element.iterdescendants(etree.Element)
