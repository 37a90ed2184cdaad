"""Robot to URDF: a text that `read_urdf` reads back into the same robot.

In URDF the axis of a joint passes through the origin of the link that the joint moves. The named frame of a link need
not be on the axis z_j. Where it is not, a link `<name>_joint` stands at frame j, and the named link is fixed to it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator
from functools import reduce
from typing import TYPE_CHECKING

import numpy as np
from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.urdf.document import XACRO_EXPRESSION
from robot_dynamics.model.formats.urdf.visual_writer import add_visual, list_numbers, list_texts
from robot_dynamics.model.formats.urdf.written_numbers import insert_origin, write_number, write_vector
from robot_dynamics.model.hull_primitives import primitive_visuals
from robot_dynamics.model.joint import UNLIMITED, Mimic, Spring
from robot_dynamics.model.joint_friction import FRICTION_FIELDS
from robot_dynamics.model.mdh_table import make_unique_name
from robot_dynamics.model.placement import invert_placement
from robot_dynamics.model.robot import EARTH_GRAVITY
from robot_dynamics.model.vector_product import skew

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.formats.urdf.document import Element
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.joint import Joint, Limits
    from robot_dynamics.model.robot import Frame, Robot
    from robot_dynamics.model.visual import Visual

ON_AXIS_TOLERANCE = 1e-12  # relative distance from an axis at which an origin counts as on it
MAX_CENTRE_OF_MASS_DISTANCE = 1e3  # [m] beyond this the inertia about the centre of mass has too few digits
MAX_LISTED_LOSSES = 20  # losses in an error
UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # not a character of XML 1.0


def write_urdf(robot: Robot, *, lossy: bool = False) -> str:
    """Return the text of a URDF that describes a robot, exact to rounding.

    Every named frame becomes a link. A moving base is connected by a floating joint to an additional link `world`.
    Joints are in the order of `robot.joints`. Where URDF requires a limit, an infinite one becomes UNLIMITED. The names
    of mesh files stay as they are, so relative ones need the same folder. The URDF has the
    visuals of the robot; `add_skeleton` makes them for a robot without any.

    Parameters
    ----------
    robot : Robot
        The robot.
    lossy : bool
        Omit what URDF cannot represent and list it in a comment at the top, instead of raising an error. Joints at
        which loops are cut remain, with their links without mass.

    Returns
    -------
    str
        The URDF, with XML declaration.

    Raises
    ------
    DescriptionError
        If URDF cannot represent the whole robot: rotor inertia, friction other than viscous and Coulomb, springs,
        unactuated joints, brakes, initial positions, loops, platforms, flexible links, another gravity than the
        Earth's, first moments without mass. The message lists them. Symbols, and names with characters that XML does
        not have, always raise this error.
    """
    _check_names(robot)
    _check_numbers(robot)
    _check_base(robot)
    losses = find_losses(robot)
    if losses and not lossy:
        text = "; ".join(losses[:MAX_LISTED_LOSSES])
        more = f"; ... and {len(losses) - MAX_LISTED_LOSSES} more" if len(losses) > MAX_LISTED_LOSSES else ""
        raise DescriptionError(
            f"robot {robot.name!r}: URDF cannot represent {text}{more}. Keep another format, or omit it (--lossy)"
        )
    root = _Writer(robot).write()
    if losses:
        root.addprevious(_comment(["Omitted, because URDF cannot represent it:", *losses]))
    tree = etree.ElementTree(root)
    urdf: str = etree.tostring(tree, pretty_print=True, xml_declaration=True, encoding="UTF-8").decode()
    return urdf


def _check_names(robot: Robot) -> None:
    """Raise DescriptionError for names with characters that XML lacks, and for those that are expressions of xacro.

    Only the robot's own name may be empty.
    """
    names = [("robot", robot.name)]
    names += [("joint", joint.name) for joint in robot.joints]
    names += [("link", frame.name) for frame in robot.frames]
    for kind, name in names:
        if not isinstance(name, str) or not (name or kind == "robot"):
            raise DescriptionError(f"{kind} {name!r}: a text is needed as its name")
        if match := UNWRITABLE.search(name):
            raise DescriptionError(f"{kind} {name!r}: XML has no character {match.group()!r}. Change the name")
        if match := XACRO_EXPRESSION.search(name):
            raise DescriptionError(f"{kind} {name!r}: {match.group()!r} begins an expression of xacro. Change the name")
    for visual in robot.visuals:
        for text in list_texts(visual):
            if match := UNWRITABLE.search(text):
                raise DescriptionError(f"visual of link {visual.frame!r}: XML has no character {match.group()!r}")


def _check_numbers(robot: Robot) -> None:
    """Raise DescriptionError for symbols and numbers that are not finite; only limits may be infinite."""
    for owner, values in _numbers_of(robot):
        for value in map(np.asarray, values):
            if value.dtype.kind not in "biuf":
                raise DescriptionError(f"{owner} has symbols: URDF holds numbers, give the symbols values first")
            if not np.isfinite(value).all():
                raise DescriptionError(f"{owner} has {value.tolist()}: finite numbers are needed")


def _numbers_of(robot: Robot) -> Iterator[tuple[str, tuple[object, ...]]]:
    """Yield (owner, all its numbers) of joints, links, frames and visuals, without infinite limits."""
    for joint in robot.joints:
        limits = [limit for limit in vars(joint.limits).values() if not _is_infinite(limit)]
        spring = joint.spring or Spring(0.0)
        mimic = joint.mimic or Mimic("")
        friction = (getattr(joint, field) for field in FRICTION_FIELDS)
        drive_parameters = (joint.rotor_inertia, *friction)
        numbers = (*drive_parameters, *vars(spring).values(), *limits, mimic.multiplier, mimic.offset)
        yield f"joint {joint.name!r}", (joint.placement, *numbers, joint.initial_position)
    for link in robot.links:
        yield f"link {link.name!r}", (link.inertia.mass, link.inertia.first_moments, link.inertia.second_moments)
    for frame in robot.frames:
        yield f"frame {frame.name!r}", (frame.placement,)
    for visual in robot.visuals:
        yield f"visual of link {visual.frame!r}", list_numbers(visual)


def _is_infinite(limit: float) -> bool:
    """Return whether a limit is an infinite number, not a symbol."""
    return np.asarray(limit).dtype.kind == "f" and math.isinf(limit)


def _check_base(robot: Robot) -> None:
    """Raise DescriptionError where the named frame of the base is not frame 0."""
    if np.abs(robot.frame(robot.base_link).placement - np.eye(4)).max() > ON_AXIS_TOLERANCE:
        raise DescriptionError(
            f"frame {robot.base_link!r} of the base is not frame 0: a URDF has no other frame of the base. "
            "Rename that frame, and give the name of the base to one whose placement is the identity"
        )


def find_losses(robot: Robot) -> list[str]:
    """Return what URDF cannot represent of a robot, as phrases: joint by joint, loop by loop, then link by link."""
    losses = []
    if not np.array_equal(robot.gravity, EARTH_GRAVITY):
        losses.append(f"gravity {robot.gravity.tolist()} m/s²")
    for joint in robot.joints:
        joint_losses = _joint_losses(joint)
        if joint_losses:
            losses.append(f"joint {joint.name!r}: {', '.join(joint_losses)}")
    for loop in robot.loops:
        moved, closed_on = (robot.links[end.link].name for end in loop.ends)
        losses.append(f"loop {loop.name!r}, which closes link {moved!r} on link {closed_on!r}")
    for platform in robot.platforms:
        name = robot.links[platform.link].name
        losses.append(f"that link {name!r} is the platform, free to move in {', '.join(platform.free)}")
    losses += [f"that link {link.name!r} is flexible" for link in robot.links if link.flexibility is not None]
    for link in robot.links:
        if _centre_of_mass(link.inertia) is None:
            moments, mass = link.inertia.first_moments.tolist(), link.inertia.mass
            losses.append(f"link {link.name!r}: first moments {moments} kg m of a mass of {write_number(mass)} kg")
    return losses


def _joint_losses(joint: Joint) -> list[str]:
    """Return what URDF cannot represent of a joint, as phrases."""
    units = ("kg", "N/m", "m", "N s/m") if joint.prismatic else ("kg m²", "N m/rad", "rad", "N m s/rad")
    inertia_unit, stiffness_unit, position_unit, damping_unit = units
    losses = []
    if joint.rotor_inertia:
        losses.append(f"rotor inertia {write_number(joint.rotor_inertia)} {inertia_unit}")
    losses += _friction_losses(joint, damping_unit)
    if joint.spring is not None:
        losses.append(
            f"spring of stiffness {write_number(joint.spring.stiffness)} {stiffness_unit}, "
            f"rest {write_number(joint.spring.rest)} {position_unit} and "
            f"damping {write_number(joint.spring.damping)} {damping_unit}"
        )
    if not joint.actuated:
        losses.append(f"role {joint.role}")
    if joint.brake:
        losses.append("brake")
    if joint.initial_position:
        losses.append(f"initial position {write_number(joint.initial_position)} {position_unit}")
    return losses


def _friction_losses(joint: Joint, viscous_unit: str) -> list[str]:
    """Return what URDF cannot represent of the friction of a joint, as phrases."""
    dry_unit, velocity_unit = ("N", "m/s") if joint.prismatic else ("N m", "rad/s")
    losses = []
    if joint.viscous_asymmetry:
        losses.append(f"asymmetry of viscous friction {write_number(joint.viscous_asymmetry)} {viscous_unit}")
    if joint.coulomb_asymmetry:
        losses.append(f"asymmetry of Coulomb friction {write_number(joint.coulomb_asymmetry)} {dry_unit}")
    if joint.stribeck_friction:
        losses.append(
            f"Stribeck friction {write_number(joint.stribeck_friction)} {dry_unit} at "
            f"{write_number(joint.stribeck_velocity)} {velocity_unit}"
        )
    if joint.load_friction:
        losses.append(f"load-dependent friction {write_number(joint.load_friction)}")
    return losses


def _centre_of_mass(inertia: Inertia) -> ScalarArray | None:
    """Return c (3,) [m] in the frame of an inertia, None where it is undefined: moments with hardly any mass."""
    if not np.any(inertia.first_moments):
        return np.zeros(3)
    if np.abs(inertia.first_moments).max() > MAX_CENTRE_OF_MASS_DISTANCE * inertia.mass:
        return None
    centre: ScalarArray = inertia.first_moments / inertia.mass
    return centre


def _comment(lines: Iterable[str]) -> Element:
    """Return an XML comment."""
    # XML has no -- in a comment; and a name must not look like <!DOCTYPE
    text = re.sub("-(?=-)|<(?=!)", r"\g<0> ", "\n  ".join(lines))
    return etree.Comment(f" {text}\n")


class _Writer:
    """Writes a robot link by link: the joint of the link, the link, and the frames that are fixed to it."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._root = etree.Element("robot", name=robot.name)
        self._taken = {*robot.frames_by_name, *robot.joint_numbers}  # some readers want all names different
        # for each link the name of the URDF link that its joint moves, and the jT (4, 4) of that one
        self._moved: list[tuple[str, ScalarArray]] = []
        # [m]; frames on a common normal can be far away, but must not increase the rounding of the others
        placements = [joint.placement for joint in robot.joints] + [frame.placement for frame in robot.frames]
        self._size = min(1.0, _reach(*placements))
        self._frames_on_link: list[list[Frame]] = [[] for _ in robot.links]
        for frame in robot.frames:
            self._frames_on_link[frame.link].append(frame)
        self._visuals_on_frame: dict[str, list[Visual]] = {}
        for visual in primitive_visuals(robot.visuals):
            self._visuals_on_frame.setdefault(visual.frame, []).append(visual)

    def write(self) -> Element:
        """Return the element <robot>."""
        if self._robot.moving_base:
            self._add_world()
        for number, link in enumerate(self._robot.links):
            name, placement = self._moved_link(number)
            self._moved.append((name, placement))
            element = self._add_link(name)
            _add_inertial(element, link.inertia, placement, self._has_explicit_inertial(number))
            self._add_visuals(element, name)
            if number:
                self._add_moving_joint(number)
            for frame in self._frames_on_link[number]:
                if frame.name != name:
                    self._add_visuals(self._add_link(frame.name), frame.name)
                    joint = self._add_joint(self._unique_name(f"{frame.name}_fixed"), "fixed", name, frame.name)
                    self._add_origin(joint, invert_placement(placement), frame.placement)
        return self._root

    def _has_explicit_inertial(self, number: int) -> bool:
        """Return whether a link without mass needs an <inertial>: it is drawn, and its inertia is not missing."""
        is_drawn = any(frame.name in self._visuals_on_frame for frame in self._frames_on_link[number])
        return is_drawn and not self._robot.links[number].lacks_inertial

    def _unique_name(self, name: str) -> str:
        """Return a name that is not taken, and take it."""
        unique = make_unique_name(name, self._taken)
        self._taken.add(unique)
        return unique

    def _moved_link(self, number: int) -> tuple[str, ScalarArray]:
        """Return name and jT (4, 4) of the URDF link that joint `number` moves: the named one if it is on the axis."""
        name = self._robot.links[number].name
        if number == 0:
            return name, np.eye(4)
        placement, joint = self._robot.frame(name).placement, self._robot.joints[number - 1]
        distance = math.hypot(placement[0, 3], placement[1, 3])
        if joint.prismatic or distance <= ON_AXIS_TOLERANCE * _reach(placement, joint.placement):
            return name, placement
        return self._unique_name(f"{name}_joint"), np.eye(4)

    def _add_world(self) -> None:
        """Add the link `world` and the floating joint of a moving base."""
        base = self._robot.base_link
        world = self._unique_name("world")
        self._add_link(world)
        self._add_joint(self._unique_name(f"{base}_floating"), "floating", world, base)

    def _add_link(self, name: str) -> Element:
        """Add an element <link>."""
        return etree.SubElement(self._root, "link", name=name)

    def _add_joint(self, name: str, kind: str, parent: str, child: str) -> Element:
        """Add an element <joint> with its parent and child."""
        element = etree.SubElement(self._root, "joint", name=name, type=kind)
        etree.SubElement(element, "parent", link=parent)
        etree.SubElement(element, "child", link=child)
        return element

    def _add_moving_joint(self, number: int) -> None:
        """Add the joint that moves link `number`."""
        joint = self._robot.joints[number - 1]
        parent, parent_placement = self._moved[joint.antecedent]
        child, child_placement = self._moved[number]
        is_unbounded = math.isinf(joint.limits.lower) and math.isinf(joint.limits.upper)
        kind = "prismatic" if joint.prismatic else "continuous" if is_unbounded else "revolute"
        element = self._add_joint(joint.name, kind, parent, child)
        self._add_origin(element, invert_placement(parent_placement), joint.placement, child_placement)
        etree.SubElement(
            element, "axis", xyz=write_vector(child_placement[2, :3], 1.0)
        )  # z_j in the frame of the child
        _add_limit(element, kind, joint.limits)
        friction = {"damping": joint.viscous_friction, "friction": joint.coulomb_friction}
        if any(friction.values()):
            etree.SubElement(
                element, "dynamics", {key: write_number(value) for key, value in friction.items() if value}
            )
        if joint.mimic is not None:
            multiplier, offset = write_number(joint.mimic.multiplier), write_number(joint.mimic.offset)
            etree.SubElement(element, "mimic", joint=joint.mimic.joint, multiplier=multiplier, offset=offset)

    def _add_origin(self, element: Element, *chain: ScalarArray) -> None:
        """Insert <origin> at the product of placements (4, 4) as the first child, unless that is the identity."""
        insert_origin(element, reduce(np.matmul, chain), self._size)

    def _add_visuals(self, element: Element, frame: str) -> None:
        """Add the visuals of a named frame to its URDF link, which stands at that frame."""
        for visual in self._visuals_on_frame.get(frame, ()):
            add_visual(element, visual)


def _reach(*placements: ScalarArray) -> float:
    """Return the largest length [m] in placements (4, 4)."""
    return float(max(np.abs(matrix[:3, 3]).max() for matrix in placements))


def _add_limit(element: Element, kind: str, limits: Limits) -> None:
    """Add <limit> with all attributes that URDF requires; nothing where all are infinite and none is required."""
    required = ("effort", "velocity") if kind == "continuous" else ("lower", "upper", "effort", "velocity")
    values: dict[str, float] = {key: getattr(limits, key) for key in required}
    if kind == "continuous" and all(map(math.isinf, values.values())):
        return
    finite = {key: math.copysign(UNLIMITED, value) if math.isinf(value) else value for key, value in values.items()}
    etree.SubElement(element, "limit", {key: write_number(value) for key, value in finite.items()})


def _add_inertial(element: Element, inertia: Inertia, placement: ScalarArray, is_explicit: bool) -> None:
    """Add <inertial> of an Inertia about frame j to the URDF link that stands at `placement`, jT (4, 4).

    is_explicit: whether zeros are written too.
    """
    if not inertia.mass and not np.any(inertia.second_moments) and not is_explicit:
        return
    centre = _centre_of_mass(inertia)
    if centre is None:
        centre = np.zeros(3)
    R, P = placement[:3, :3], placement[:3, 3]
    offset = skew(centre)
    steiner = inertia.mass * offset @ offset
    central = R.T @ (inertia.second_moments + steiner) @ R
    inertial = etree.SubElement(element, "inertial")
    size = min(1.0, np.abs([*centre, *P]).max())
    etree.SubElement(inertial, "origin", xyz=write_vector(R.T @ (centre - P), size), rpy="0 0 0")
    etree.SubElement(inertial, "mass", value=write_number(inertia.mass))
    rounding = np.finfo(float).eps * max(np.abs(inertia.second_moments).max(), np.abs(steiner).max())
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": (central[i, j] + central[j, i]) / 2 for i in range(3) for j in range(i, 3)}
    etree.SubElement(inertial, "inertia", {key: write_number(value, rounding) for key, value in entries.items()})
