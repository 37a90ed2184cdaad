"""Checks of the elements of a URDF: names, references, types and numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, NoReturn, TypeAlias

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.urdf.document import Element

if TYPE_CHECKING:
    from robot_dynamics.model.formats.urdf.document import LineWarnings

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating")
INERTIAL_ATTRIBUTES = {"mass": ("value",), "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")}
JOINT_ATTRIBUTES = {
    "limit": ("lower", "upper", "velocity", "effort"),
    "dynamics": ("damping", "friction"),
    "mimic": ("multiplier", "offset"),
}
ONE_TURN = 2 * math.pi + 0.01  # [rad] larger angles of a pose are probably degrees
UNIT_TOLERANCE = 0.01  # of the length of an axis

Fail: TypeAlias = Callable[[Element, str], NoReturn]
"""Raises DescriptionError with a message and the line of an element."""


def check_urdf(root: Element, source: object) -> None:
    """Raise DescriptionError, with the line and the element, for data that no reader can interpret.

    This checks names, references, types and numbers. The reader checks that links and joints form one tree.
    """

    def fail(element: Element, message: str) -> NoReturn:
        """Raise DescriptionError with the line of an element."""
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
    limit = joint.find("limit")
    for attribute in ("velocity", "effort") if limit is not None else ():
        if float(limit.get(attribute, 0)) < 0:
            fail(limit, f"{owner}: {attribute} limit {limit.get(attribute)} is negative. Omit it if there is no limit")
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


def warn_of_suspicious_numbers(root: Element, warnings: LineWarnings) -> None:
    """Add a warning for numbers that readers interpret, but probably not as intended; root: checked by `check_urdf`."""
    for link in root.findall("link"):
        _check_angles(link.find("inertial/origin"), f"link {link.get('name')!r}", warnings)
    for joint in root.findall("joint"):
        owner = f"joint {joint.get('name')!r}"
        _check_angles(joint.find("origin"), owner, warnings)
        axis = joint.find("axis")
        if axis is not None and abs(math.hypot(*_numbers(axis, "xyz")) - 1) > UNIT_TOLERANCE:
            message = f"{owner}: axis {axis.get('xyz')!r} is not a unit vector. Only its direction is used"
            warnings.add(axis, message, "axis")
        limit = joint.find("limit")
        if limit is not None and joint.get("type") in ("revolute", "prismatic"):
            missing = " and ".join(name for name in ("lower", "upper") if limit.get(name) is None)
            if missing:
                message = f"{owner}: <limit> lacks {missing}. No limit is assumed here, but other readers assume 0"
                warnings.add(limit, message, "limit")


def _check_angles(origin: Element | None, owner: str, warnings: LineWarnings) -> None:
    """Add a warning where an angle of <origin> exceeds one turn."""
    if origin is not None and any(abs(angle) > ONE_TURN for angle in _numbers(origin, "rpy")):
        message = f"{owner}: rpy={origin.get('rpy')!r} has an angle over one turn. Angles are in radians, not degrees"
        warnings.add(origin, message, "rpy")


def _numbers(element: Element, attribute: str) -> list[float]:
    """Return the numbers of an attribute, none where it is missing."""
    return [float(word) for word in element.get(attribute, "").split()]


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
