"""SDF to Robot: links that joints move become links of the tree, others are lumped into them and remain as frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.sdf.document import parse_sdf
from robot_dynamics.model.formats.sdf.gearboxes import GearboxReader
from robot_dynamics.model.formats.sdf.joint_axes import JointReader, axis_rotation
from robot_dynamics.model.formats.sdf.link_inertias import read_inertia
from robot_dynamics.model.formats.sdf.link_visuals import read_visuals
from robot_dynamics.model.formats.sdf.model_choice import choose_model
from robot_dynamics.model.formats.sdf.poses import Poses, without_rounding
from robot_dynamics.model.formats.sdf.scopes import Assembly
from robot_dynamics.model.formats.sdf.spanning_tree import JointEdge, span_tree
from robot_dynamics.model.formats.urdf.document import LineWarnings
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.mdh_table import make_unique_name
from robot_dynamics.model.placement import invert_placement, placement
from robot_dynamics.model.robot import EARTH_GRAVITY, Frame, Link, Robot, to_gravity_vector

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.model.formats.sdf.joint_axes import Motion
    from robot_dynamics.model.formats.sdf.scopes import Node
    from robot_dynamics.model.visual import Visual


def read_sdf(
    text: str | bytes,
    *,
    source: str | Path = "SDF",
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
) -> Robot:
    """Read a robot from the text of an SDF.

    Joint variables keep SDF's sign and zero. Meshes are never loaded. A visual that cannot
    be read is left out with a warning. Sensors and plugins are left out.

    Parameters
    ----------
    text : str or bytes
        The SDF.
    source : str or Path
        Name of the description in error messages; the Path of its file, if it has one: included models are searched
        around it, and in the folders that Gazebo's variables name.
    moving_base : bool, optional
        Whether the base can move freely. Default: True where no joint connects a link to the world.
    gravity : (3,) array_like, optional
        Acceleration of gravity in the world frame [m/s²]. Default: that of the world, else the Earth's, along -z.

    Returns
    -------
    Robot
        The robot.

    Raises
    ------
    DescriptionError
        If the text is not an SDF with one robot, or has a part that changes the dynamics and that no Robot can have.
    """
    warnings = LineWarnings()
    folder = source.absolute().parent if isinstance(source, Path) else None
    document = parse_sdf(text, str(source), folder, warnings)
    model, world_gravity = choose_model(document)
    builder = _Builder(Assembly(model), str(source))
    if gravity is None:
        gravity = EARTH_GRAVITY if world_gravity is None else world_gravity
        if builder.is_weightless():
            gravity = (0.0, 0.0, 0.0)
    try:
        robot = builder.build(model.name, moving_base, gravity)
    except DescriptionError as error:
        message = str(error)
        raise DescriptionError(message if str(source) in message else f"{source}: {message}") from None
    return replace(robot, reader_warnings=warnings.sentences)


@dataclass(eq=False)
class _Body:
    """A link of the robot: its name, its pose (4, 4) at zero joint positions, and its inertia."""

    name: str
    pose: Array
    inertia: Inertia


class _Builder:
    """Walks the tree of an assembly and collects links, joints, frames and loops."""

    def __init__(self, assembly: Assembly, source: str) -> None:
        self._assembly = assembly
        self._source = source
        self._poses = Poses(assembly)
        self._reader = JointReader(assembly, self._poses)
        self._bodies: list[_Body] = []
        self._joints: list[Joint] = []
        self._frames: list[Frame] = []
        self._loops: list[Loop] = []
        self._visuals: list[Visual] = []
        self._numbers: dict[Node, int] = {}
        if not assembly.links:
            self._fail(assembly.model, "it has no <link>: a robot has at least one")

    def _fail(self, node: Node, message: str) -> NoReturn:
        """Raise DescriptionError with the line of a node."""
        if node.scope is None or node.element is None:
            raise DescriptionError(f"{self._source}: {message}")
        node.scope.document.fail(node.element, f"{node.kind} {node.name!r}: {message}")

    def is_weightless(self) -> bool:
        """Return whether gravity acts on no link that moves. It is an error if it acts on some of them only."""
        links = self._assembly.links
        weightless = [
            node
            for node in links
            if node.scope is not None
            and node.element is not None
            and not node.scope.document.flag(node.element, "gravity", True)
        ]
        if weightless and len(weightless) < len(links):
            self._fail(weightless[0], "gravity does not act on it, but on other links: it acts on all or none here")
        return bool(weightless)

    def build(self, name: str, moving_base: bool | None, gravity: ArrayLike) -> Robot:
        """Return the Robot."""
        edges = self._edges()
        is_held = any(self._assembly.world in (edge.parent, edge.child) for edge in edges)
        moves = not is_held if moving_base is None else moving_base
        root, starts_in_world = self._find_base(edges, is_held, moves)
        tree = span_tree(root, self._assembly.links, edges)
        if tree.unreached:
            message = f"no joints connect it to {root.name!r}: one robot is needed. Remove it, or add a joint"
            self._fail(tree.unreached[0], message)
        self._start(root, starts_in_world)
        for edge, is_reversed in tree.steps:
            self._add_step(edge, is_reversed)
        self._add_named_frames()
        for edge in tree.cuts:
            self._close_loop(edge)
        return Robot(
            name=name,
            links=tuple(Link(body.name, body.inertia) for body in self._bodies),
            joints=tuple(self._joints),
            frames=tuple(self._frames),
            moving_base=moves,
            gravity=to_gravity_vector(gravity),
            loops=tuple(self._loops),
            visuals=tuple(self._visuals),
        )

    def _edges(self) -> list[JointEdge]:
        """Return all joints, but for gearboxes: they couple two others."""
        read = [self._edge(node) for node in self._assembly.joints]
        edges = [edge for edge in read if edge.kind != "gearbox"]
        gearboxes = GearboxReader(self._assembly, self._poses, self._reader)
        for edge in read:
            if edge.kind == "gearbox":
                gearboxes.couple(edge, edges)
        return edges

    def _edge(self, node: Node) -> JointEdge:
        """Return a joint with its links."""
        assert node.scope is not None and node.element is not None
        document, element = node.scope.document, node.element
        parent, child = (
            self._poses.link(self._assembly.find(node.scope, document.text(element, tag) or "", element))
            for tag in ("parent", "child")
        )
        if parent is child:
            self._fail(node, f"its parent and its child are fixed to each other, on {parent.name!r}")
        if child is self._assembly.world:
            self._fail(node, "its child is the world: exchange <parent> and <child>")
        return JointEdge(node, self._reader.kind(node), parent, child, self._reader.motions(node))

    def _find_base(self, edges: list[JointEdge], is_held: bool, moves: bool) -> tuple[Node, bool]:
        """Return the link at which the tree begins, and whether frame 0 is that of the world."""
        if is_held:
            return self._assembly.world, True
        children = {edge.child for edge in edges}
        roots = [link for link in self._assembly.links if link not in children]
        root = roots[0] if len(roots) == 1 else self._poses.link(self._assembly.model)
        pose = self._poses.model_in_world() @ self._poses.of(root)
        return root, not moves and not np.array_equal(without_rounding(pose), np.eye(4))

    def _start(self, root: Node, starts_in_world: bool) -> None:
        """Add link 0."""
        world = self._assembly.world
        if starts_in_world:
            self._bodies.append(_Body(world.name, self._poses.of(world), Inertia()))
            self._frames.append(Frame(world.name, 0, np.eye(4)))
            self._numbers[world] = 0
        else:
            self._bodies.append(_Body(root.name, self._poses.of(root), Inertia()))
        if root is not world:
            self._add_link(root, 0)

    def _add_link(self, node: Node, body: int) -> None:
        """Add the frame and the inertia of a link to a body."""
        assert node.scope is not None and node.element is not None
        document, element = node.scope.document, node.element
        document.check_children(element, "link")
        if document.flag(element, "kinematic"):
            self._fail(node, "it is kinematic, so that forces do not move it: remove <kinematic>")
        frame = self._placement(body, self._poses.of(node))
        self._numbers[node] = body
        self._frames.append(Frame(node.name, body, frame))
        self._visuals += read_visuals(document, element, node.name)
        self._bodies[body].inertia += read_inertia(document, element, node.name).transformed_by(frame)

    def _placement(self, body: int, pose: Array) -> Array:
        """Return a pose (4, 4) in the frame of a body at zero joint positions."""
        return without_rounding(invert_placement(self._bodies[body].pose) @ pose)

    def _add_step(self, edge: JointEdge, is_reversed: bool) -> None:
        """Add the link to which a joint of the tree leads, with links between its motions."""
        carrier, carried = (edge.child, edge.parent) if is_reversed else (edge.parent, edge.child)
        motions = [motion.reversed() for motion in reversed(edge.motions)] if is_reversed else edge.motions
        body = self._numbers[carrier]
        for motion in motions:
            is_last = motion is motions[-1]
            body = self._add_motion(edge, motion, body, carried.name if is_last else f"{carried.name}:{motion.name}")
            if not is_last:
                self._frames.append(Frame(self._bodies[body].name, body, np.eye(4)))
        self._add_link(carried, body)

    def _add_motion(self, edge: JointEdge, motion: Motion, carrier: int, link: str, actuated: bool = True) -> int:
        """Add a joint, and the link without inertia that it moves; return the number of the link."""
        pose = self._poses.of(edge.node) @ placement(axis_rotation(motion))
        self._joints.append(
            Joint(
                name=motion.name,
                antecedent=carrier,
                prismatic=motion.prismatic,
                placement=self._placement(carrier, pose),
                rotor_inertia=motion.rotor_inertia,
                viscous_friction=motion.viscous_friction,
                coulomb_friction=motion.coulomb_friction,
                limits=motion.limits,
                mimic=motion.mimic,
                actuated=motion.actuated and actuated,
                spring=motion.spring,
            )
        )
        self._bodies.append(_Body(link, pose, Inertia()))
        return len(self._joints)

    def _add_named_frames(self) -> None:
        """Add the elements <frame> as frames of the bodies that carry them."""
        taken = {frame.name for frame in self._frames}
        for node in self._assembly.frames:
            carrier = self._poses.link(node)
            body = self._numbers.get(carrier, 0)
            if node.name not in taken:
                self._frames.append(Frame(node.name, body, self._placement(body, self._poses.of(node))))
                taken.add(node.name)

    def _close_loop(self, edge: JointEdge) -> None:
        """Add the loop that a joint closes."""
        body, closing_body = self._numbers[edge.parent], self._numbers[edge.child]
        if body == closing_body:
            if edge.kind != "fixed":
                self._fail(edge.node, "its links are fixed to each other by other joints, so that it cannot move")
            return  # fixed twice
        pose = self._poses.of(edge.node)
        for motion in () if edge.kind == "ball" else edge.motions:
            taken = {frame.name for frame in self._frames}
            link = make_unique_name(f"{motion.name}_link", taken)
            body = self._add_motion(edge, motion, body, link, actuated=False if motion.mimic is None else True)
            self._frames.append(Frame(link, body, np.eye(4)))
            pose = self._bodies[body].pose
        moved = LoopEnd(body, self._placement(body, pose))
        closed_on = LoopEnd(closing_body, self._placement(closing_body, pose))
        self._loops.append(Loop(edge.node.name, moved, closed_on, is_spherical=edge.kind == "ball"))
