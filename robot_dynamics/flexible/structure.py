"""The virtual tree of a robot with flexible links: nodes, generalized coordinates, closures (Briot, section 2).

A node is a frame. Its parent carries it rigidly, by a joint, or as the end of a beam element; or it is a root, on which
only closures act: the ground, and free bodies, which have six coordinates of their own. Free bodies are the platform, a
moving base, and each end of an element at which a loop is closed while the link, or another chain, continues: where
three chains meet.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.beam import COINCIDENCE_TOLERANCE
from robot_dynamics.model.placement import invert_placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.flexible.element import Element
    from robot_dynamics.model.joint import Joint

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
SPATIAL = (0, 1, 2, 3, 4, 5)
PLANAR = (0, 1, 5)


class Node(NamedTuple):
    """A frame of the virtual tree.

    parent: number of the parent node, None of a root; placement: (4, 4) in the parent at zero joint position and
    undeformed; of the end of an element, that of its start. link, placement_in_link: number of a link of the robot, and
    placement (4, 4) of the node in its frame. coordinates: numbers of its own generalized coordinates: displacements of
    a free root or of the end of an element, or a joint that is not held. joint: a Joint with this placement that moves
    the node; joint_number: its number in the robot; multiplier: motion of the joint for unit motion of the coordinate.
    is_spherical: whether its three coordinates rotate it about its own axes.
    """

    parent: int | None
    placement: Array
    link: int
    placement_in_link: Array
    coordinates: tuple[int, ...] = ()
    element: Element | None = None
    joint: Joint | None = None
    joint_number: int = 0
    multiplier: float = 1.0
    is_spherical: bool = False

    @property
    def parent_number(self) -> int:
        """Number of the parent of a node that is not a root."""
        if self.parent is None:
            raise ValueError("a root has no parent")
        return self.parent


class Closure(NamedTuple):
    """Two nodes that move as one: numbers of the `leaf` of a chain and of its target; is_spherical: as of Loop."""

    leaf: int
    target: int
    name: str
    is_spherical: bool = False


class NodeBody(NamedTuple):
    """A rigid body on a node: number of the node, and spatial inertia (6, 6) about its origin."""

    node: int
    inertia: Array


class JointSpring(NamedTuple):
    """Rotor inertia and spring stiffness of a joint, in terms of a generalized coordinate."""

    coordinate: int
    inertia: float
    stiffness: float


@dataclass(frozen=True, eq=False)
class Structure:
    """The virtual tree of a robot.

    nodes: each after its parent; coordinates: names of the generalized coordinates; components: of a twist, all or
    those of motion in the plane.
    """

    nodes: tuple[Node, ...]
    bodies: tuple[NodeBody, ...]
    springs: tuple[JointSpring, ...]
    closures: tuple[Closure, ...]
    coordinates: tuple[str, ...]
    components: tuple[int, ...] = SPATIAL

    @cached_property
    def moving_coordinates(self) -> tuple[tuple[int, ...], ...]:
        """For each node the numbers of the coordinates that move it, in the order of its chain."""
        moving: list[tuple[int, ...]] = []
        for node in self.nodes:
            inherited = () if node.parent is None else moving[node.parent]
            moving.append((*inherited, *(number for number in node.coordinates if number not in inherited)))
        return tuple(moving)

    def path_to_root(self, number: int) -> list[int]:
        """Return numbers of the nodes from a node to its root, itself first."""
        path = [number]
        parent = self.nodes[number].parent
        while parent is not None:
            path.append(parent)
            parent = self.nodes[parent].parent
        return path


def nearest_node(nodes: Sequence[Node], numbers: Collection[int], frame: Array) -> tuple[int, Array]:
    """Return the node of a link that is nearest to a frame (4, 4), and the placement (4, 4) of the frame in it.

    numbers: of the nodes of the link. The last of several equally near nodes is returned.
    """
    distances = [float(np.linalg.norm(nodes[number].placement_in_link[:3, 3] - frame[:3, 3])) for number in numbers]
    limit = min(distances) + COINCIDENCE_TOLERANCE
    nearest = [number for number, distance in zip(numbers, distances, strict=True) if distance <= limit][-1]
    return nearest, invert_placement(nodes[nearest].placement_in_link) @ frame
