"""The models of an SDF with all nested and included ones, as one list of links, joints and frames with full names.

A name in a nested model has that of the model before it, `arm::hand`. An included model that is merged has no name of
its own: a frame stands for it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from lxml import etree

from robot_dynamics.errors import describe_unknown_name
from robot_dynamics.model.formats.sdf.document import is_extension
from robot_dynamics.model.formats.sdf.inclusion import MAX_DEPTH, included_document
from robot_dynamics.model.formats.urdf.document import local_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.sdf.document import SdfDocument
    from robot_dynamics.model.formats.urdf.document import Element

WORLD = "world"
MODEL = "__model__"
SEPARATOR = "::"
MAX_JOINTS = 10_000  # also fixed ones, of which real robots have hundreds


class ModelSource(NamedTuple):
    """The element of a model, its document, and the element <include> that names it, with its own document, if any."""

    element: Element
    document: SdfDocument
    include: Element | None = None
    including: SdfDocument | None = None

    @property
    def name(self) -> str:
        """Name of the model."""
        name = None
        if self.include is not None and self.including is not None:
            name = self.including.text(self.include, "name")
        return name or self.element.get("name", "robot")

    @property
    def is_static(self) -> bool:
        """Whether the model does not move."""
        if self.include is not None and self.including is not None and self.include.find("static") is not None:
            return self.including.flag(self.include, "static")
        return self.document.flag(self.element, "static")


@dataclass(frozen=True, eq=False)
class Scope:
    """Where names of elements are looked up.

    Attributes
    ----------
    prefix : str
        What full names have before the names here.
    model : Node
        Frame of the model.
    document : SdfDocument
        Document of the elements.
    """

    prefix: str
    model: Node
    document: SdfDocument


@dataclass(eq=False)
class Node:
    """A frame of SDF: a link, a joint, a frame, a model or the world.

    Attributes
    ----------
    kind : str
        "link", "joint", "frame", "model" or "world".
    name : str
        Full name.
    element : Element or None
        The element; None for the world.
    scope : Scope or None
        Where the names in the element are looked up; None for the world.
    pose : (4, 4) array
        Pose in the frame `relative_to`.
    relative_to : tuple of Scope and str, or None
        Reference of the frame of the pose. None: `default`.
    default : Node or None
        That frame, where there is no reference.
    attached_to : tuple of Scope and str, or None
        Reference of what carries a frame, a joint or a model. None: `default`.
    placement_frame : tuple of Scope and str, or None
        Of a model: the reference of the frame inside it that has the pose.
    canonical_link : Node or None
        Of a model: its first link, where `attached_to` names no other one.
    """

    kind: str
    name: str
    element: Element | None = None
    scope: Scope | None = None
    pose: Array = field(default_factory=lambda: np.eye(4))
    relative_to: tuple[Scope, str] | None = None
    default: Node | None = None
    attached_to: tuple[Scope, str] | None = None
    placement_frame: tuple[Scope, str] | None = None
    canonical_link: Node | None = None


class Assembly:
    """All links, joints and frames of a model.

    Attributes
    ----------
    links, joints, frames : list of Node
        In the order of the document.
    """

    def __init__(self, source: ModelSource) -> None:
        self.links: list[Node] = []
        self.joints: list[Node] = []
        self.frames: list[Node] = []
        self.world = Node("world", WORLD)
        self._nodes: dict[str, Node] = {}
        self.model = self._add_model(source, "", MODEL, Scope("", self.world, source.document), 0)
        if len(self.joints) > MAX_JOINTS:
            source.document.fail(source.element, f"{len(self.joints)} joints are too many: the maximum is {MAX_JOINTS}")

    def find(self, scope: Scope, name: str, element: Element) -> Node:
        """Return what a name means in a scope; element: where it is written."""
        if name == MODEL:
            return scope.model
        node = self._nodes.get(scope.prefix + name) or self._nodes.get(scope.prefix + name + SEPARATOR + MODEL)
        if node is None and name == WORLD:
            return self.world
        if node is None:
            known = [key[len(scope.prefix) :] for key in self._nodes if key.startswith(scope.prefix)]
            scope.document.fail(element, describe_unknown_name("link or frame", name, known))
        return node

    def _add_model(self, source: ModelSource, prefix: str, name: str, parent: Scope, depth: int) -> Node:
        """Add a model with all that it contains, and return its frame; parent: scope of what contains it.

        prefix: of the full names inside; name: full name of the frame of the model.
        """
        element, document, include, including = source
        if depth > MAX_DEPTH:
            document.fail(element, f"more than {MAX_DEPTH} models are nested")
        document.check_children(element, "model")
        if depth and source.is_static:
            document.fail(element, f"model {source.name!r} is static inside another model: remove <static>")
        node = Node("model", name, element, parent, default=parent.model)
        owner, holder = parent.document, element
        if include is not None and including is not None and include.find("pose") is not None:
            holder, owner = include, including
        else:
            owner = document
        self._set_pose(node, owner, holder, parent)
        scope = Scope(prefix, node, document)
        placement_frame = element.get("placement_frame")
        if include is not None and including is not None:
            placement_frame = including.text(include, "placement_frame") or placement_frame
        if placement_frame:
            node.placement_frame = (scope, placement_frame)
        if element.get("canonical_link"):
            node.attached_to = (scope, element.get("canonical_link"))
        self._register(node, document)
        first = len(self.links)
        self._add_children(scope, element, depth)
        inside = self.links[first:]
        node.canonical_link = next((link for link in inside if link.scope is scope), next(iter(inside), None))
        return node

    def _add_children(self, scope: Scope, model: Element, depth: int) -> None:
        """Add the links, joints, frames and models inside a model."""
        for element in model.iterchildren(etree.Element):
            if element.tag in ("link", "joint", "frame"):
                self._add(scope, element)
            elif element.tag == "model":
                self._add_nested(scope, ModelSource(element, scope.document), False, depth)
            elif element.tag == "include":
                source = included_model(scope.document, element)
                merges = element.get("merge", "false").lower() in ("true", "1")
                self._add_nested(scope, source, merges, depth)

    def _add(self, scope: Scope, element: Element) -> None:
        """Add a link, a joint or a frame."""
        document, kind = scope.document, str(element.tag)
        name = element.get("name")
        if not name:
            document.fail(element, f"this <{kind}> has no name")
        node = Node(kind, scope.prefix + name, element, scope, default=scope.model)
        self._set_pose(node, document, element, scope)
        if kind == "joint":
            child = document.text(element, "child")
            if not child or not document.text(element, "parent"):
                document.fail(element, f"joint {name!r} needs <parent> and <child>")
            node.attached_to = (scope, child)
            node.relative_to = node.relative_to or node.attached_to
        elif kind == "frame" and element.get("attached_to"):
            node.attached_to = (scope, element.get("attached_to"))
            node.relative_to = node.relative_to or node.attached_to
        self._register(node, document)
        {"link": self.links, "joint": self.joints, "frame": self.frames}[kind].append(node)

    def _add_nested(self, scope: Scope, source: ModelSource, merges: bool, depth: int) -> None:
        """Add a model inside another one; merges: whether its content becomes that of the other one."""
        if merges:
            frame = f"{scope.prefix}_merged__{source.name}__model__"
            self._add_model(source, scope.prefix, frame, scope, depth + 1)
        else:
            prefix = f"{scope.prefix}{source.name}{SEPARATOR}"
            self._add_model(source, prefix, prefix + MODEL, scope, depth + 1)

    def _set_pose(self, node: Node, document: SdfDocument, holder: Element, scope: Scope) -> None:
        """Set the pose of a node from the element <pose> of an element."""
        element = document.child(holder, "pose")
        node.pose = document.pose(element)
        if element is not None:
            name = element.get("relative_to") or (element.get("frame") if document.version < (1, 7) else None)
            node.relative_to = (scope, name) if name else None

    def _register(self, node: Node, document: SdfDocument) -> None:
        """Make a node known by its name. In old versions a joint may have the name of a link."""
        known = self._nodes.setdefault(node.name, node)
        if known is node:
            return
        if known.kind == "joint" and node.kind == "link":
            self._nodes[node.name] = node
        if known.kind == node.kind or (document.version >= (1, 7) and node.kind != "joint"):
            document.fail(node.element, f"{node.kind} {node.name!r} is already defined: names must be unique")


def included_model(document: SdfDocument, include: Element) -> ModelSource:
    """Return the model that an element <include> names."""
    content = included_document(document, include)
    models = content.root.findall("model")
    if len(models) != 1:
        message = f"{document.text(include, 'uri')!r} has {len(models)} models outside worlds: it needs one"
        document.fail(include, message)
    for element in include.iterchildren(etree.Element):
        if is_extension(element):
            document.fail(
                element,
                f"<{local_name(element)[:60]}> changes an included model, which is not read: write the model out",
            )
    return ModelSource(models[0], content, include, document)
