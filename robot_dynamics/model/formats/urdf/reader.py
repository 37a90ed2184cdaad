"""URDF to Robot: links that move become bodies, fixed ones are lumped into them exactly and stay known as frames."""

import io

import numpy as np
from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.urdf.document import check_urdf, parse_urdf_text
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import UNLIMITED, Joint, Limits, Mimic
from robot_dynamics.model.placement import invert_placement, placement, rotation_with_z_along
from robot_dynamics.model.robot import EARTH_GRAVITY, MAX_JOINTS, Frame, Link, Robot
from robot_dynamics.optional_packages import import_optional


def read_urdf(text, *, source="URDF", moving_base=None, gravity=None):
    """Read a robot from the text of a URDF (str or bytes).

    source: what to call the description in errors. gravity: (3,) [m/s²], in the world; None: the Earth's. moving_base:
    whether the base is free to move; None: it is where a joint of type floating leaves the root link. The base is then
    the link that floats, whose pose in the world is what the joint leaves open; held fixed, it stands where the joint's
    origin says.

    The variable of each joint keeps URDF's sign and zero. Meshes are never loaded. Raises DescriptionError,
    and MissingPackageError where the package that parses URDFs is not installed.
    """
    root = parse_urdf_text(text, source)
    check_urdf(root, source)
    checked = io.BytesIO(etree.tostring(root))  # yourdfpy gets what the checks saw, and nothing to draw
    yourdfpy = import_optional("yourdfpy", "reading a URDF")
    try:
        document = yourdfpy.URDF.load(checked, build_scene_graph=False, load_meshes=False)
    except Exception as error:  # what the checks let pass and yourdfpy cannot read is still the text's fault
        raise DescriptionError(f"{source} cannot be read: {error}") from error
    return _Builder(document.robot, source).build(moving_base, EARTH_GRAVITY if gravity is None else gravity)


class _Builder:
    """Walks the tree of a URDF from its root and gathers bodies, joints and frames."""

    def __init__(self, description, source):
        self.description, self.source = description, source
        self.inertials = {link.name: link.inertial for link in description.links}
        self.joints_from = {link.name: [] for link in description.links}
        self.joint_to = {}
        for joint in description.joints:
            self.joints_from[joint.parent].append(joint)
            if joint.child in self.joint_to:
                self._fail(
                    f"link {joint.child!r} is the child of joint {self.joint_to[joint.child].name!r} and of joint "
                    f"{joint.name!r}: in a tree it has one parent"
                )
            self.joint_to[joint.child] = joint

    def _fail(self, message):
        raise DescriptionError(f"{self.source}: {message}")

    def build(self, moving_base, gravity):
        root = self._root()
        floating = self._floating_joint(root)
        if moving_base is None:
            moving_base = floating is not None
        base = floating.child if floating is not None and moving_base else root
        self.names, self.inertias, self.joints, self.frames = [base], [Inertia()], [], []
        self._walk(base)
        try:
            return self._robot(moving_base, gravity)
        except DescriptionError as error:
            self._fail(error)

    def _robot(self, moving_base, gravity):
        return Robot(
            name=self.description.name,
            links=tuple(map(Link, self.names, self.inertias)),
            joints=tuple(self.joints),
            frames=tuple(self.frames),
            moving_base=moving_base,
            gravity=gravity,
        )

    def _root(self):
        """The one link that is nobody's child."""
        moving = sum(joint.type != "fixed" for joint in self.description.joints)
        if moving > MAX_JOINTS:
            self._fail(f"{moving} moving joints are more than are read: {MAX_JOINTS} at most")
        roots = [name for name in self.joints_from if name not in self.joint_to]
        if not roots:
            self._fail("every link is the child of a joint, so the joints close a cycle: one link must be the root")
        if len(roots) > 1:
            self._fail(f"links {' and '.join(map(repr, roots[:5]))} are all roots: every link but one needs a parent")
        self._check_reached(roots[0])
        return roots[0]

    def _floating_joint(self, root):
        """The floating joint that leaves the root, None where there is none."""
        floating = [joint for joint in self.description.joints if joint.type == "floating"]
        for joint in floating:
            if joint.parent != root:
                self._fail(f"joint {joint.name!r} is floating inside the tree: only a joint at the root can be")
        if not floating:
            return None
        if len(self.joints_from[root]) > 1 or self.inertials[root] is not None:
            self._fail(
                f"joint {floating[0].name!r} floats but link {root!r} carries more: "
                "a link that a floating joint leaves is the world, without mass and other joints"
            )
        return floating[0]

    def _check_reached(self, root):
        reached, front = set(), [root]
        while front:
            reached.add(name := front.pop())
            front += [joint.child for joint in self.joints_from[name]]
        lost = [name for name in self.joints_from if name not in reached]
        if lost:
            self._fail(f"links {', '.join(map(repr, lost[:5]))} form a cycle: the root {root!r} does not lead to them")

    def _walk(self, base):
        """Visit every link once, branch by branch, and the branches of a link in the order of the description."""
        front = [(base, 0, np.eye(4), None)]  # link, body it belongs to, placement in its frame, joint that moves it
        while front:
            name, body, frame, moved_by = front.pop()
            if moved_by is not None:
                self.joints.append(moved_by)
                self.names.append(name)
                self.inertias.append(Inertia())
                body = len(self.joints)
            self.frames.append(Frame(name, body, frame))
            self.inertias[body] += self._inertia(name).transformed_by(frame)
            branches = []
            for joint in self.joints_from[name]:
                placed = frame @ (np.eye(4) if joint.origin is None else joint.origin)
                if joint.type in ("fixed", "floating"):  # what floats from the base has been told to stand
                    branches.append((joint.child, body, placed, None))
                else:
                    turn = placement(rotation_with_z_along(joint.axis))
                    branches.append(
                        (joint.child, None, invert_placement(turn), self._joint(joint, body, placed @ turn))
                    )
            front += reversed(branches)

    def _inertia(self, name):
        inertial = self.inertials[name]
        if inertial is None:
            return Inertia()
        frame = np.eye(4) if inertial.origin is None else inertial.origin
        return Inertia.about_centre_of_mass(inertial.mass, inertial.inertia, frame)

    def _joint(self, joint, antecedent, placed):
        limit, dynamics, mimic = joint.limit, joint.dynamics, joint.mimic
        leaders = {other.name: other.type for other in self.description.joints} if mimic else {}
        if mimic and leaders.get(mimic.joint) in ("fixed", "floating"):
            self._fail(f"joint {joint.name!r} mimics joint {mimic.joint!r}, which is {leaders[mimic.joint]}")
        bounds = {} if limit is None else {key: getattr(limit, key) for key in ("lower", "upper", "velocity", "effort")}
        bounds = {key: value for key, value in bounds.items() if value is not None and abs(value) < UNLIMITED}
        if joint.type == "continuous":
            bounds.pop("lower", None), bounds.pop("upper", None)
        return Joint(
            name=joint.name,
            antecedent=antecedent,
            prismatic=joint.type == "prismatic",
            placement=placed,
            viscous_friction=float(dynamics.damping or 0) if dynamics else 0.0,
            coulomb_friction=float(dynamics.friction or 0) if dynamics else 0.0,
            limits=Limits(**bounds),
            mimic=Mimic(mimic.joint, mimic.multiplier, mimic.offset) if mimic else None,
        )
