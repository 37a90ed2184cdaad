"""URDF to Robot: moving links become links of the tree; fixed ones are lumped into them and remain as frames."""

from __future__ import annotations

import io
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

import numpy as np
from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.urdf.document import LineWarnings, parse_urdf_text, remove_unused_elements
from robot_dynamics.model.formats.urdf.ignored_content import check_ignored_content
from robot_dynamics.model.formats.urdf.validation import check_urdf, warn_of_suspicious_numbers
from robot_dynamics.model.formats.urdf.visuals import read_visuals
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import UNLIMITED, Joint, Limits, Mimic
from robot_dynamics.model.placement import invert_placement, placement, rotation_with_z_along
from robot_dynamics.model.robot import EARTH_GRAVITY, MAX_JOINTS, Frame, Link, Robot, to_gravity_vector
from robot_dynamics.optional_packages import import_optional

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike
    from robot_dynamics.model.formats.urdf.document import Element


def read_urdf(
    text: str | bytes,
    *,
    source: str | Path = "URDF",
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
) -> Robot:
    """Read a robot from the text of a URDF.

    Joint variables keep URDF's sign and zero. Meshes are never loaded. A visual that cannot be read is left out with a
    warning, one of `Robot.warnings`.

    Parameters
    ----------
    text : str or bytes
        The URDF, or the bytes of its file.
    source : str or Path
        Name of the description in error messages; the Path of its file, if it has one: relative names of meshes begin
        in its folder.
    moving_base : bool, optional
        Whether the base can move freely. Default: True where a joint of type floating connects the root link to
        another link. That link is then the base, whose pose in the world is free; with a fixed base it stands at the
        origin of the joint.
    gravity : (3,) array_like, optional
        Acceleration of gravity in the world frame [m/s²]. Default: the Earth's, along -z.

    Returns
    -------
    Robot
        The robot. Fixed links are lumped into their parents.

    Raises
    ------
    DescriptionError
        If the text is not a URDF, or describes an impossible robot.
    MissingPackageError
        If yourdfpy, which parses URDFs, is not installed.
    """
    warnings = LineWarnings()
    root = parse_urdf_text(text, source, warnings)
    check_ignored_content(root, source, warnings)
    links_with_shapes = _links_with_shapes(root)
    visuals = read_visuals(root, source.absolute().parent if isinstance(source, Path) else None, warnings)
    remove_unused_elements(root, "robot")
    check_urdf(root, source)
    warn_of_suspicious_numbers(root, warnings)
    checked = io.BytesIO(etree.tostring(root))  # only the checked elements, without shapes
    yourdfpy = import_optional("yourdfpy", "reading a URDF")
    try:
        document = yourdfpy.URDF.load(checked, build_scene_graph=False, load_meshes=False)
    except Exception as error:  # a fault of the text that the checks do not cover
        raise DescriptionError(f"{source} cannot be read: {error}") from error
    robot = _Builder(document.robot, source, links_with_shapes).build(
        moving_base, EARTH_GRAVITY if gravity is None else gravity
    )
    # the link above a floating joint is no part of a robot with a moving base
    visuals = [visual for visual in visuals if visual.frame in robot.frames_by_name]
    return replace(robot, reader_warnings=warnings.sentences, visuals=tuple(visuals))


def _links_with_shapes(root: Element) -> frozenset[str]:
    """Return the names of the links with a shape: they are real parts of a robot, not virtual links."""
    return frozenset(
        link.get("name", "")
        for link in root.iterchildren("link")
        if link.find("visual") is not None or link.find("collision") is not None
    )


class _Branch(NamedTuple):
    """A link to visit: its name, the body that carries it, its placement (4, 4) there, and the joint that moves it."""

    link: str
    body: int
    placement: Array
    joint: Joint | None


@dataclass
class _Tree:
    """The parts of the robot, in the order of their numbers."""

    names: list[str]
    inertias: list[Inertia]
    joints: list[Joint]
    frames: list[Frame]


class _Builder:
    """Walks the tree of a URDF, as yourdfpy parsed it, from its root and collects bodies, joints and frames."""

    def __init__(self, description: Any, source: object, links_with_shapes: frozenset[str]) -> None:
        self._description = description
        self._source = source
        self._links_with_shapes = links_with_shapes
        self._inertials = {link.name: link.inertial for link in description.links}
        self._joints_from: dict[str, list[Any]] = {link.name: [] for link in description.links}
        self._joint_to: dict[str, Any] = {}
        for joint in description.joints:
            self._joints_from[joint.parent].append(joint)
            if joint.child in self._joint_to:
                self._fail(
                    f"link {joint.child!r} is the child of joint {self._joint_to[joint.child].name!r} and of joint "
                    f"{joint.name!r}: in a tree it has one parent"
                )
            self._joint_to[joint.child] = joint

    def _fail(self, message: object) -> NoReturn:
        """Raise DescriptionError with the source."""
        raise DescriptionError(f"{self._source}: {message}")

    def build(self, moving_base: bool | None, gravity: ArrayLike) -> Robot:
        """Return the Robot."""
        root = self._find_root()
        floating = self._find_floating_joint(root)
        if moving_base is None:
            moving_base = floating is not None
        base = floating.child if floating is not None and moving_base else root
        tree = self._walk(base)
        bodies_without_inertial = self._bodies_without_inertial(tree)
        try:
            return Robot(
                name=self._description.name,
                links=tuple(
                    Link(name, inertia, lacks_inertial=body in bodies_without_inertial)
                    for body, (name, inertia) in enumerate(zip(tree.names, tree.inertias, strict=True))
                ),
                joints=tuple(tree.joints),
                frames=tuple(tree.frames),
                moving_base=moving_base,
                gravity=to_gravity_vector(gravity),
            )
        except DescriptionError as error:
            self._fail(error)

    def _bodies_without_inertial(self, tree: _Tree) -> set[int]:
        """Return the numbers of the bodies that have a shape, but no <inertial> in any of their links."""
        with_shape = {frame.link for frame in tree.frames if frame.name in self._links_with_shapes}
        with_inertial = {frame.link for frame in tree.frames if self._inertials[frame.name] is not None}
        return with_shape - with_inertial

    def _find_root(self) -> str:
        """Return the only link without a parent."""
        moving = sum(joint.type != "fixed" for joint in self._description.joints)
        if moving > MAX_JOINTS:
            self._fail(f"{moving} moving joints are too many: the maximum is {MAX_JOINTS}")
        roots = [name for name in self._joints_from if name not in self._joint_to]
        if not roots:
            self._fail("every link is the child of a joint, so the joints close a cycle: one link must be the root")
        if len(roots) > 1:
            self._fail(f"links {' and '.join(map(repr, roots[:5]))} are all roots: every link but one needs a parent")
        self._check_reachable(roots[0])
        return roots[0]

    def _find_floating_joint(self, root: str) -> Any:
        """Return the floating joint at the root, None where there is none."""
        floating = [joint for joint in self._description.joints if joint.type == "floating"]
        for joint in floating:
            if joint.parent != root:
                self._fail(f"joint {joint.name!r} is floating inside the tree: only a joint at the root can be")
        if not floating:
            return None
        if len(self._joints_from[root]) > 1 or self._inertials[root] is not None:
            self._fail(
                f"joint {floating[0].name!r} floats but link {root!r} carries more: "
                "the parent of a floating joint is the world, without mass and other joints"
            )
        return floating[0]

    def _check_reachable(self, root: str) -> None:
        """Raise DescriptionError where the root does not lead to all links."""
        reached = set()
        stack = [root]
        while stack:
            name = stack.pop()
            reached.add(name)
            stack += [joint.child for joint in self._joints_from[name]]
        unreached = [name for name in self._joints_from if name not in reached]
        if unreached:
            names = ", ".join(map(repr, unreached[:5]))
            self._fail(f"links {names} form a cycle: the root {root!r} does not lead to them")

    def _walk(self, base: str) -> _Tree:
        """Visit every link once, depth first, the branches of a link in the order of the description."""
        tree = _Tree([base], [Inertia()], [], [])
        stack = [_Branch(base, 0, np.eye(4), None)]
        while stack:
            branch = stack.pop()
            body = branch.body
            if branch.joint is not None:
                tree.joints.append(branch.joint)
                tree.names.append(branch.link)
                tree.inertias.append(Inertia())
                body = len(tree.joints)
            tree.frames.append(Frame(branch.link, body, branch.placement))
            tree.inertias[body] += self._inertia(branch.link).transformed_by(branch.placement)
            stack += reversed([self._branch(joint, body, branch.placement) for joint in self._joints_from[branch.link]])
        return tree

    def _branch(self, joint: Any, body: int, frame: Array) -> _Branch:
        """Return the branch at a joint of a link that stands at `frame` (4, 4) in a body."""
        pose = frame @ (np.eye(4) if joint.origin is None else joint.origin)
        if joint.type in ("fixed", "floating"):  # a floating joint here belongs to a base that is held fixed
            return _Branch(joint.child, body, pose, None)
        rotation = placement(rotation_with_z_along(joint.axis))
        return _Branch(joint.child, body, invert_placement(rotation), self._joint(joint, body, pose @ rotation))

    def _inertia(self, name: str) -> Inertia:
        """Return the inertia of a link about the origin of its URDF frame."""
        inertial = self._inertials[name]
        if inertial is None:
            return Inertia()
        frame = np.eye(4) if inertial.origin is None else inertial.origin
        return Inertia.about_centre_of_mass(inertial.mass, inertial.inertia, frame)

    def _joint(self, joint: Any, antecedent: int, pose: Array) -> Joint:
        """Return the Joint of a joint of yourdfpy, whose frame stands at `pose` (4, 4) in its antecedent."""
        dynamics, mimic = joint.dynamics, joint.mimic
        types = {candidate.name: candidate.type for candidate in self._description.joints} if mimic else {}
        if mimic and types.get(mimic.joint) in ("fixed", "floating"):
            self._fail(f"joint {joint.name!r} mimics joint {mimic.joint!r}, which is {types[mimic.joint]}")
        return Joint(
            name=joint.name,
            antecedent=antecedent,
            prismatic=joint.type == "prismatic",
            placement=pose,
            viscous_friction=float(dynamics.damping or 0) if dynamics else 0.0,
            coulomb_friction=float(dynamics.friction or 0) if dynamics else 0.0,
            limits=_limits(joint),
            mimic=Mimic(mimic.joint, mimic.multiplier, mimic.offset) if mimic else None,
        )


def _limits(joint: Any) -> Limits:
    """Return the Limits of a joint of yourdfpy; those from UNLIMITED on are infinite."""
    keys = ["lower", "upper", "velocity", "effort"]
    if joint.type == "continuous":
        keys = ["velocity", "effort"]
    bounds = {} if joint.limit is None else {key: getattr(joint.limit, key) for key in keys}
    return Limits(**{key: value for key, value in bounds.items() if value is not None and abs(value) < UNLIMITED})
