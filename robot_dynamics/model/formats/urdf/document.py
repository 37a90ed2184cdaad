"""From the text of a URDF to an XML tree that is safe to interpret.

yourdfpy forgives: it repairs broken XML, gives a missing moment of inertia the value 1 and takes any joint type. What
it would forgive is refused here, with the line, before it is asked.
"""

import logging
import math
import re

from lxml import etree

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.decoding import decode_text

logger = logging.getLogger(__name__)

MAX_DESCRIPTION_LENGTH = 10 * 1024 * 1024  # characters; the largest real descriptions have half a million

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating")
# what the dynamics have a use for; the rest (shapes, colours, controllers, simulators) is taken out unread
USED_ELEMENTS = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
    "fixed joint": ("parent", "child", "origin"),
}
XINCLUDE = "http://www.w3.org/2001/XInclude"
UNEXPANDED = "is xacro. Expand it first: xacro robot.urdf.xacro > robot.urdf"
UNDECLARED = "its prefix is not declared. A URDF needs none: remove it"
# elements of xacro itself: a text that has one was not expanded; others are calls of macros that were not found
XACRO_ELEMENTS = ("arg", "attribute", "call", "element", "if", "include", "insert_block", "macro", "property", "unless")


def parse_urdf_text(text, source):
    """The root element <robot> of a URDF.

    text: str, or bytes as read from a file; source: what to call the description in errors. Nothing but the text
    itself is read: no DTD, no entity, no include.
    """
    text = decode(text, source)
    refuse_external_references(text, source)
    declaration = re.match(r"\s*<\?xml.*?\?>", text, re.DOTALL)
    if declaration:  # the text is decoded: what it says of its encoding has had its effect; lines stay where they are
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


def parse_xml(text):
    """The root element of a text (bytes). A prefix that is not declared stays part of the name, `prefix:name`.

    Raises XMLSyntaxError for all else that is not well-formed.
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


def remove_unused_elements(element, kind):
    """Take out of an element all that the dynamics have no use for."""
    for child in list(element):
        if child.tag not in USED_ELEMENTS[kind]:
            element.remove(child)
        elif child.tag in USED_ELEMENTS:
            fixed = child.tag == "joint" and child.get("type") in ("fixed", "floating")
            remove_unused_elements(child, "fixed joint" if fixed else child.tag)


def decode(text, source):
    encoding = "utf-8-sig"
    if isinstance(text, bytes):
        declared = re.match(rb"\s*<\?xml[^>]*?encoding\s*=\s*[\"']([A-Za-z0-9._-]+)", text)
        encoding = declared.group(1).decode() if declared else encoding
    return decode_text(text, source, "a URDF", MAX_DESCRIPTION_LENGTH, encoding)


def refuse_external_references(text, source):
    for pattern, what in (
        (r"<!\s*DOCTYPE", "a DOCTYPE"),
        (r"<!\s*ENTITY", "an entity"),
    ):
        found = re.search(pattern, text, re.IGNORECASE)
        if found:
            line = text.count("\n", 0, found.start()) + 1
            raise DescriptionError(f"{source}, line {line}: {refusal_message(what)}")


def refusal_message(what):
    return f"{what} is refused, a URDF needs none and it could read other files. Remove it"


def refuse_includes(root, source):
    """Refuse elements that would read other files. To declare their namespace, unused, harms nothing."""
    for element in root.iter(f"{{{XINCLUDE}}}*", "xi:*", "xi:include", "xi:fallback"):
        raise DescriptionError(f"{source}, line {element.sourceline}: {refusal_message('an XInclude')}")


def check_unexpanded_elements(root, source):
    """Warn of elements of xacro or with a prefix that is not declared, and refuse those that may say what counts."""
    left_out = {}
    for element in root.iter(etree.Element):
        name = unexpanded_name(element)
        if name is None:
            continue
        parent, (prefix, _, local) = element.getparent(), name.rpartition(":")
        kind = UNEXPANDED if prefix == "xacro" else UNDECLARED
        if prefix == "xacro" and (local in XACRO_ELEMENTS or root.find("link") is None):
            reason = kind
        elif parent is root and any(
            local_name(inner) in USED_ELEMENTS["robot"] for inner in element.iter(etree.Element)
        ):
            reason = f"has a link or joint, and {kind}"
        elif parent is not root and is_used(parent):
            reason = f"is in a <{parent.tag}>, and {kind}"
        else:
            left_out.setdefault(name, []).append(element.sourceline)
            continue
        raise DescriptionError(f"{source}, line {element.sourceline}: <{name}> {reason}")
    for name, (line, *more) in left_out.items():
        often = f" and {len(more)} more" if more else ""
        logger.warning("%s, line %d%s: <%s> is left out: it was not expanded, or its prefix is not declared. It is "
                       "neither a link nor a joint", source, line, often, name)  # fmt: skip


def unexpanded_name(element):
    """`prefix:name` of an element of xacro or with a prefix that is not declared; None of others."""
    if not element.tag.startswith("{"):
        return element.tag if ":" in element.tag else None
    name = etree.QName(element)
    return f"xacro:{name.localname}" if "xacro" in name.namespace else None


def local_name(element):
    """The name of an element without its prefix, declared or not."""
    return re.split("[}:]", element.tag)[-1]


def is_used(element):
    """Whether the dynamics have a use for an element, and for all that it is in."""
    parent = element.getparent()
    return parent is None or (element.tag in USED_ELEMENTS.get(parent.tag, ()) and is_used(parent))


def check_urdf(root, source):
    """Refuse what no reader could interpret, naming the line, the element and what would be right.

    Checks names, references, types and numbers; that links and joints form one tree is checked where it is walked.
    """

    def fail(element, message):
        raise DescriptionError(f"{source}, line {element.sourceline}: {message}")

    if root.get("name") is None:
        root.set("name", "robot")
    links = children_by_name(root, "link", fail)
    if not links:
        fail(root, "there is no <link>: a robot has one at least")
    for name, link in links.items():
        check_inertial(name, link, fail)
    for name, joint in children_by_name(root, "joint", fail).items():
        check_urdf_joint(name, joint, links, fail)


def children_by_name(root, tag, fail):
    """The children of that tag by name. Refuses one without a name, or with another's."""
    found = {}
    for element in root.findall(tag):
        name = element.get("name")
        if not name:
            fail(element, f"this <{tag}> has no name")
        if name in found:
            fail(element, f"{tag} {name!r} is there already, at line {found[name].sourceline}: names must differ")
        found[name] = element
    return found


def check_inertial(name, link, fail):
    owner = f"link {name!r}"
    refuse_duplicates(link, owner, fail)
    inertial = link.find("inertial")
    if inertial is None:
        return
    refuse_duplicates(inertial, owner, fail)
    check_origin(inertial, owner, fail)
    for tag, attributes in (("mass", ("value",)), ("inertia", ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))):
        element = inertial.find(tag)
        if element is None:
            fail(inertial, f"{owner} has an <inertial> without <{tag}>: give it, or leave out <inertial> if massless")
        for attribute in attributes:
            if element.get(attribute) is None:
                fail(element, f"{owner}: <{tag}> lacks {attribute}")
            check_numbers(element, attribute, 1, owner, fail)
    if float(inertial.find("mass").get("value")) < 0:
        fail(inertial, f"{owner}: mass {inertial.find('mass').get('value')} kg is negative")


def check_urdf_joint(name, joint, links, fail):
    owner, kind = f"joint {name!r}", joint.get("type")
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
    axis = joint.find("axis")
    if axis is not None:
        if axis.get("xyz") is None:
            fail(axis, f"{owner}: <axis> lacks xyz")
        check_numbers(axis, "xyz", 3, owner, fail)
        if not 1e-6 < math.hypot(*map(float, axis.get("xyz").split())) < 1e6:
            fail(axis, f"{owner}: axis {axis.get('xyz')!r} has no direction, or is far from a unit vector")
    for tag, attributes in (
        ("limit", ("lower", "upper", "velocity", "effort")),
        ("dynamics", ("damping", "friction")),
        ("mimic", ("multiplier", "offset")),
    ):
        for element in joint.findall(tag):
            for attribute in attributes:
                check_numbers(element, attribute, 1, owner, fail, finite=tag != "limit")
    dynamics = joint.find("dynamics")
    for attribute in ("damping", "friction") if dynamics is not None else ():
        if float(dynamics.get(attribute, 0)) < 0:
            fail(dynamics, f"{owner}: {attribute} {dynamics.get(attribute)} is negative, it would drive the joint")
    mimic = joint.find("mimic")
    if mimic is not None and not mimic.get("joint"):
        fail(mimic, f"{owner}: <mimic> does not say which joint")


def refuse_duplicates(element, owner, fail):
    """Refuse two children of the same tag: a reader would take one and drop the other."""
    seen = set()
    for child in element:
        if child.tag in seen:
            fail(child, f"{owner} has a second <{child.tag}>: one is right")
        seen.add(child.tag)


def check_origin(parent, owner, fail):
    origin = parent.find("origin")
    for attribute in ("xyz", "rpy") if origin is not None else ():
        check_numbers(origin, attribute, 3, owner, fail)


def check_numbers(element, attribute, count, owner, fail, finite=True):
    """Refuse an attribute that is there but is not `count` numbers."""
    text = element.get(attribute)
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
