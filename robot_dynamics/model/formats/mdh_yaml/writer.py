"""Robot to the YAML text of its MDH table, which `read_mdh_yaml` reads back."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
import yaml

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.cut_joints import cut_joints
from robot_dynamics.model.formats.expression import format_angle, format_number
from robot_dynamics.model.formats.mdh_yaml.beam_writer import BeamWriter, bodies_with_own_row, row_inertia
from robot_dynamics.model.formats.mdh_yaml.document import DOCUMENT_END
from robot_dynamics.model.inertia import INERTIA_ENTRIES
from robot_dynamics.model.joint_friction import FRICTION_FIELDS
from robot_dynamics.model.loop import LoopEnd
from robot_dynamics.model.mdh import MDHParameters, clean_angle, clean_length, mdh_from_placement
from robot_dynamics.model.mdh_table import build_mdh_table, make_unique_name
from robot_dynamics.model.placement import invert_placement, placement, roll_pitch_yaw
from robot_dynamics.model.robot import EARTH_GRAVITY

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.beam import RigidBody
    from robot_dynamics.model.inertia import Inertia
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.loop import Loop
    from robot_dynamics.model.mdh_table import MDHTableRow
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.robot import Frame, Link, Robot

HEADER = """\
%YAML 1.2
---
# Modified Denavit-Hartenberg parameters (Khalil and Kleinfinger). SI units: m, rad, kg, N m.
# A frame is placed in that of its antecedent by
#   Rot(z, gamma) Trans(z, b) Rot(x, alpha) Trans(x, d) Rot(z, theta) Trans(z, r);
# the joint variable adds to theta (revolute) or to r (prismatic). first_moments = mass * centre of mass, and
# inertia is the matrix about the origin of the frame, along its axes; both include all that is fixed to the link.
# A frame below with the name of a link is the frame in which wrenches and payloads on that link are expressed.
"""
PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_/.-]*")


def write_mdh_yaml(robot: Robot) -> str:
    """Return the YAML text that describes a robot in its own frames, without loss.

    Apply `minimal_frames` first for the frames with the fewest numbers.

    Parameters
    ----------
    robot : Robot
        The robot.

    Returns
    -------
    str
        The YAML.

    Raises
    ------
    DescriptionError
        If a number is a symbol.
    """
    _check_placements(robot)
    beams = BeamWriter(robot)
    cut = cut_joints(robot)
    lines = [HEADER, f"format: 1\nrobot: {_name(robot.name)}\n"]
    if tuple(robot.gravity) != EARTH_GRAVITY:
        lines.append(f"gravity: {_vector(robot.gravity)}\n")
    lines += beams.definitions()
    lines += _block("base:", _base(robot))
    lines += _rows(robot, len(robot.joints) - len(cut), beams)
    if robot.loops:
        lines.append("\nloops:")
    for number, loop in enumerate(robot.loops):
        lines += _item(_loop(loop, robot, cut.get(number)))
    lines += _platforms(robot)
    frames = [entries for frame in robot.frames if (entries := _frame(frame, robot))]
    if frames:
        lines += ["\nframes:", *(f"  - {_mapping(frame)}" for frame in frames)]
    return "\n".join([*lines, DOCUMENT_END]) + "\n"


def _check_placements(robot: Robot) -> None:
    """Raise DescriptionError where a placement has symbols."""
    placements = [(f"joint {joint.name!r}", joint.placement) for joint in robot.joints]
    placements += [(f"loop {loop.name!r}", end.placement) for loop in robot.loops for end in loop.ends]
    for owner, matrix in placements:
        if np.asarray(matrix).dtype == object:
            raise DescriptionError(f"{owner}: its placement has symbols, and cannot be written as numbers")


def _block(title: str, entries: Iterable[str]) -> list[str]:
    """Return the lines of a mapping with a title."""
    return [title, *("  " + entry for entry in entries)]


def _item(entries: Iterable[str]) -> list[str]:
    """Return the lines of a mapping in a list."""
    first, *others = entries
    return [f"  - {first}", *(f"    {entry}" for entry in others)]


def _base(robot: Robot) -> list[str]:
    """Return the entries of link 0."""
    entries = [f"link: {_name(robot.base_link)}"]
    if robot.moving_base:
        entries.append("moving: true")
    return entries + _inertia(robot.links[0].inertia)


def _rows(robot: Robot, joint_count: int, beams: BeamWriter) -> list[str]:
    """Return the lines of the rows of the first joints, and of the bodies on flexible links."""
    links = {link.name: link for link in robot.links}
    rows = build_mdh_table(robot, joint_count)
    lines = ["\njoints:" if rows else "\njoints: []"]
    taken = {*robot.frames_by_name, *(row.name for row in rows)}
    for row in rows:
        lines += _item(_row(row, links, beams))
        for body in bodies_with_own_row(links[row.name]) if row.joint is not None else []:
            name = make_unique_name(f"{row.name}_body", taken)
            taken.add(name)
            lines += _item(_body_row(name, row.name, body))
    return lines


def _row(row: MDHTableRow, links: Mapping[str, Link], beams: BeamWriter) -> list[str]:
    """Return the entries of a row."""
    if row.joint is None:
        return [
            f"link: {_name(row.name)}",
            f"antecedent: {_name(row.antecedent)}",
            "type: fixed",
            "named: false",
            f"mdh: {_mdh(row.parameters)}",
        ]
    link = links[row.name]
    entries = [
        f"joint: {_name(row.joint.name)}",
        f"link: {_name(row.name)}",
        f"antecedent: {_name(row.antecedent)}",
    ]
    if row.joint.prismatic:
        entries.append("type: prismatic")
    entries.append(f"mdh: {_mdh(row.parameters)}")
    return [*entries, *_joint(row.joint), *_inertia(row_inertia(link)), *beams.entries(link)]


def _body_row(name: str, link: str, body: RigidBody) -> list[str]:
    """Return the entries of a fixed row for a body on a flexible link."""
    frame = placement(translation=body.point)
    return [
        f"link: {_name(name)}",
        f"antecedent: {_name(link)}",
        "type: fixed",
        "named: false",
        f"mdh: {_mdh(mdh_from_placement(frame)[0])}",
        *_inertia(body.inertia.transformed_by(invert_placement(frame))),
    ]


def _mdh(row: MDHParameters) -> str:
    """Return the parameters of a row: γ and b only where they are not zero, the others always, as tables do."""
    texts = {}
    for key, value in row._asdict().items():
        text = format_angle(value) if key in ("gamma", "alpha", "theta") else format_number(value)
        if key not in ("gamma", "b") or text != "0":
            texts[key] = text
    return _mapping(texts)


def _joint(joint: Joint) -> list[str]:
    """Return the entries of a joint apart from its placement."""
    entries = []
    for key in ("rotor_inertia", *FRICTION_FIELDS):
        if getattr(joint, key):
            entries.append(f"{key}: {format_number(getattr(joint, key))}")
    if joint.mimic is not None:
        mimic = {
            "joint": _name(joint.mimic.joint),
            "multiplier": format_number(joint.mimic.multiplier),
            "offset": format_number(joint.mimic.offset),
        }
        entries.append(f"mimic: {_mapping(mimic)}")
    elif joint.role != "actuated" or joint.spring is not None:
        entries.append(f"role: {joint.role}")
    if joint.spring is not None:
        spring = {key: format_number(getattr(joint.spring, key)) for key in ("stiffness", "rest", "damping")}
        entries.append(f"spring: {_mapping(spring)}")
    limits = {key: format_number(value) for key, value in vars(joint.limits).items() if math.isfinite(value)}
    if limits:
        entries.append(f"limits: {_mapping(limits)}")
    if joint.brake:
        entries.append("brake: true")
    if joint.initial_position:
        entries.append(f"initial_position: {format_number(joint.initial_position)}")
    return entries


def _loop(loop: Loop, robot: Robot, number: int | None) -> list[str]:
    """Return the entries of a loop with cut joint `number`; None: it is spherical or a weld."""
    entries = [f"joint: {_name(loop.name)}"]
    closed_on = f"closed_on: {_loop_end(robot, loop.closed_on)}"
    if number is None:
        kind = "spherical" if loop.is_spherical else "fixed"
        return [*entries, f"type: {kind}", f"moved: {_loop_end(robot, loop.moved)}", closed_on]
    joint = robot.joints[number]
    entries.append(f"link: {_name(robot.links[loop.moved.link].name)}")
    if joint.prismatic:
        entries.append("type: prismatic")
    entries.append(f"moved: {_loop_end(robot, LoopEnd(joint.antecedent, joint.placement))}")
    return [*entries, closed_on, *(entry for entry in _joint(joint) if entry != "role: passive")]


def _loop_end(robot: Robot, end: LoopEnd) -> str:
    """Return the frame at an end of a loop, by mdh where one row suffices."""
    entries = {"antecedent": _name(robot.links[end.link].name)}
    rows = mdh_from_placement(end.placement)
    if len(rows) > 1:
        entries |= _pose(end.placement)
    elif rows[0] != MDHParameters():
        entries["mdh"] = _mdh(rows[0])
    return _mapping(entries)


def _platforms(robot: Robot) -> list[str]:
    """Return the lines of the platforms."""
    platforms = [_platform(robot, platform) for platform in robot.platforms]
    if not platforms:
        return []
    if len(platforms) == 1:
        return _block("\nplatform:", platforms[0])
    return ["\nplatforms:", *(line for entries in platforms for line in _item(entries))]


def _platform(robot: Robot, platform: Platform) -> list[str]:
    """Return the entries of a platform; its inertia, limits and initial pose are in the rows of its coordinates."""
    coordinates = ", ".join(_name(robot.joints[number].name) for number in platform.joints)
    entries = [f"link: {_name(robot.links[platform.link].name)}"]
    if platform.base is not None:
        entries.append(f"base: {_name(platform.base)}")
    return [*entries, f"coordinates: [{coordinates}]", f"free: [{', '.join(platform.free)}]"]


def _inertia(inertia: Inertia) -> list[str]:
    """Return the entries of an inertia that are not zero."""
    entries = []
    if inertia.mass != 0:
        entries.append(f"mass: {format_number(inertia.mass)}")
    if np.any(inertia.first_moments != 0):
        entries.append(f"first_moments: {_vector(inertia.first_moments)}")
    second_moments = {key: inertia.second_moments[index] for key, index in INERTIA_ENTRIES.items()}
    texts = {key: format_number(value) for key, value in second_moments.items() if value != 0}
    if texts:
        entries.append(f"inertia: {_mapping(texts)}")
    return entries


def _frame(frame: Frame, robot: Robot) -> dict[str, str]:
    """Return the entries of a named frame; none where a row already places it."""
    link = robot.links[frame.link].name
    pose = _pose(frame.placement)
    if frame.name == link and not pose:
        return {}
    return {"frame": _name(frame.name), "link": _name(link), **pose}


def _pose(matrix: ScalarArray) -> dict[str, str]:
    """Return xyz and rpy of a placement (4, 4); an empty mapping where both are zero."""
    angles = [clean_angle(angle) for angle in roll_pitch_yaw(matrix[:3, :3])]
    position = [clean_length(length) for length in matrix[:3, 3]]
    if not any(angles + position):
        return {}
    return {"xyz": _vector(position), "rpy": f"[{', '.join(map(format_angle, angles))}]"}


def _mapping(texts: Mapping[str, str]) -> str:
    """Return a mapping on one line."""
    return "{" + ", ".join(f"{key}: {text}" for key, text in texts.items()) + "}"


def _vector(values: Iterable[float]) -> str:
    """Return a list of numbers."""
    return f"[{', '.join(map(format_number, values))}]"


def _name(name: str) -> str:
    """Return a name, in quotes where it needs them."""
    if PLAIN_NAME.fullmatch(name) and name not in ("true", "false", "null"):
        return name
    return str(yaml.safe_dump(name, default_style='"', width=math.inf, allow_unicode=True)).strip()
