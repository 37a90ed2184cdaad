"""From a robot to the virtual tree of its elements: nodes, generalized coordinates, closures (Briot, section 2).

A node is a frame. It hangs on another one rigidly, by a joint, or as the end of a beam element; or it is a root, on
which nothing but closures bear: the ground, and free bodies, which have six coordinates of their own. Free are the
platform, a base that moves, and every end of an element at which a loop is closed while the link, or another chain,
goes on: where three chains meet.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import InvalidInputError, describe_unknown_name
from robot_dynamics.flexible.element import Element
from robot_dynamics.model.beam import COINCIDENCE_TOLERANCE, locate_on_beam
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.placement import invert_placement, placement

COMPONENTS = ("x", "y", "z", "rx", "ry", "rz")
SPATIAL, PLANAR = (0, 1, 2, 3, 4, 5), (0, 1, 5)


class Node(NamedTuple):
    """A frame of the virtual tree.

    parent: number of the node that it hangs on, None of a root; placement: (4, 4) in it, where joint variables are zero
    and nothing bends; of the end of an element, that of its beginning. joint: a Joint with this placement, if one moves
    the node, and variable, its number in the robot. coordinates: numbers of its own generalized coordinates: the
    displacements of a free root, or of the end of an element, or that of a joint which is not held; multiplier: how far
    the joint moves for one of the coordinate's. link, in_link: number of a link of the robot, and the placement (4, 4)
    of the node in its frame. ball: whether its three coordinates turn it about its own axes.
    """

    parent: int | None
    placement: np.ndarray
    link: int
    placement_in_link: np.ndarray
    coordinates: tuple = ()
    element: Element | None = None
    joint: Joint | None = None
    joint_number: int = 0
    multiplier: float = 1.0
    is_spherical: bool = False


class Closure(NamedTuple):
    """Two nodes that move as one: numbers of both, the `leaf` of a chain and what it closes on; ball: as of Loop."""

    leaf: int
    target: int
    name: str
    is_spherical: bool = False


@dataclass(frozen=True, eq=False)
class Structure:
    """The virtual tree of a robot.

    nodes: Nodes, each after its parent; bodies: (node, inertia (6, 6) of a rigid body about its origin); springs:
    (coordinate, inertia, stiffness) of joints; closures: Closures; coordinates: names of the generalized coordinates;
    components: of a twist, those that are not zero in the plane, or all.
    """

    nodes: tuple[Node, ...]
    bodies: tuple
    springs: tuple
    closures: tuple[Closure, ...]
    coordinates: tuple[str, ...]
    components: tuple = SPATIAL

    @cached_property
    def moving_coordinates(self):
        """For each node the numbers of the coordinates that move it, in the order of its chain."""
        found = []
        for node in self.nodes:
            before = () if node.parent is None else found[node.parent]
            found.append((*before, *(number for number in node.coordinates if number not in before)))
        return tuple(found)

    def path_to_root(self, number):
        """Numbers of the nodes from one to its root, itself first."""
        found = []
        while number is not None:
            found.append(number)
            number = self.nodes[number].parent
        return found


def nearest_node(nodes, numbers, frame):
    """(number, placement (4, 4) in it) of a frame on a link: the last of those of its Nodes that are nearest."""
    distances = [np.linalg.norm(nodes[number].placement_in_link[:3, 3] - frame[:3, 3]) for number in numbers]
    least = min(distances)
    found = [
        number for number, distance in zip(numbers, distances, strict=True) if distance <= least + COINCIDENCE_TOLERANCE
    ][-1]
    return found, invert_placement(nodes[found].placement_in_link) @ frame


def build_structure(robot, held=None, planar=False):
    """The Structure of a Robot.

    held: names of the joints that do not move; None: those that have a motor or a brake. planar: whether only motion in
    the plane is counted, three components of six; all joints must turn about parallel axes. Raises QuestionError.
    """
    return _Builder(robot, _held(robot, held), PLANAR if planar else SPATIAL).build()


def _held(robot, names):
    """Numbers of the joints that do not move; a joint that follows another one is held with it."""
    if names is None:
        return {n for n, (leader, _, _) in enumerate(robot.mimic_relations) if robot.joints[leader].actuated
                or robot.joints[leader].brake}  # fmt: skip
    for name in names:
        if name not in robot.joint_numbers:
            raise InvalidInputError(describe_unknown_name("joint", name, robot.joint_numbers))
    held = {robot.joint_numbers[name] for name in names}
    return {number for number, (leader, _, _) in enumerate(robot.mimic_relations) if leader in held}


class _Builder:
    """Walks the links in their order; `places` has the nodes of each link, on which others may hang."""

    def __init__(self, robot, held, components):
        self.robot, self.held, self.components = robot, held, components
        self.nodes, self.bodies, self.closures, self.names = [], [], [], []
        self.of_joints, self.places = {}, {}
        self.hung = self._hung()

    def build(self):
        self._root(0, np.eye(4), self.robot.base_link if self.robot.moving_base else None)
        self._bodies(0)
        platforms = {one.link for one in self.robot.platforms}
        coordinates = {joint for one in self.robot.platforms for joint in one.joints}
        for number in range(1, len(self.robot.links)):
            if number - 1 not in coordinates:
                self._link(number)
            elif number in platforms:
                name = self.robot.links[number].name
                self._root(number, self.robot.frame(name).placement, name)
                self._bodies(number)
        for loop in self.robot.loops:
            leaf, target = (self._rigid(*end) for end in loop.ends)
            if loop.is_spherical:
                turned = self._numbered(loop.name, (3, 4, 5))
                turning = Node(leaf, np.eye(4), *self.nodes[leaf][2:4], turned, is_spherical=True)
                leaf = self._add(turning)
            self.closures.append(Closure(leaf, target, loop.name, loop.is_spherical))
        return Structure(*map(tuple, (self.nodes, self.bodies, self._springs(), self.closures, self.names)),
                         self.components)  # fmt: skip

    def _hung(self):
        """{link: [(point (3,) in its frame, whether a loop closes there)]} of all that hangs on links."""
        found = {}
        for joint in self.robot.joints:
            found.setdefault(joint.antecedent, []).append((joint.placement[:3, 3], False))
        for loop in self.robot.loops:
            for end, closes in zip(loop.ends, (False, True), strict=True):
                found.setdefault(end.link, []).append((end.placement[:3, 3], closes))
        return found

    def _numbered(self, name, components=None):
        """Numbers of new coordinates, one for each component."""
        components = self.components if components is None else components
        first = len(self.names)
        self.names += [f"{name}.{COMPONENTS[component]}" for component in components]
        return tuple(range(first, len(self.names)))

    def _add(self, node):
        if self.components == PLANAR and not np.allclose(node.placement[2, :2], 0, atol=1e-9):
            raise InvalidInputError(
                f"link {self.robot.links[node.link].name!r} does not move in the plane: all axes must be parallel"
            )
        self.nodes.append(node)
        return len(self.nodes) - 1

    def _root(self, link, placement_in_link, name):
        """A root; named: a free one."""
        numbers = () if name is None else self._numbered(name)
        self.places.setdefault(link, []).append(self._add(Node(None, np.eye(4), link, placement_in_link, numbers)))

    def _link(self, number):
        joint = self.robot.joints[number - 1]
        parent, placed = self._nearest(joint.antecedent, joint.placement)
        leader, multiplier, _ = self.robot.mimic_relations[number - 1]
        coordinates = ()
        if number - 1 not in self.held:
            if leader not in self.of_joints:
                self.of_joints[leader] = len(self.names)
                self.names.append(self.robot.joints[leader].name)
            coordinates = (self.of_joints[leader],)
        if self.components == PLANAR and joint.prismatic:
            raise InvalidInputError(f"joint {joint.name!r} slides: in the plane joints turn, about parallel axes")
        joint = replace(joint, placement=placed)
        node = Node(parent, placed, number, np.eye(4), coordinates, None, joint, number - 1, multiplier)
        self.places[number] = [self._add(node)]
        flexibility = self.robot.links[number].flexibility
        for beam in () if flexibility is None else flexibility.beams:
            self._beam(number, beam)
        self._bodies(number)

    def _beam(self, link, beam):
        """The elements of a beam: of equal length, and cut besides where something hangs on it."""
        hung = [
            (share, closes)
            for point, closes in self.hung.get(link, ())
            if (share := locate_on_beam(beam, point)) is not None
        ]
        others = self.robot.links[link].flexibility.beams
        hung += [(share, False) for other in others if other is not beam
                 and (share := locate_on_beam(beam, other.placement[:3, 3])) is not None]  # fmt: skip
        ends = [*(k / beam.elements for k in range(1, beam.elements + 1)), *(share for share, _ in hung)]
        begin = beam.placement
        node, placed = self._nearest(link, begin)
        before = 0.0
        for share in sorted(ends):
            if (share - before) * beam.length <= COINCIDENCE_TOLERANCE:
                continue
            element = Element((share - before) * beam.length, beam.section, beam.material, beam.rotary_inertia)
            end = begin @ placement(translation=[share * beam.length, 0, 0])
            name = (
                f"{self.robot.links[link].name}.{sum(self.nodes[k].element is not None for k in self.places[link]) + 1}"
            )
            node = self._add(Node(node, placed, link, end, self._numbered(name), element))
            self.places[link].append(node)
            here = [closes for at, closes in hung if abs(at - share) * beam.length <= COINCIDENCE_TOLERANCE]
            goes_on = (1 - share) * beam.length > COINCIDENCE_TOLERANCE
            if any(here) and len(here) + goes_on > 1:
                node = self._junction(node, name)
            placed, before = np.eye(4), share

    def _junction(self, end, name):
        """A free body in the place of the end of an element, which closes on it."""
        link, placement_in_link = self.nodes[end].link, self.nodes[end].placement_in_link
        self._root(link, placement_in_link, f"{name} end")
        root = self.places[link][-1]
        self.closures.append(Closure(end, root, name))
        return root

    def _nearest(self, link, frame):
        """(node, placement (4, 4) in it) of a frame on a link: its last node among those that are nearest."""
        if link not in self.places:
            raise InvalidInputError(
                f"link {self.robot.links[link].name!r} is one of the platform's coordinates: nothing hangs there"
            )
        return nearest_node(self.nodes, self.places[link], frame)

    def _rigid(self, link, frame):
        """A node at a frame that is rigid with one of the nodes of a link."""
        node, placed = self._nearest(link, frame)
        return self._add(Node(node, placed, link, frame))

    def _bodies(self, link):
        """The rigid bodies on a link: it whole, where it does not bend."""
        told, flexibility = self.robot.links[link], self.robot.links[link].flexibility
        parts = [(np.zeros(3), told.inertia)]
        if flexibility is not None:
            parts = [(body.point, body.inertia) for body in flexibility.bodies]
        for point, inertia in parts:
            node, seen = self._nearest(link, placement(translation=point))
            if np.any(inertia.spatial):
                seen = invert_placement(self.nodes[node].placement_in_link)
                self.bodies.append((node, inertia.transformed_by(seen).spatial))

    def _springs(self):
        found = []
        for number, joint in enumerate(self.robot.joints):
            leader, multiplier, _ = self.robot.mimic_relations[number]
            if number not in self.held and leader in self.of_joints:
                stiffness = 0.0 if joint.spring is None else joint.spring.stiffness
                found.append((self.of_joints[leader], joint.rotor_inertia * multiplier**2, stiffness * multiplier**2))
        return found
