"""Robot to the YAML text of its MDH table, which `read_mdh_yaml` reads back."""

import math
import re

import numpy as np
import yaml

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.expression import format_angle, format_number
from robot_dynamics.model.formats.mdh_yaml.beam_writer import BeamWriter, bodies_with_own_row, row_inertia
from robot_dynamics.model.inertia import INERTIA_ENTRIES
from robot_dynamics.model.joint import Limits
from robot_dynamics.model.mdh import MDHParameters, clean_angle, clean_length, mdh_from_placement
from robot_dynamics.model.mdh_table import build_mdh_table, make_unique_name
from robot_dynamics.model.placement import invert_placement, placement, roll_pitch_yaw
from robot_dynamics.model.robot import EARTH_GRAVITY

HEADER = """\
# Modified Denavit-Hartenberg parameters (Khalil and Kleinfinger). SI units: m, rad, kg, N m.
# A frame is placed in that of its antecedent by
#   Rot(z, gamma) Trans(z, b) Rot(x, alpha) Trans(x, d) Rot(z, theta) Trans(z, r);
# the joint variable adds to theta (revolute) or to r (prismatic). first_moments = mass * centre of mass, and
# inertia is the matrix about the origin of the frame, along its axes; both include all that is fixed to the link.
# A frame below with the name of a link says where wrenches and payloads on that link are told.
"""
PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/.-]*")


def write_mdh_yaml(robot):
    """The YAML text of a Robot in the frames that it has; see `minimal_frames` for those with the fewest numbers.

    Nothing of the Robot is lost. Raises DescriptionError where a number is a symbol.
    """
    ends = [(f"loop {loop.name!r}", end) for loop in robot.loops for end in loop.ends]
    for owner, placed in (*((f"joint {joint.name!r}", joint) for joint in robot.joints), *ends):
        if np.asarray(placed.placement).dtype == object:
            raise DescriptionError(f"{owner}: its placement has symbols, and cannot be written as numbers")
    lines = [HEADER, f"format: 1\nrobot: {_name(robot.name)}\n"]
    if tuple(robot.gravity) != EARTH_GRAVITY:
        lines.append(f"gravity: {_vector(robot.gravity)}\n")
    base = [f"link: {_name(robot.base_link)}", *(["moving: true"] if robot.moving_base else [])]
    links, cut, beams = {link.name: link for link in robot.links}, cut_joints(robot), BeamWriter(robot)
    lines += beams.definitions()
    lines += _block("base:", [*base, *_body(robot.links[0].inertia)], "  ")
    rows = build_mdh_table(robot, len(robot.joints) - len(cut))
    lines.append("\njoints:" if rows else "\njoints: []")
    taken = {*robot.frames_by_name, *(row.name for row in rows)}
    for row in rows:
        lines += _item(_row(row, links, beams))
        for body in bodies_with_own_row(links[row.name]) if row.joint is not None else []:
            taken.add(name := make_unique_name(f"{row.name}_body", taken))
            lines += _item(_fastened(name, row.name, body))
    lines += ["\nloops:"] if robot.loops else []
    for number, loop in enumerate(robot.loops):
        lines += _item(_loop(loop, robot, cut.get(number)))
    platforms = [_platform(robot, platform) for platform in robot.platforms]
    if len(platforms) == 1:
        lines += _block("\nplatform:", platforms[0], "  ")
    elif platforms:
        lines += ["\nplatforms:", *(entry for entries in platforms for entry in _item(entries))]
    frames = [told for frame in robot.frames if (told := _frame(frame, robot))]
    if frames:
        lines += ["\nframes:", *(f"  - {_mapping(frame)}" for frame in frames)]
    return "\n".join(lines) + "\n"


def _block(title, entries, indent):
    return [title, *(indent + entry for entry in entries)]


def _item(entries):
    first, *others = entries
    return [f"  - {first}", *(f"    {entry}" for entry in others)]


def _row(row, links, beams):
    """The entries of a TableRow."""
    joint = row.joint
    entries = [] if joint is None else [f"joint: {_name(joint.name)}"]
    entries += [f"link: {_name(row.name)}", f"antecedent: {_name(row.antecedent)}"]
    if joint is None or joint.prismatic:
        entries.append("type: prismatic" if joint else "type: fixed")
    if joint is None:
        entries.append("named: false")
    entries.append(f"mdh: {_mdh(row.parameters)}")
    if joint is not None:
        entries += [*_joint(joint), *_body(row_inertia(links[row.name])), *beams.entries(links[row.name])]
    return entries


def _fastened(name, link, body):
    """The entries of a fixed row for a Body on a link that bends."""
    at = placement(translation=body.point)
    entries = [f"link: {_name(name)}", f"antecedent: {_name(link)}", "type: fixed", "named: false"]
    return [
        *entries,
        f"mdh: {_mdh(mdh_from_placement(at)[0])}",
        *_body(body.inertia.transformed_by(invert_placement(at))),
    ]


def _mdh(row):
    """γ and b only where they are needed, the others always, as tables have them."""
    told = {key: format_angle(value) if key in ("gamma", "alpha", "theta") else format_number(value)
            for key, value in row._asdict().items()}  # fmt: skip
    return _mapping({key: text for key, text in told.items() if key not in ("gamma", "b") or text != "0"})


def _joint(joint):
    entries = []
    for key in ("rotor_inertia", "viscous_friction", "coulomb_friction"):
        if getattr(joint, key):
            entries.append(f"{key}: {format_number(getattr(joint, key))}")
    if joint.mimic is not None:
        mimic = {"multiplier": format_number(joint.mimic.multiplier), "offset": format_number(joint.mimic.offset)}
        entries.append(f"mimic: {_mapping({'joint': _name(joint.mimic.joint), **mimic})}")
    elif joint.role != "actuated" or joint.spring is not None:
        entries.append(f"role: {joint.role}")
    if joint.spring is not None:
        spring = {key: format_number(getattr(joint.spring, key)) for key in ("stiffness", "rest", "damping")}
        entries.append(f"spring: {_mapping(spring)}")
    limits = {key: getattr(joint.limits, key) for key in Limits.__dataclass_fields__}
    limits = {key: format_number(value) for key, value in limits.items() if math.isfinite(value)}
    entries += [f"limits: {_mapping(limits)}"] if limits else []
    entries += ["brake: true"] if joint.brake else []
    return [
        *entries,
        *([f"initial_position: {format_number(joint.initial_position)}"] if joint.initial_position else []),
    ]


def _loop(loop, robot, number):
    """The entries of a Loop, cut at joint `number` of the robot; None: at a ball joint or as a weld."""
    entries, (link, placement), told = [f"joint: {_name(loop.name)}"], loop.moved, []
    if number is None:
        entries.append(f"type: {'spherical' if loop.is_spherical else 'fixed'}")
    else:
        joint = robot.joints[number]
        entries += [f"link: {_name(robot.links[link].name)}", *(["type: prismatic"] if joint.prismatic else [])]
        link, placement = joint.antecedent, joint.placement
        told = [entry for entry in _joint(joint) if entry != "role: passive"]
    for key, end in (("moved", (link, placement)), ("closed_on", loop.closed_on)):
        entries.append(f"{key}: {_end(robot, *end)}")
    return [*entries, *told]


def _platform(robot, platform):
    """The entries of a Platform; its inertia, limits and initial pose stand in the rows of its coordinates."""
    names = ", ".join(_name(robot.joints[number].name) for number in platform.joints)
    base = [] if platform.base is None else [f"base: {_name(platform.base)}"]
    free = ", ".join(platform.free)
    return [
        f"link: {_name(robot.links[platform.link].name)}", *base, f"coordinates: [{names}]", f"free: [{free}]"
    ]  # fmt: skip


def _end(robot, link, placement):
    """A frame at an end of a loop, by mdh where one row can say it."""
    told, rows = {"antecedent": _name(robot.links[link].name)}, mdh_from_placement(placement)
    if len(rows) > 1:
        told |= _pose(placement)
    elif rows[0] != MDHParameters():
        told["mdh"] = _mdh(rows[0])
    return _mapping(told)


def _body(inertia):
    entries = []
    if inertia.mass != 0:
        entries.append(f"mass: {format_number(inertia.mass)}")
    if np.any(inertia.first_moments != 0):
        entries.append(f"first_moments: {_vector(inertia.first_moments)}")
    told = {key: inertia.second_moments[index] for key, index in INERTIA_ENTRIES.items()}
    told = {key: format_number(value) for key, value in told.items() if value != 0}
    return [*entries, *([f"inertia: {_mapping(told)}"] if told else [])]


def _frame(frame, robot):
    """The entries of a named frame; none where the rows place it already."""
    link, pose = robot.links[frame.link].name, _pose(frame.placement)
    if frame.name == link and not pose:
        return {}
    return {"frame": _name(frame.name), "link": _name(link), **pose}


def _pose(placement):
    """xyz and rpy; none where both are zero."""
    angles = [clean_angle(angle) for angle in roll_pitch_yaw(placement[:3, :3])]
    position = [clean_length(length) for length in placement[:3, 3]]
    if not any(angles + position):
        return {}
    return {"xyz": _vector(position), "rpy": f"[{', '.join(map(format_angle, angles))}]"}


def _mapping(texts):
    return "{" + ", ".join(f"{key}: {text}" for key, text in texts.items()) + "}"


def _vector(values):
    return f"[{', '.join(map(format_number, values))}]"


def _name(name):
    if PLAIN_NAME.fullmatch(name) and name not in ("true", "false", "null"):
        return name
    return yaml.safe_dump(name, default_style='"', width=math.inf, allow_unicode=True).strip()
