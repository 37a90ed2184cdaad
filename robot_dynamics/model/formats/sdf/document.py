"""An SDF document: its elements, and their values as numbers, vectors, flags and poses."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import TYPE_CHECKING, NoReturn

import numpy as np
from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.root_element import root_name
from robot_dynamics.model.formats.similar_names import similar_name
from robot_dynamics.model.formats.urdf.document import decode_urdf, local_name, parse_xml, refuse_external_references
from robot_dynamics.model.placement import placement, rotation_from_quaternion, rotation_from_roll_pitch_yaw

if TYPE_CHECKING:
    from pathlib import Path

    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.urdf.document import Element, LineWarnings

ROOTS = ("sdf", "gazebo")  # the root element was <gazebo> before version 1.4
OLDEST = (1, 2)
NEWEST = (1, 12)
COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
CHILDREN = {
    "model": (
        *("static", "self_collide", "allow_auto_disable", "frame", "pose", "link", "joint", "plugin", "gripper"),
        *("include", "model", "enable_wind"),
    ),
    "link": (
        *("gravity", "enable_wind", "self_collide", "kinematic", "must_be_base_link", "velocity_decay", "pose"),
        *("inertial", "collision", "visual", "sensor", "projector", "audio_sink", "audio_source", "battery", "light"),
        *("particle_emitter", "plugin"),
    ),
    "inertial": ("mass", "density", "auto_inertia_params", "pose", "inertia", "fluid_added_mass", "frame"),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "joint": (
        *("parent", "child", "gearbox_ratio", "gearbox_reference_body", "thread_pitch", "screw_thread_pitch"),
        *("axis", "axis2", "physics", "pose", "sensor"),
    ),
    "axis": ("xyz", "dynamics", "limit", "mimic", "use_parent_model_frame", "initial_position"),
    "dynamics": ("damping", "friction", "spring_reference", "spring_stiffness"),
    "limit": ("lower", "upper", "effort", "velocity", "stiffness", "dissipation"),
    "mimic": ("multiplier", "offset", "reference"),
}
"""Elements of SDF in those that describe the motion of a robot, whether the dynamics use them or not."""

SYNONYMS = {"origin": "pose", "rpy": "pose", "com": "pose"}
"""Names of the same thing in other formats."""

READ_EXTENSIONS = ("rotor_inertia", "gear_ratio")
"""Elements of Drake in a joint, `drake:rotor_inertia` and `drake:gear_ratio`."""

FLAGS = {"true": True, "1": True, "false": False, "0": False}


@dataclass(frozen=True, eq=False)
class SdfDocument:
    """The text of an SDF, in which a model and all its elements are.

    Attributes
    ----------
    root : Element
        The root element.
    source : str
        Name of the text in error messages.
    folder : Path or None
        Absolute folder of its file; None where it has none.
    version : tuple of int
        Version of the format.
    warnings : LineWarnings
        Receives warnings.
    """

    root: Element
    source: str
    folder: Path | None
    version: tuple[int, ...]
    warnings: LineWarnings

    def fail(self, element: Element, message: str) -> NoReturn:
        """Raise DescriptionError with the line of an element."""
        raise DescriptionError(f"{self.source}, line {element.sourceline}: {message}")

    def child(self, parent: Element, tag: str) -> Element | None:
        """Return the only child with a tag, None where there is none."""
        children = parent.findall(tag)
        if len(children) > 1:
            self.fail(children[1], f"<{parent.tag}> has a second <{tag}>: only one is allowed")
        return children[0] if children else None

    def text(self, parent: Element, tag: str) -> str | None:
        """Return the text of a child without blanks around it, None where there is no such child."""
        element = self.child(parent, tag)
        if element is None:
            return None
        return (element.text or "").strip()

    def extension_number(self, parent: Element, name: str, default: float) -> float:
        """Return the number of a child that is an extension of SDF; name: its name without the prefix."""
        for child in parent.iterchildren(etree.Element):
            if is_extension(child) and local_name(child) == name:
                return float(self._numbers(child, child.text, 1)[0])
        return default

    def flag(self, parent: Element, tag: str, default: bool = False) -> bool:
        """Return a child that is true or false."""
        text = self.text(parent, tag)
        if not text:
            return default
        if text.lower() not in FLAGS:
            self.fail(parent.find(tag), f"<{tag}> is {text[:60]!r}: true or false is needed")
        return FLAGS[text.lower()]

    def number(self, parent: Element, tag: str, default: float, finite: bool = True) -> float:
        """Return the number of a child; finite: whether an infinite one is refused."""
        element = self.child(parent, tag)
        if element is None:
            return default
        return float(self._numbers(element, element.text, 1, finite)[0])

    def vector(self, element: Element) -> Array:
        """Return the vector (3,) of an element."""
        return np.array(self._numbers(element, element.text, 3))

    def pose(self, element: Element | None) -> Array:
        """Return the matrix (4, 4) of an element <pose>; None or an empty one: the identity."""
        if element is None or not (element.text or "").strip():
            return np.eye(4)
        if element.get("rotation_format", "euler_rpy") == "quat_xyzw":
            *xyz, x, y, z, w = self._numbers(element, element.text, 7)
            if not math.hypot(x, y, z, w) > 1e-6:
                self.fail(element, "<pose> has a quaternion of zeros: 0 0 0 1 is no rotation")
            return placement(rotation_from_quaternion((w, x, y, z)), xyz)
        *xyz, roll, pitch, yaw = self._numbers(element, element.text, 6)
        if element.get("degrees", "false").lower() in ("true", "1"):
            roll, pitch, yaw = map(math.radians, (roll, pitch, yaw))
        return placement(rotation_from_roll_pitch_yaw(roll, pitch, yaw), xyz)

    def _numbers(self, element: Element, text: str | None, count: int, finite: bool = True) -> list[float]:
        """Return the numbers of a text of an element."""
        text = (text or "").strip()
        try:
            numbers = [float(word) for word in text.split()]
        except ValueError:
            numbers = []
        if len(numbers) != count or "_" in text or any(map(math.isnan, numbers)):
            need = "a number is" if count == 1 else f"{count} numbers are"
            self.fail(element, f"<{element.tag}> is {text[:60]!r}, {need} needed")
        if finite and not all(map(math.isfinite, numbers)):
            self.fail(element, f"<{element.tag}> is {text[:60]!r}, it must be finite")
        return numbers

    def check_children(self, element: Element, kind: str) -> None:
        """Refuse misspelled children, and warn of others that are not known; kind: a key of CHILDREN."""
        known = CHILDREN[kind]
        for child in element.iterchildren(etree.Element):
            name = str(child.tag)
            if name in known:
                continue
            if is_extension(child):
                if local_name(child) not in READ_EXTENSIONS:
                    message = f"<{local_name(child)[:60]}> in <{kind}> is left out: it is an extension of SDF"
                    self.warnings.add(child, message)
                continue
            intended = SYNONYMS.get(name.lower()) or similar_name(name, known)
            if intended in known and element.find(intended) is None:
                self.fail(child, f"<{name[:60]}> is not an element of <{kind}>: the name is <{intended}>")
            self.warnings.add(child, f"<{name[:60]}> in <{kind}> is ignored: it is not an element of SDF")


def is_extension(element: Element) -> bool:
    """Return whether an element has a prefix, as extensions of SDF have."""
    return ":" in str(element.tag) or str(element.tag).startswith("{")


def is_sdf(text: str | bytes) -> bool:
    """Return whether the root element of a text that begins as XML is <sdf>."""
    return root_name(text) in ROOTS


def parse_sdf(text: str | bytes, source: str, folder: Path | None, warnings: LineWarnings) -> SdfDocument:
    """Return the document of an SDF.

    Parameters
    ----------
    text : str or bytes
        The SDF.
    source : str
        Name of the text in error messages.
    folder : Path or None
        Absolute folder of its file; None where it has none.
    warnings : LineWarnings
        Receives warnings.

    Raises
    ------
    DescriptionError
        If the text is not well-formed, is no SDF, or of a version that is not read.
    """
    text = decode_urdf(text, source)
    refuse_external_references(text, source)
    # Gazebo reads comments with `--` inside, and before the declaration, which XML forbids
    text = COMMENT.sub(lambda match: "\n" * match.group().count("\n"), text)
    declaration = re.match(r"\s*<\?xml.*?\?>", text, re.DOTALL)
    if declaration:  # the text is decoded already; line numbers stay
        text = "\n" * declaration.group().count("\n") + text[declaration.end() :]
    try:
        root = parse_xml(text.encode("utf-8"))
    except (etree.XMLSyntaxError, ValueError) as error:
        raise DescriptionError(f"{source} is not well-formed XML: {str(error)[:300]}") from None
    if root.tag not in ROOTS:
        raise DescriptionError(f"{source}: the root element is <{str(root.tag)[:60]}>, an SDF has <sdf>")
    match = re.fullmatch(r"(\d+)\.(\d+)(\.\d+)?", root.get("version", "").strip())
    version = (int(match[1]), int(match[2])) if match is not None else (0, 0)
    if not OLDEST <= version <= NEWEST:
        span = " to ".join(".".join(map(str, end)) for end in (OLDEST, NEWEST))
        raise DescriptionError(
            f"{source}, line {root.sourceline}: the version of SDF is {root.get('version', '')[:60]!r}: {span} are read"
        )
    return SdfDocument(root, source, folder, version, warnings)
