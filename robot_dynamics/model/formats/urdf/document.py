"""The text of a URDF as an XML tree that is safe to interpret.

yourdfpy repairs broken XML, replaces a missing moment of inertia by 1 and accepts any joint type. This package refuses
such texts, with the line of the error, before yourdfpy reads them.
"""

import re
from typing import TypeAlias

from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.decoding import MAX_DESCRIPTION_LENGTH, decode_text

# elements that the dynamics use; all others (shapes, colours, controllers, simulators) are removed unread
USED_ELEMENTS = {
    "robot": ("link", "joint"),
    "link": ("inertial",),
    "inertial": ("origin", "mass", "inertia"),
    "joint": ("parent", "child", "origin", "axis", "limit", "dynamics", "mimic"),
    "fixed joint": ("parent", "child", "origin"),
}
USED_TAGS = tuple({tag for tags in USED_ELEMENTS.values() for tag in tags})
XINCLUDE = "http://www.w3.org/2001/XInclude"
MAX_QUOTED_LENGTH = 200  # characters of a text in an error; names may have any length
UNEXPANDED = "is xacro. Expand it first: xacro robot.urdf.xacro > robot.urdf"
UNDECLARED = "its prefix is not declared. A URDF needs none: remove it"
# elements of xacro itself: they show a text that was not expanded; others are calls of unknown macros
XACRO_EXPRESSION = re.compile(r"\$[{(]")
XACRO_ELEMENTS = ("arg", "attribute", "call", "element", "if", "include", "insert_block", "macro", "property", "unless")

Element: TypeAlias = etree._Element


class LineWarnings:
    """Warnings about elements of a text, one sentence for all lines with the same cause."""

    def __init__(self) -> None:
        self._messages: dict[str, str] = {}
        self._lines: dict[str, list[int]] = {}

    def add(self, element: Element, message: str, cause: str | None = None) -> None:
        """Add a warning at the line of an element; of those with one cause (default: the message) the first is kept."""
        cause = cause or message
        self._messages.setdefault(cause, message)
        self._lines.setdefault(cause, []).append(element.sourceline)

    @property
    def sentences(self) -> tuple[str, ...]:
        """The warnings with their lines."""
        return tuple(self._sentence(cause) for cause in self._messages)

    def _sentence(self, cause: str) -> str:
        """Return the warning of a cause with its lines."""
        line, *more = self._lines[cause]
        count = f" and {len(more)} more" if more else ""
        return f"line {line}{count}: {self._messages[cause]}"


def parse_urdf_text(text: str | bytes, source: object, warnings: LineWarnings) -> Element:
    """Return the root element <robot> of a URDF.

    Only the text itself is read: no DTD, no entity, no include.

    Parameters
    ----------
    text : str or bytes
        The URDF, or the bytes of its file.
    source : object
        Name of the description in error messages.
    warnings : LineWarnings
        Receives warnings about elements that were not expanded.
    """
    text = decode_urdf(text, source)
    refuse_external_references(text, source)
    declaration = re.match(r"\s*<\?xml.*?\?>", text, re.DOTALL)
    if declaration:  # the text is decoded already, so its declared encoding must go; line numbers stay
        text = "\n" * declaration.group().count("\n") + text[declaration.end() :]
    try:
        root = parse_xml(text.encode("utf-8"))
    except (etree.XMLSyntaxError, ValueError) as error:
        raise DescriptionError(f"{source} is not well-formed XML: {_shorten(str(error))}") from None
    if root.tag != "robot":
        if unexpanded_name(root) == "xacro:robot":
            raise DescriptionError(f"{source}: the root element <xacro:robot> {UNEXPANDED}")
        if root.tag.startswith("{") and local_name(root) == "robot":
            raise DescriptionError(f"{source}: <robot> has a namespace of its own. Remove its attribute xmlns")
        raise DescriptionError(f"{source}: the root element is <{_shorten(root.tag)}>, a URDF has <robot>")
    refuse_includes(root, source)
    refuse_xacro_expressions(root, source)
    check_unexpanded_elements(root, source, warnings)
    return root


def _shorten(text: str) -> str:
    """The beginning and the end of a long text, where an error of the parser has the line."""
    half = MAX_QUOTED_LENGTH // 2
    return text if len(text) <= MAX_QUOTED_LENGTH else f"{text[:half]}…{text[-half:]}"


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
            remove_unused_elements(child, element_kind(child))


def element_kind(element: Element) -> str:
    """Return the key of USED_ELEMENTS of an element that contains used ones."""
    is_fixed = element.tag == "joint" and element.get("type") in ("fixed", "floating")
    return "fixed joint" if is_fixed else str(element.tag)


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


def refuse_xacro_expressions(root: Element, source: object) -> None:
    """Raise DescriptionError where xacro must still evaluate an attribute that the dynamics use."""
    for element in (root, *root.iterdescendants(*USED_TAGS)):
        if is_used(element):
            for attribute, value in element.attrib.items():
                if XACRO_EXPRESSION.search(str(value)):
                    raise DescriptionError(
                        f"{source}, line {element.sourceline}: <{element.tag}> has {attribute}={str(value)[:60]!r}, "
                        f"which {UNEXPANDED}"
                    )


def check_unexpanded_elements(root: Element, source: object, warnings: LineWarnings) -> None:
    """Check elements of xacro and elements with a prefix that is not declared.

    Raises DescriptionError where such an element may contain data of the robot, and adds a warning for the others.
    """
    for element in root.iter(etree.Element):
        name = unexpanded_name(element)
        if name is None:
            continue
        reason = _refusal_of_unexpanded(element, name, root)
        if reason is not None:
            raise DescriptionError(f"{source}, line {element.sourceline}: <{name}> {reason}")
        warnings.add(
            element,
            f"<{name}> is ignored: it was not expanded, or its prefix is not declared. It is neither a link "
            "nor a joint",
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
