"""Construction of the virtual tree of a robot (Briot, section 2)."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.flexible.element import Element
from robot_dynamics.flexible.structure import (
    COMPONENTS,
    PLANAR,
    SPATIAL,
    Closure,
    JointSpring,
    Node,
    NodeBody,
    Structure,
    nearest_node,
)
from robot_dynamics.model.beam import COINCIDENCE_TOLERANCE, locate_on_beam
from robot_dynamics.model.placement import invert_placement, placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.beam import Beam
    from robot_dynamics.model.robot import Robot

PARALLEL_TOLERANCE = 1e-9  # of axes in the plane


def build_structure(robot: Robot, held: Iterable[str] | None = None, planar: bool = False) -> Structure:
    """Return the Structure of a robot.

    Parameters
    ----------
    robot : Robot
    held : iterable of str, optional
        Names of the joints that do not move. Default: those that have a motor or a brake.
    planar : bool
        Whether only motion in the plane counts, three components of six; all joint axes must be parallel.

    Raises
    ------
    InvalidInputError
        A joint is unknown, or the robot does not move in the plane.
    """
    return _StructureBuilder(robot, _held_joints(robot, held), PLANAR if planar else SPATIAL).build()


def _held_joints(robot: Robot, names: Iterable[str] | None) -> set[int]:
    """Return numbers of the joints that do not move; a mimic joint is held with the joint that it follows."""
    leaders = [leader for leader, _, _ in robot.mimic_relations]
    if names is None:
        return {
            number
            for number, leader in enumerate(leaders)
            if robot.joints[leader].actuated or robot.joints[leader].brake
        }
    held = set()
    for name in names:
        if name not in robot.joint_numbers:
            raise InvalidInputError(describe_unknown_name("joint", name, robot.joint_numbers))
        held.add(robot.joint_numbers[name])
    return {number for number, leader in enumerate(leaders) if leader in held}


class _StructureBuilder:
    """Builds the nodes of each link in the order of the links.

    link_nodes: numbers of the nodes of each link, which may carry others; joint_coordinates: coordinate of each leading
    joint; attachments: (point (3,) in the link's frame, whether a loop closes there) of all that a link carries.
    """

    def __init__(self, robot: Robot, held: set[int], components: tuple[int, ...]) -> None:
        self.robot = robot
        self.held = held
        self.components = components
        self.nodes: list[Node] = []
        self.bodies: list[NodeBody] = []
        self.closures: list[Closure] = []
        self.names: list[str] = []
        self.joint_coordinates: dict[int, int] = {}
        self.link_nodes: dict[int, list[int]] = {}
        self.attachments = self._find_attachments()

    def build(self) -> Structure:
        robot = self.robot
        self._add_root(0, np.eye(4), robot.base_link if robot.moving_base else None)
        self._add_bodies(0)
        platform_links = {platform.link for platform in robot.platforms}
        coordinate_joints = {joint for platform in robot.platforms for joint in platform.joints}
        for number in range(1, len(robot.links)):
            if number - 1 not in coordinate_joints:
                self._add_link(number)
            elif number in platform_links:
                name = robot.links[number].name
                self._add_root(number, robot.frame(name).placement, name)
                self._add_bodies(number)
        self._add_loops()
        return Structure(
            tuple(self.nodes),
            tuple(self.bodies),
            tuple(self._joint_springs()),
            tuple(self.closures),
            tuple(self.names),
            self.components,
        )

    def _find_attachments(self) -> dict[int, list[tuple[Array, bool]]]:
        attachments: dict[int, list[tuple[Array, bool]]] = {}
        for joint in self.robot.joints:
            attachments.setdefault(joint.antecedent, []).append((joint.placement[:3, 3], False))
        for loop in self.robot.loops:
            for end, closes in zip(loop.ends, (False, True), strict=True):
                attachments.setdefault(end.link, []).append((end.placement[:3, 3], closes))
        return attachments

    def _add_loops(self) -> None:
        for loop in self.robot.loops:
            leaf, target = (self._add_rigid_node(end.link, end.placement) for end in loop.ends)
            if loop.is_spherical:
                coordinates = self._add_coordinates(loop.name, (3, 4, 5))
                carrier = self.nodes[leaf]
                leaf = self._add(
                    Node(leaf, np.eye(4), carrier.link, carrier.placement_in_link, coordinates, is_spherical=True)
                )
            self.closures.append(Closure(leaf, target, loop.name, loop.is_spherical))

    def _add_coordinates(self, name: str, components: tuple[int, ...] | None = None) -> tuple[int, ...]:
        """Add coordinates `name.component` and return their numbers."""
        components = self.components if components is None else components
        first = len(self.names)
        self.names += [f"{name}.{COMPONENTS[component]}" for component in components]
        return tuple(range(first, len(self.names)))

    def _add(self, node: Node) -> int:
        """Add a node and return its number."""
        if self.components == PLANAR and not np.allclose(node.placement[2, :2], 0, atol=PARALLEL_TOLERANCE):
            raise InvalidInputError(
                f"link {self.robot.links[node.link].name!r} does not move in the plane: all axes must be parallel"
            )
        self.nodes.append(node)
        return len(self.nodes) - 1

    def _add_root(self, link: int, placement_in_link: Array, name: str | None) -> None:
        """Add a root; a free root has a name, the ground has none."""
        coordinates = () if name is None else self._add_coordinates(name)
        root = self._add(Node(None, np.eye(4), link, placement_in_link, coordinates))
        self.link_nodes.setdefault(link, []).append(root)

    def _add_link(self, number: int) -> None:
        joint = self.robot.joints[number - 1]
        parent, relative = self._nearest(joint.antecedent, joint.placement)
        leader, multiplier, _ = self.robot.mimic_relations[number - 1]
        coordinates: tuple[int, ...] = ()
        if number - 1 not in self.held:
            if leader not in self.joint_coordinates:
                self.joint_coordinates[leader] = len(self.names)
                self.names.append(self.robot.joints[leader].name)
            coordinates = (self.joint_coordinates[leader],)
        if self.components == PLANAR and joint.prismatic:
            raise InvalidInputError(f"joint {joint.name!r} is prismatic: in the plane all joints must be revolute")
        node = Node(
            parent,
            relative,
            number,
            np.eye(4),
            coordinates,
            joint=replace(joint, placement=relative),
            joint_number=number - 1,
            multiplier=multiplier,
        )
        self.link_nodes[number] = [self._add(node)]
        flexibility = self.robot.links[number].flexibility
        if flexibility is not None:
            for beam in flexibility.beams:
                self._add_beam(number, beam, flexibility.beams)
        self._add_bodies(number)

    def _add_beam(self, link: int, beam: Beam, beams: Iterable[Beam]) -> None:
        """Add the elements of a beam: of equal length, with additional cuts where the beam carries something."""
        attachments = self._attachments_on_beam(link, beam, beams)
        equal_parts = [k / beam.elements for k in range(1, beam.elements + 1)]
        node, relative = self._nearest(link, beam.placement)
        previous = 0.0
        for fraction in sorted([*equal_parts, *(fraction for fraction, _ in attachments)]):
            if (fraction - previous) * beam.length <= COINCIDENCE_TOLERANCE:
                continue
            element = Element((fraction - previous) * beam.length, beam.section, beam.material, beam.rotary_inertia)
            end = beam.placement @ placement(translation=[fraction * beam.length, 0, 0])
            count = sum(self.nodes[number].element is not None for number in self.link_nodes[link])
            name = f"{self.robot.links[link].name}.{count + 1}"
            node = self._add(Node(node, relative, link, end, self._add_coordinates(name), element))
            self.link_nodes[link].append(node)
            closures = [
                closes for at, closes in attachments if abs(at - fraction) * beam.length <= COINCIDENCE_TOLERANCE
            ]
            continues = (1 - fraction) * beam.length > COINCIDENCE_TOLERANCE
            if any(closures) and len(closures) + continues > 1:
                node = self._add_junction(node, name)
            relative = np.eye(4)
            previous = fraction

    def _attachments_on_beam(self, link: int, beam: Beam, beams: Iterable[Beam]) -> list[tuple[float, bool]]:
        """Return (fraction of the length, whether a loop closes there) of all that a beam carries."""
        points = [*self.attachments.get(link, ())]
        points += [(neighbour.placement[:3, 3], False) for neighbour in beams if neighbour is not beam]
        fractions = [(locate_on_beam(beam, point), closes) for point, closes in points]
        return [(fraction, closes) for fraction, closes in fractions if fraction is not None]

    def _add_junction(self, end: int, name: str) -> int:
        """Add a free body at the end of an element, which closes on it."""
        link = self.nodes[end].link
        self._add_root(link, self.nodes[end].placement_in_link, f"{name} end")
        root = self.link_nodes[link][-1]
        self.closures.append(Closure(end, root, name))
        return root

    def _nearest(self, link: int, frame: Array) -> tuple[int, Array]:
        """Return the nearest node of a link to a frame (4, 4), and the placement (4, 4) of the frame in it."""
        if link not in self.link_nodes:
            raise InvalidInputError(
                f"link {self.robot.links[link].name!r} is a coordinate of the platform: it cannot carry other links"
            )
        return nearest_node(self.nodes, self.link_nodes[link], frame)

    def _add_rigid_node(self, link: int, frame: Array) -> int:
        """Add a node at a frame (4, 4) of a link, rigidly attached to the nearest node of the link."""
        parent, relative = self._nearest(link, frame)
        return self._add(Node(parent, relative, link, frame))

    def _add_bodies(self, link: int) -> None:
        """Add the rigid bodies of a link: the whole link where it is rigid."""
        flexibility = self.robot.links[link].flexibility
        if flexibility is None:
            parts = [(np.zeros(3), self.robot.links[link].inertia)]
        else:
            parts = [(body.point, body.inertia) for body in flexibility.bodies]
        for point, inertia in parts:
            node, _ = self._nearest(link, placement(translation=point))
            if np.any(inertia.spatial):
                to_node = invert_placement(self.nodes[node].placement_in_link)
                self.bodies.append(NodeBody(node, inertia.transformed_by(to_node).spatial))

    def _joint_springs(self) -> list[JointSpring]:
        springs = []
        for number, joint in enumerate(self.robot.joints):
            leader, multiplier, _ = self.robot.mimic_relations[number]
            if number not in self.held and leader in self.joint_coordinates:
                coordinate = self.joint_coordinates[leader]
                stiffness = 0.0 if joint.spring is None else joint.spring.stiffness
                springs.append(JointSpring(coordinate, joint.rotor_inertia * multiplier**2, stiffness * multiplier**2))
        return springs
