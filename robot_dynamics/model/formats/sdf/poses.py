"""Poses of the frames of an SDF at zero joint positions, and the links that carry them."""

from __future__ import annotations

from typing import TYPE_CHECKING, NoReturn

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.placement import invert_placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.formats.sdf.scopes import Assembly, Node, Scope

ROUNDING = 2e-15  # of products of a few rotations


class Poses:
    """Poses (4, 4) in the frame of the model, and in the world."""

    def __init__(self, assembly: Assembly) -> None:
        self._assembly = assembly
        self._known: dict[Node, Array] = {assembly.model: np.eye(4)}

    def of(self, node: Node) -> Array:
        """Return the pose of a node in the frame of the model."""
        chain: dict[Node, None] = {}  # ordered, and quick to search
        while node not in self._known:
            if node in chain:
                _fail(node, "its pose is relative to itself, through a cycle of frames")
            if node is self._assembly.world:
                self._known[node] = invert_placement(self.model_in_world())
                break
            chain[node] = None
            node = self._reference(node)
        pose = self._known[node]
        for passed in reversed(list(chain)):
            pose = pose @ self._pose_in_reference(passed)
            self._known[passed] = pose
        return pose

    def model_in_world(self) -> Array:
        """Return the pose of the frame of the model in the world."""
        return self._pose_in_reference(self._assembly.model)

    def link(self, node: Node) -> Node:
        """Return the link, or the world, that carries a node."""
        passed: set[Node] = set()
        while node.kind not in ("link", "world"):
            if node in passed:
                _fail(node, "it is attached to itself, through a cycle of frames")
            passed.add(node)
            carrier: Node | None
            if node.attached_to is not None:
                carrier = self._find(node, node.attached_to)
            elif node.kind == "model":
                carrier = node.canonical_link
            else:
                carrier = node.default
            if carrier is None:
                _fail(node, "it has no link")
            node = carrier
        return node

    def _reference(self, node: Node) -> Node:
        """Return the frame in which the pose of a node is given."""
        if node.relative_to is not None:
            return self._find(node, node.relative_to)
        return node.default or self._assembly.world

    def _find(self, node: Node, reference: tuple[Scope, str]) -> Node:
        """Return the node of a reference in the element of a node."""
        scope, name = reference
        return self._assembly.find(scope, name, node.element)

    def _pose_in_reference(self, node: Node) -> Array:
        """Return the pose of a node in its reference; that of a model may be given for a frame inside it."""
        if node.placement_frame is None:
            return node.pose
        inside = self._find(node, node.placement_frame)
        inner = np.eye(4)
        passed: set[Node] = set()
        while inside is not node:
            if inside in passed or inside.kind == "world":
                _fail(node, f"its placement_frame {node.placement_frame[1]!r} is no frame inside it")
            passed.add(inside)
            inner = self._pose_in_reference(inside) @ inner
            inside = self._reference(inside)
        return node.pose @ invert_placement(inner)


def without_rounding(matrix: Array) -> Array:
    """Return a placement (4, 4) whose entries are exactly 0 and ±1 where they differ from it by rounding."""
    clean: Array = matrix.copy()
    nearest = np.round(matrix[:3, :3])
    clean[:3, :3] = np.where(np.abs(matrix[:3, :3] - nearest) < ROUNDING, nearest, matrix[:3, :3])
    size = np.abs(matrix[:3, 3]).max()
    clean[:3, 3] = np.where(np.abs(matrix[:3, 3]) < ROUNDING * size, 0.0, matrix[:3, 3])
    return clean


def _fail(node: Node, message: str) -> NoReturn:
    """Raise DescriptionError with the line of a node."""
    if node.scope is None or node.element is None:
        raise DescriptionError(f"{node.kind} {node.name!r}: {message}")
    node.scope.document.fail(node.element, f"{node.kind} {node.name!r}: {message}")
