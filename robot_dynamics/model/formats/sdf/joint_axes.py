"""Joints of an SDF: the motions about and along axes of which each consists."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.joint import UNLIMITED, Limits, Mimic, Spring
from robot_dynamics.model.placement import rotation_with_z_along

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.sdf.document import SdfDocument
    from robot_dynamics.model.formats.sdf.poses import Poses
    from robot_dynamics.model.formats.sdf.scopes import Assembly, Node
    from robot_dynamics.model.formats.urdf.document import Element

AXES = {
    "fixed": (),
    "ball": (),
    "revolute": ("axis",),
    "continuous": ("axis",),
    "prismatic": ("axis",),
    "screw": ("axis",),
    "universal": ("axis", "axis2"),
    "revolute2": ("axis", "axis2"),
    "gearbox": (),
}
"""Types of joints, with the axes of their motions. A ball joint has three of its own."""


class Motion(NamedTuple):
    """One degree of freedom of a joint.

    Attributes
    ----------
    name : str
        Full name of the joint of the robot.
    prismatic : bool
        Whether it slides along the axis; else it turns about it.
    axis : (3,) array
        Direction of the axis in the frame of the joint.
    limits : Limits
        Its limits.
    rotor_inertia : float
        Inertia of its rotor, referred to the joint [kg m² or kg].
    viscous_friction, coulomb_friction : float
        Its friction.
    spring : Spring or None
        Its spring.
    mimic : Mimic or None
        Relation to another joint of the robot.
    """

    name: str
    prismatic: bool
    axis: Array
    limits: Limits
    rotor_inertia: float = 0.0
    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    spring: Spring | None = None
    mimic: Mimic | None = None

    @property
    def actuated(self) -> bool:
        """Whether a motor drives it: its effort is not limited to zero."""
        return self.mimic is not None or self.limits.effort > 0

    def reversed(self) -> Motion:
        """Return the same motion from the child to the parent."""
        return self._replace(axis=-self.axis)


class JointReader:
    """Reads the joints of an assembly."""

    def __init__(self, assembly: Assembly, poses: Poses) -> None:
        self._assembly = assembly
        self._poses = poses

    def kind(self, node: Node) -> str:
        """Return the type of a joint, which must be one of those that are read."""
        document, element = _document(node), _element(node)
        kind: str = element.get("type", "")
        if kind in AXES:
            return kind
        document.fail(element, f"joint {node.name!r}: {describe_unknown_name('type', kind, AXES)}")

    def motions(self, node: Node) -> list[Motion]:
        """Return the motions of a joint from its parent to its child."""
        document, element, kind = _document(node), _element(node), self.kind(node)
        document.check_children(element, "joint")
        tags = AXES[kind]
        motions = [self._motion(node, kind, tag) for tag in tags]
        if kind == "ball":
            passive = Limits(effort=0.0)
            motions = [
                Motion(f"{node.name}:{tag}", False, axis, passive) for tag, axis in zip("xyz", np.eye(3), strict=True)
            ]
        if kind == "screw":
            turn = motions[0]
            lead = Mimic(turn.name, _travel_per_radian(document, element))
            motions.append(Motion(f"{turn.name}:travel", True, turn.axis, Limits(), mimic=lead))
        return motions

    def _motion(self, node: Node, kind: str, tag: str) -> Motion:
        """Return the motion about or along an axis; tag: of its element."""
        document, owner = _document(node), f"joint {node.name!r}"
        name = _motion_name(node.name, tag)
        element = document.child(_element(node), tag)
        prismatic = kind == "prismatic"
        if element is None:
            if tag == "axis2":
                document.fail(_element(node), f"{owner} of type {kind} has no <axis2>")
            return Motion(name, prismatic, np.array([0.0, 0.0, 1.0]), Limits())
        document.check_children(element, "axis")
        dynamics, limit = document.child(element, "dynamics"), document.child(element, "limit")
        damping = friction = stiffness = reference = 0.0
        if dynamics is not None:
            document.check_children(dynamics, "dynamics")
            damping, friction, stiffness, reference = (
                document.number(dynamics, child, 0.0)
                for child in ("damping", "friction", "spring_stiffness", "spring_reference")
            )
            for child, value in (("damping", damping), ("friction", friction), ("spring_stiffness", stiffness)):
                if value < 0:
                    document.fail(dynamics, f"{owner}: {child} {value:g} is negative, it would drive the joint")
        mimic = self._mimic(node, element)
        if mimic is not None and stiffness:
            document.fail(element, f"{owner} has a spring and follows joint {mimic.joint!r}: move the spring to it")
        return Motion(
            name=name,
            prismatic=prismatic,
            axis=self.direction(node, element),
            limits=_limits(document, limit, kind == "continuous"),
            rotor_inertia=_rotor_inertia(document, _element(node)) if tag == "axis" else 0.0,
            viscous_friction=damping,
            coulomb_friction=friction,
            spring=Spring(stiffness, reference) if stiffness else None,
            mimic=mimic,
        )

    def direction(self, node: Node, axis: Element) -> Array:
        """Return the direction (3,) of an axis in the frame of the joint."""
        document = _document(node)
        element = document.child(axis, "xyz")
        vector = np.array([0.0, 0.0, 1.0]) if element is None else document.vector(element)
        length = np.linalg.norm(vector)
        if not 1e-6 < length < 1e6:
            document.fail(axis, f"joint {node.name!r}: axis {vector.tolist()} has no direction, or is no unit vector")
        name = element.get("expressed_in") if element is not None else None
        if not name and document.version < (1, 7):
            in_model = document.version < (1, 5)
            name = "__model__" if document.flag(axis, "use_parent_model_frame", in_model) else None
        if name:
            assert node.scope is not None
            frame = self._poses.of(self._assembly.find(node.scope, name, axis))
            vector = self._poses.of(node)[:3, :3].T @ frame[:3, :3] @ vector
        return np.asarray(vector / length)

    def _mimic(self, node: Node, axis: Element) -> Mimic | None:
        """Return the relation of an axis to another one."""
        document = _document(node)
        element = document.child(axis, "mimic")
        if element is None:
            return None
        document.check_children(element, "mimic")
        assert node.scope is not None
        name, tag = element.get("joint", ""), element.get("axis", "axis")
        leaders = {joint.name: joint for joint in self._assembly.joints}
        leader = leaders.get(node.scope.prefix + name)
        if leader is None:
            document.fail(element, f"joint {node.name!r} mimics {describe_unknown_name('joint', name, leaders)}")
        if tag not in AXES[self.kind(leader)]:
            document.fail(element, f"joint {node.name!r} mimics {tag!r} of joint {name!r}, which has no such axis")
        multiplier, offset, reference = (
            document.number(element, child, default)
            for child, default in (("multiplier", 1.0), ("offset", 0.0), ("reference", 0.0))
        )
        return Mimic(_motion_name(leader.name, tag), multiplier, offset - multiplier * reference)


def axis_rotation(motion: Motion) -> Array:
    """Return a rotation (3, 3) whose third column is the axis of a motion."""
    return rotation_with_z_along(motion.axis)


def _rotor_inertia(document: SdfDocument, joint: Element) -> float:
    """Return the inertia of the rotor of a joint, referred to the joint by the ratio of its gear."""
    inertia = document.extension_number(joint, "rotor_inertia", 0.0)
    return inertia * document.extension_number(joint, "gear_ratio", 1.0) ** 2


def _motion_name(joint: str, tag: str) -> str:
    """Return the name of the motion of a joint about an axis."""
    return joint if tag == "axis" else f"{joint}:{tag}"


def _travel_per_radian(document: SdfDocument, element: Element) -> float:
    """Return the travel along the axis of a screw joint for each radian [m/rad]."""
    if element.find("screw_thread_pitch") is not None:
        return document.number(element, "screw_thread_pitch", 0.0) / (2 * math.pi)
    pitch = document.number(element, "thread_pitch", 1.0)  # rad/m of a left-handed thread
    if not pitch:
        document.fail(element, f"joint {element.get('name')!r}: <thread_pitch> is 0, which no screw has")
    return -1.0 / pitch


def _limits(document: SdfDocument, element: Element | None, continuous: bool) -> Limits:
    """Return the limits in an element <limit>. Those from UNLIMITED on, and negative speeds and efforts, are none."""
    if element is None:
        return Limits()
    document.check_children(element, "limit")
    lower, upper = (
        document.number(element, tag, default, finite=False) for tag, default in (("lower", -np.inf), ("upper", np.inf))
    )
    velocity, effort = (document.number(element, tag, np.inf, finite=False) for tag in ("velocity", "effort"))
    return Limits(
        lower if lower > -UNLIMITED and not continuous else -np.inf,
        upper if upper < UNLIMITED and not continuous else np.inf,
        velocity if 0 <= velocity < UNLIMITED else np.inf,
        effort if 0 <= effort < UNLIMITED else np.inf,
    )


def _document(node: Node) -> SdfDocument:
    """Return the document of a node."""
    assert node.scope is not None
    return node.scope.document


def _element(node: Node) -> Element:
    """Return the element of a node."""
    assert node.element is not None
    return node.element
