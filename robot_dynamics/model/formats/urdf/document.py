"""The text of a URDF as an XML tree that is safe to interpret.

yourdfpy repairs broken XML, replaces a missing moment of inertia by 1 and accepts any joint type. This module refuses
such texts, with the line of the error, before yourdfpy reads them.
"""

import logging
import math
import re
from collections.abc import Callable, Mapping
from typing import NoReturn, TypeAlias

from lxml import etree

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import decode_text

logger = logging.getLogger(__name__)

MAX_DESCRIPTION_LENGTH = 10 * 1024 * 1024  # characters; the largest real descriptions have half a million

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating")
# elements that the dynamics use; all others (shapes, colours, controllers, simulators) are removed unread
USED_ELEMENTS = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
    "fixed joint": ("parent", "child", "origin"),
}
INERTIAL_ATTRIBUTES = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
JOINT_ATTRIBUTES = {
    "limit": ("lower", "upper", "velocity", "effort"),
    "dynamics": ("damping", "friction"),
    "mimic": ("multiplier", "offset"),
}
XINCLUDE = "http://www.w3.org/2001/XInclude"
UNEXPANDED = "is xacro. Expand it first: xacro robot.urdf.xacro > robot.urdf"
UNDECLARED = "its prefix is not declared. A URDF needs none: remove it"
# elements of xacro itself: they show a text that was not expanded; others are calls of unknown macros
XACRO_ELEMENTS = ("arg", "attribute", "call", "element", "if", "include", "insert_block", "macro", "property", "unless")

Element: TypeAlias = etree._Element
Fail: TypeAlias = Callable[[Element, str], NoReturn]
"""Raises DescriptionError with a message and the line of an element."""


def parse_urdf_text(text: str | bytes, source: object) -> Element:
    """Return the root element <robot> of a URDF, without elements that the dynamics do not use.

    Only the text itself is read: no DTD, no entity, no include.

    Parameters
    ----------
    text : str or bytes
        The URDF, or the bytes of its file.
    source : object
        Name of the description in error messages.
    """
    text = decode_urdf(text, source)
    refuse_external_references(text, source)
    declaration = re.match(r"\s*<\?xml.*?\?>", text, re.DOTALL)
    if declaration:  # the text is decoded already, so its declared encoding must go; line numbers stay
        text = "\n" * declaration.group().count("\n") + text[declaration.end() :]
    try:
        root = parse_xml(text.encode("utf-8"))
    except (etree.XMLSyntaxError, ValueError) as error:
        raise DescriptionError(f"{source} is not well-formed XML: {error}") from None
    if root.tag != "robot":
        if etree.QName(root).namespace is not None and etree.QName(root).localname == "robot":
            raise DescriptionError(f"{source}: <robot> has a namespace of its own. Remove its attribute xmlns")
        raise DescriptionError(f"{source}: the root element is <{root.tag}>, a URDF has <robot>")
    refuse_includes(root, source)
    check_unexpanded_elements(root, source)
    remove_unused_elements(root, "robot")
    return root


def parse_xml(text: bytes) -> Element:
    """Return the root element of a text. A prefix that is not declared remains part of the name, `prefix:name`.

    Raises XMLSyntaxError for all other texts that are not well-formed.
    """
    settings = {"resolve_entities": False, "no_network": True, "load_dtd": False, "huge_tree": False}
    try:
        return etree.fromstring(text, etree.XMLParser(**settings))
    except etree.XMLSyntaxError as error:
        parser = etree.XMLParser(recover=True, **settings)
        root = etree.fromstring(text, parser)
        if root is None or any(entry.type_name != "NS_ERR_UNDEFINED_NAMESPACE" for entry in parser.error_log):
            raise error from None
    for element in root.iter(etree.Element):
        for attribute in [name for name in element.attrib if ":" in name and not name.startswith("{")]:
            del element.attrib[attribute]
    return root


def remove_unused_elements(element: Element, kind: str) -> None:
    """Remove from an element all that the dynamics do not use; kind: a key of USED_ELEMENTS."""
    for child in list(element):
        if child.tag not in USED_ELEMENTS[kind]:
            element.remove(child)
        elif child.tag in USED_ELEMENTS:
            is_fixed = child.tag == "joint" and child.get("type") in ("fixed", "floating")
            remove_unused_elements(child, "fixed joint" if is_fixed else child.tag)


def decode_urdf(text: str | bytes, source: object) -> str:
    """Return a URDF as str; bytes have the encoding of their XML declaration, else UTF-8."""
    encoding = "utf-8-sig"
    if isinstance(text, bytes):
        declared = re.match(rb"\s*<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)", text)
        encoding = declared.group(1).decode() if declared else encoding
    return decode_text(text, source, "a URDF", MAX_DESCRIPTION_LENGTH, encoding)


def refuse_external_references(text: str, source: object) -> None:
    """Raise DescriptionError where a text declares a document type or an entity."""
    for pattern, construct in ((r"<!\s*DOCTYPE", "a DOCTYPE"), (r"<!\s*ENTITY", "an entity")):
        match = re.search(pattern, text, re.IGNORECASE)
        if match:
            line = text.count("\n", 0, match.start()) + 1
            raise DescriptionError(f"{source}, line {line}: {refusal_message(construct)}")


def refusal_message(construct: str) -> str:
    """Return the message for a construct of XML that could read other files."""
    return f"{construct} is refused, a URDF needs none and it could read other files. Remove it"


def refuse_includes(root: Element, source: object) -> None:
    """Raise DescriptionError where an element would read another file; an unused XInclude namespace is harmless."""
    for element in root.iter(f"{{{XINCLUDE}}}*", "xi:*", "xi:include", "xi:fallback"):
        raise DescriptionError(f"{source}, line {element.sourceline}: {refusal_message('an XInclude')}")


def check_unexpanded_elements(root: Element, source: object) -> None:
    """Check elements of xacro and elements with a prefix that is not declared.

    Raises DescriptionError where such an element may contain data of the robot, and logs a warning for the others.
    """
    ignored: dict[str, list[int]] = {}
    for element in root.iter(etree.Element):
        name = unexpanded_name(element)
        if name is None:
            continue
        reason = _refusal_of_unexpanded(element, name, root)
        if reason is not None:
            raise DescriptionError(f"{source}, line {element.sourceline}: <{name}> {reason}")
        ignored.setdefault(name, []).append(element.sourceline)
    for name, (line, *more) in ignored.items():
        count = f" and {len(more)} more" if more else ""
        logger.warning(
            "%s, line %d%s: <%s> is ignored: it was not expanded, or its prefix is not declared. It is neither a link "
            "nor a joint",
            source,
            line,
            count,
            name,
        )


def _refusal_of_unexpanded(element: Element, name: str, root: Element) -> str | None:
    """Return why an unexpanded element may contain data of the robot, None where it cannot."""
    parent = element.getparent()
    prefix, _, local = name.rpartition(":")
    reason = UNEXPANDED if prefix == "xacro" else UNDECLARED
    if prefix == "xacro" and (local in XACRO_ELEMENTS or root.find("link") is None):
        return reason
    if parent is root and any(local_name(inner) in USED_ELEMENTS["robot"] for inner in element.iter(etree.Element)):
        return f"has a link or joint, and {reason}"
    if parent is not root and is_used(parent):
        return f"is in a <{parent.tag}>, and {reason}"
    return None


def unexpanded_name(element: Element) -> str | None:
    """Return `prefix:name` of an element of xacro or with a prefix that is not declared; None of other elements."""
    tag: str = element.tag
    if not tag.startswith("{"):
        return tag if ":" in tag else None
    name = etree.QName(element)
    return f"xacro:{name.localname}" if "xacro" in name.namespace else None


def local_name(element: Element) -> str:
    """Return the name of an element without its prefix, declared or not."""
    return re.split("[}:]", element.tag)[-1]


def is_used(element: Element) -> bool:
    """Return whether the dynamics use an element and all its ancestors."""
    parent = element.getparent()
    return parent is None or (element.tag in USED_ELEMENTS.get(parent.tag, ()) and is_used(parent))


def check_urdf(root: Element, source: object) -> None:
    """Raise DescriptionError, with the line and the element, for data that no reader can interpret.

    This checks names, references, types and numbers. The reader checks that links and joints form one tree.
    """

    def fail(element: Element, message: str) -> NoReturn:
        raise DescriptionError(f"{source}, line {element.sourceline}: {message}")

    if root.get("name") is None:
        root.set("name", "robot")
    links = children_by_name(root, "link", fail)
    if not links:
        fail(root, "there is no <link>: a robot has at least one")
    for name, link in links.items():
        check_inertial(name, link, fail)
    for name, joint in children_by_name(root, "joint", fail).items():
        check_urdf_joint(name, joint, links, fail)


def children_by_name(root: Element, tag: str, fail: Fail) -> dict[str, Element]:
    """Return the children with a tag by their names, which must exist and be unique."""
    children: dict[str, Element] = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            fail(element, f"this <{tag}> has no name")
        if name in children:
            line = children[name].sourceline
            fail(element, f"{tag} {name!r} is already defined at line {line}: names must be unique")
        children[name] = element
    return children


def check_inertial(name: str, link: Element, fail: Fail) -> None:
    """Check the element <inertial> of a link."""
    owner = f"link {name!r}"
    refuse_duplicates(link, owner, fail)
    inertial = link.find("inertial")
    if inertial is None:
        return
    refuse_duplicates(inertial, owner, fail)
    check_origin(inertial, owner, fail)
    for tag, attributes in INERTIAL_ATTRIBUTES.items():
        element = inertial.find(tag)
        if element is None:
            fail(inertial, f"{owner} has an <inertial> without <{tag}>: add it, or omit <inertial> if massless")
        for attribute in attributes:
            if element.get(attribute) is None:
                fail(element, f"{owner}: <{tag}> lacks {attribute}")
            check_numbers(element, attribute, 1, owner, fail)
    if float(inertial.find("mass").get("value")) < 0:
        fail(inertial, f"{owner}: mass {inertial.find('mass').get('value')} kg is negative")


def check_urdf_joint(name: str, joint: Element, links: Mapping[str, Element], fail: Fail) -> None:
    """Check the element of a joint."""
    owner = f"joint {name!r}"
    kind = joint.get("type")
    refuse_duplicates(joint, owner, fail)
    if kind not in JOINT_TYPES:
        fail(joint, f"{owner} has type {kind!r}: known are {', '.join(JOINT_TYPES)}")
    for tag in ("parent", "child"):
        element = joint.find(tag)
        if element is None or element.get("link") is None:
            fail(joint, f"{owner} has no <{tag} link='...'>")
        if element.get("link") not in links:
            fail(element, f"{owner}, {tag}: {describe_unknown_name('link', element.get('link'), links)}")
    check_origin(joint, owner, fail)
    _check_axis(joint, owner, fail)
    for tag, attributes in JOINT_ATTRIBUTES.items():
        for element in joint.findall(tag):
            for attribute in attributes:
                check_numbers(element, attribute, 1, owner, fail, finite=tag != "limit")
    dynamics = joint.find("dynamics")
    for attribute in JOINT_ATTRIBUTES["dynamics"] if dynamics is not None else ():
        if float(dynamics.get(attribute, 0)) < 0:
            fail(dynamics, f"{owner}: {attribute} {dynamics.get(attribute)} is negative, it would drive the joint")
    mimic = joint.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        fail(mimic, f"{owner}: <mimic> lacks joint")


def _check_axis(joint: Element, owner: str, fail: Fail) -> None:
    """Check the element <axis> of a joint."""
    axis = joint.find("axis")
    if axis is None:
        return
    if axis.get("xyz") is None:
        fail(axis, f"{owner}: <axis> lacks xyz")
    check_numbers(axis, "xyz", 3, owner, fail)
    if not 1e-6 < math.hypot(*map(float, axis.get("xyz").split())) < 1e6:
        fail(axis, f"{owner}: axis {axis.get('xyz')!r} has no direction, or is far from a unit vector")


def refuse_duplicates(element: Element, owner: str, fail: Fail) -> None:
    """Fail where two children have the same tag: a reader would use only one of them."""
    tags = set()
    for child in element:
        if child.tag in tags:
            fail(child, f"{owner} has a second <{child.tag}>: only one is allowed")
        tags.add(child.tag)


def check_origin(parent: Element, owner: str, fail: Fail) -> None:
    """Check the element <origin> of a joint or an <inertial>."""
    origin = parent.find("origin")
    for attribute in ("xyz", "rpy") if origin is not None else ():
        check_numbers(origin, attribute, 3, owner, fail)


def check_numbers(element: Element, attribute: str, count: int, owner: str, fail: Fail, finite: bool = True) -> None:
    """Fail where an attribute exists but is not `count` numbers; finite: whether infinite ones are refused too."""
    text: str | None = element.get(attribute)
    if text is None:
        return
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if len(numbers) != count or "_" in text or not text.isascii() or any(map(math.isnan, numbers)):
        need = "a number is" if count == 1 else f"{count} numbers are"
        fail(element, f"{owner}: <{element.tag}> has {attribute}={text[:60]!r}, {need} needed")
    if finite and not all(map(math.isfinite, numbers)):
        fail(element, f"{owner}: <{element.tag}> has {attribute}={text!r}, it must be finite")
