"""Robot to URDF: a text that read_urdf reads back into the same robot.

In URDF the axis of a joint passes through the origin of the link that the joint moves. The named frame of a link need
not be on the axis z_j: where it is not, a link `<name>_joint` stands at frame j, and the named one is fixed to it.
"""

import math
import re
from functools import reduce

import numpy as np
from lxml import etree

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.inertia import skew
from robot_dynamics.model.joint import UNLIMITED, Mimic, Spring
from robot_dynamics.model.mdh import ROUNDING, clean_angle
from robot_dynamics.model.mdh_table import make_unique_name
from robot_dynamics.model.placement import invert_placement, roll_pitch_yaw
from robot_dynamics.model.robot import EARTH_GRAVITY

ON_AXIS_TOLERANCE = 1e-12  # an origin is on an axis that it misses by this part of the lengths around it
MAX_CENTRE_OF_MASS_DISTANCE = 1e3  # [m] of mass from its frame: farther, the inertia about it keeps too few digits
MAX_LISTED_LOSSES = 20  # losses in an error
UNWRITABLE = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")  # what XML 1.0 has no character for


def write_urdf(robot, *, lossy=False):
    """The text of a URDF (str, with XML declaration) that says the same of a Robot, exact to rounding.

    Every named frame becomes a link; a moving base hangs by a floating joint from a link `world` that is added. The
    joints stand in the order of `robot.joints`. An infinite limit becomes UNLIMITED where URDF demands a number.

    Raises DescriptionError, with a list, where URDF cannot say all of it: rotor inertia, springs, joints without motor,
    brakes, initial positions, loops, what the platform is, links that bend, another gravity than EARTH, first moments
    without mass. With `lossy` this is left out, and the list stands in a comment at the top; joints at which loops are
    cut stay, with their links without mass. Symbols and names that XML cannot hold are always refused.
    """
    _check_names(robot)
    _check_numbers(robot)
    _check_base(robot)
    lost = find_losses(robot)
    if lost and not lossy:
        listed = "; ".join(lost[:MAX_LISTED_LOSSES])
        more = f"; ... and {len(lost) - MAX_LISTED_LOSSES} more" if len(lost) > MAX_LISTED_LOSSES else ""
        raise DescriptionError(
            f"robot {robot.name!r}: URDF cannot say {listed}{more}. Keep another format, or write it lossy (--lossy)"
        )
    root = _Writer(robot).write()
    if lost:
        root.addprevious(_comment(["URDF cannot say, so it is left out:", *lost]))
    tree = etree.ElementTree(root)
    return etree.tostring(tree, pretty_print=True, xml_declaration=True, encoding="UTF-8").decode()


def _check_names(robot):
    """Refuse names that XML cannot hold; only the robot's own may be empty."""
    names = [("robot", robot.name), *(("joint", joint.name) for joint in robot.joints)]
    for kind, name in [*names, *(("link", frame.name) for frame in robot.frames)]:
        if not isinstance(name, str) or not (name or kind == "robot"):
            raise DescriptionError(f"{kind} {name!r}: a text is needed as its name")
        if found := UNWRITABLE.search(name):
            raise DescriptionError(f"{kind} {name!r}: XML cannot hold the character {found.group()!r} of its name")


def _check_numbers(robot):
    """Refuse symbols and what is not finite; only limits may be infinite."""
    for owner, values in _numbers_of(robot):
        for value in map(np.asarray, values):
            if value.dtype.kind not in "biuf":
                raise DescriptionError(f"{owner} has symbols: URDF holds numbers, give the symbols values first")
            if not np.isfinite(value).all():
                raise DescriptionError(f"{owner} has {value.tolist()}: finite numbers are needed")


def _numbers_of(robot):
    """(owner, all numbers of it) of joints, links and frames; limits that are infinite left out."""
    for joint in robot.joints:
        limits = [limit for limit in vars(joint.limits).values() if not _is_infinite(limit)]
        spring, mimic = joint.spring or Spring(0.0), joint.mimic or Mimic("")
        losses = (joint.rotor_inertia, joint.viscous_friction, joint.coulomb_friction, *vars(spring).values())
        numbers = (*losses, *limits, mimic.multiplier, mimic.offset, joint.initial_position)
        yield f"joint {joint.name!r}", (joint.placement, *numbers)
    for link in robot.links:
        yield f"link {link.name!r}", (link.inertia.mass, link.inertia.first_moments, link.inertia.second_moments)
    for frame in robot.frames:
        yield f"frame {frame.name!r}", (frame.placement,)


def _is_infinite(limit):
    return np.asarray(limit).dtype.kind == "f" and math.isinf(limit)


def _check_base(robot):
    """Refuse a base whose named frame is not frame 0."""
    if np.abs(robot.frame(robot.base_link).placement - np.eye(4)).max() > ON_AXIS_TOLERANCE:
        raise DescriptionError(
            f"frame {robot.base_link!r} of the base is not frame 0: a URDF has no other frame of the base. "
            "Give that frame another name, and the name of the base to one whose placement is the identity"
        )


def find_losses(robot):
    """What URDF cannot say of the robot: phrases, joint by joint, loop by loop, then link by link."""
    found = []
    if not np.array_equal(robot.gravity, EARTH_GRAVITY):
        found.append(f"gravity {robot.gravity.tolist()} m/s²")
    for joint in robot.joints:
        unit = ("kg", "N/m", "m", "N s/m") if joint.prismatic else ("kg m²", "N m/rad", "rad", "N m s/rad")
        lost = [f"rotor inertia {_number(joint.rotor_inertia)} {unit[0]}"] if joint.rotor_inertia else []
        if joint.spring is not None:
            lost.append(
                f"spring of stiffness {_number(joint.spring.stiffness)} {unit[1]}, "
                f"rest {_number(joint.spring.rest)} {unit[2]} and damping {_number(joint.spring.damping)} {unit[3]}"
            )
        if not joint.actuated:
            lost.append("that no motor drives it")
        if joint.brake:
            lost.append("that a brake holds it")
        if joint.initial_position:
            lost.append(f"initial position {_number(joint.initial_position)} {unit[2]}")
        if lost:
            found.append(f"joint {joint.name!r}: {', '.join(lost)}")
    for loop in robot.loops:
        moved, closed_on = (robot.links[end.link].name for end in loop.ends)
        found.append(f"loop {loop.name!r}, which closes link {moved!r} on link {closed_on!r}")
    for platform in robot.platforms:
        name, free = robot.links[platform.link].name, ", ".join(platform.free)
        found.append(f"that link {name!r} is the platform, and free to move by {free}")
    found += [f"that link {link.name!r} bends" for link in robot.links if link.flexibility is not None]
    for link in robot.links:
        if _centre_of_mass(link.inertia) is None:
            moments, mass = link.inertia.first_moments.tolist(), link.inertia.mass
            found.append(f"link {link.name!r}: first moments {moments} kg m of a mass of {_number(mass)} kg")
    return found


def _centre_of_mass(inertia):
    """c (3,) [m] in the frame of the inertia, None where there is none: moments without mass, or with hardly any."""
    if not np.any(inertia.first_moments):
        return np.zeros(3)
    if np.abs(inertia.first_moments).max() > MAX_CENTRE_OF_MASS_DISTANCE * inertia.mass:
        return None
    return inertia.first_moments / inertia.mass


def _comment(lines):
    # XML has no -- in a comment; and no one is to take a name for a <!DOCTYPE
    text = re.sub("-(?=-)|<(?=!)", r"\g<0> ", "\n  ".join(lines))
    return etree.Comment(f" {text}\n")


class _Writer:
    """Writes link after link of a robot: its joint, itself, and what is fixed to it."""

    def __init__(self, robot):
        self.robot = robot
        self.root = etree.Element("robot", name=robot.name)
        self.taken = {*robot.frames_by_name, *robot.joint_numbers}  # some readers want all names different
        self.moved = []  # for each link the name of the URDF link that its joint moves, and the jT (4, 4) of that one
        # [m]; frames on a common normal can be far away, but nothing is to be rounded more for that
        self.size = min(1.0, _reach(*(item.placement for item in (*robot.joints, *robot.frames))))
        self.fixed = [[] for _ in robot.links]
        for frame in robot.frames:
            self.fixed[frame.link].append(frame)

    def write(self):
        """The element <robot>."""
        if self.robot.moving_base:
            self._add_world()
        for number, link in enumerate(self.robot.links):
            name, frame = self._moved(number)
            self.moved.append((name, frame))
            _add_inertial(self._add_link(name), link.inertia, frame)
            if number:
                self._add_moving_joint(number)
            for other in self.fixed[number]:
                if other.name != name:
                    self._add_link(other.name)
                    joint = self._add_joint(self._free(f"{other.name}_fixed"), "fixed", name, other.name)
                    self._add_origin(joint, invert_placement(frame), other.placement)
        return self.root

    def _free(self, name):
        found = make_unique_name(name, self.taken)
        self.taken.add(found)
        return found

    def _moved(self, number):
        """Name and jT (4, 4) of the URDF link that joint `number` moves: the named one where it is on the axis."""
        name = self.robot.links[number].name
        if number == 0:
            return name, np.eye(4)
        frame, joint = self.robot.frame(name).placement, self.robot.joints[number - 1]
        miss = math.hypot(frame[0, 3], frame[1, 3])
        if joint.prismatic or miss <= ON_AXIS_TOLERANCE * _reach(frame, joint.placement):
            return name, frame
        return self._free(f"{name}_joint"), np.eye(4)

    def _add_world(self):
        base, world = self.robot.base_link, self._free("world")
        self._add_link(world)
        self._add_joint(self._free(f"{base}_floating"), "floating", world, base)

    def _add_link(self, name):
        return etree.SubElement(self.root, "link", name=name)

    def _add_joint(self, name, kind, parent, child):
        element = etree.SubElement(self.root, "joint", name=name, type=kind)
        etree.SubElement(element, "parent", link=parent)
        etree.SubElement(element, "child", link=child)
        return element

    def _add_moving_joint(self, number):
        joint = self.robot.joints[number - 1]
        (parent, before), (child, frame) = self.moved[joint.antecedent], self.moved[number]
        unbounded = math.isinf(joint.limits.lower) and math.isinf(joint.limits.upper)
        kind = "prismatic" if joint.prismatic else "continuous" if unbounded else "revolute"
        element = self._add_joint(joint.name, kind, parent, child)
        self._add_origin(element, invert_placement(before), joint.placement, frame)
        etree.SubElement(element, "axis", xyz=_numbers(frame[2, :3], 1.0))  # z_j in the frame of the child
        _add_limit(element, kind, joint.limits)
        friction = {"damping": joint.viscous_friction, "friction": joint.coulomb_friction}
        if any(friction.values()):
            etree.SubElement(element, "dynamics", {key: _number(value) for key, value in friction.items() if value})
        if joint.mimic is not None:
            multiplier, offset = _number(joint.mimic.multiplier), _number(joint.mimic.offset)
            etree.SubElement(element, "mimic", joint=joint.mimic.joint, multiplier=multiplier, offset=offset)

    def _add_origin(self, element, *chain):
        """<origin> at the product of placements (4, 4), as the first child; none where that is the identity."""
        placed = reduce(np.matmul, chain)
        xyz = _numbers(placed[:3, 3], self.size)
        # with rounding gone roll is zero where pitch is a right angle, and not what rounding makes of it
        angles = roll_pitch_yaw(np.where(np.abs(placed[:3, :3]) <= ROUNDING, 0.0, placed[:3, :3]))
        rpy = _numbers([math.pi if angle == -math.pi else angle for angle in map(clean_angle, angles)], 1.0)
        if (xyz, rpy) != ("0 0 0", "0 0 0"):
            element.insert(0, etree.Element("origin", xyz=xyz, rpy=rpy))


def _reach(*placements):
    """The largest length [m] in placements (4, 4)."""
    return max(np.abs(matrix[:3, 3]).max() for matrix in placements)


def _add_limit(element, kind, limits):
    """<limit> with all that URDF demands in it; none where all is infinite and none is demanded."""
    demanded = ("effort", "velocity") if kind == "continuous" else ("lower", "upper", "effort", "velocity")
    values = {key: getattr(limits, key) for key in demanded}
    if kind == "continuous" and all(map(math.isinf, values.values())):
        return
    written = {key: math.copysign(UNLIMITED, value) if math.isinf(value) else value for key, value in values.items()}
    etree.SubElement(element, "limit", {key: _number(value) for key, value in written.items()})


def _add_inertial(element, inertia, frame):
    """<inertial> of an Inertia about frame j, in the URDF link that stands at `frame`, jT (4, 4), in it."""
    if not inertia.mass and not np.any(inertia.second_moments):
        return
    centre = _centre_of_mass(inertia)
    if centre is None:
        centre = np.zeros(3)
    R, P, offset = frame[:3, :3], frame[:3, 3], skew(centre)
    steiner = inertia.mass * offset @ offset
    central = R.T @ (inertia.second_moments + steiner) @ R
    inertial = etree.SubElement(element, "inertial")
    size = min(1.0, np.abs([*centre, *P]).max())
    etree.SubElement(inertial, "origin", xyz=_numbers(R.T @ (centre - P), size), rpy="0 0 0")
    etree.SubElement(inertial, "mass", value=_number(inertia.mass))
    rounding = np.finfo(float).eps * max(np.abs(inertia.second_moments).max(), np.abs(steiner).max())
    entries = {f"i{'xyz'[i]}{'xyz'[j]}": (central[i, j] + central[j, i]) / 2 for i in range(3) for j in range(i, 3)}
    etree.SubElement(inertial, "inertia", {key: _number(value, rounding) for key, value in entries.items()})


def _numbers(values, size=0.0):
    """Numbers as URDF writes a vector; size: of the numbers that they were computed from."""
    return " ".join(_number(value, ROUNDING * size) for value in values)


def _number(value, rounding=0.0):
    """The number in digits that read back as it, or in fewer that miss it by no more than `rounding`."""
    value = float(value)
    short = 0.0 if abs(value) <= rounding else float(f"{value:.12g}")
    if abs(value - short) <= rounding:
        value = short
    return repr(value).removesuffix(".0")
