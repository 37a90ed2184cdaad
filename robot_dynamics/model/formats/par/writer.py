"""Robot to the text of a SYMORO+ .par, which `read_par` reads back.

Rows are frames of the robot, in the order of its links, then the other named frames. Comments contain the names:

    (* Joints = 'shoulder', 'elbow' *)
    (* Links = 'base', 'upper_arm', 'forearm' *)
    (* Loops = 'knee' *)
    (* Frames = 'forearm' 4, 'tool' 5 *)

Links are the base and the bodies of the rows with a joint, in their order, those of cut joints last. Loops are in the
order of the rows of their frames k. Frames contains the row of each named frame, moved or fixed, 0 for the base. A link
that is not in Frames has its named frame at its own row. A link in Frames has its named frame, in which wrenches on it
are expressed, at that row, while its own row is where the joint moves it. Fixed rows without a name in Frames only lead
to others.
"""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.expression import format_angle, format_number
from robot_dynamics.model.formats.par.document import GEOMETRY, MAX_PAR_LENGTH, MAX_ROWS
from robot_dynamics.model.formats.par.table import ParRow, build_par_table
from robot_dynamics.model.inertia import INERTIA_ENTRIES
from robot_dynamics.model.joint import Limits
from robot_dynamics.model.mdh import MDHParameters

if TYPE_CHECKING:
    from robot_dynamics.model.formats.par.table import ParTable
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.robot import Robot

ANGLES = ("gamma", "alpha", "theta")
DRIVE = {"IA": "rotor_inertia", "FV": "viscous_friction", "FS": "coulomb_friction"}


def write_par(robot: Robot, *, lossy: bool = False) -> str:
    """Return the text of a SYMORO+ .par that describes a robot in its own frames.

    Apply `minimal_frames` first for the frames with the fewest numbers. A cut joint with friction, for which a .par has
    no place, is written as a joint of the tree, and its loop as a weld.

    Parameters
    ----------
    robot : Robot
        The robot.
    lossy : bool
        Omit what a .par cannot represent and list it in comments, instead of raising an error.

    Returns
    -------
    str
        The .par. Limits of joints and the inertia of a fixed base, which enter no equation and have no place in the
        format, are always omitted and listed in comments.

    Raises
    ------
    DescriptionError
        If a .par cannot represent the dynamics of the robot: mimic joints, friction other than viscous and Coulomb,
        rest and damping of springs, springs at actuated joints, brakes, initial positions, spherical loops, flexible
        links, platforms. Symbols, and names that cannot stand in a comment, always raise this error.
    """
    for joint in robot.joints:
        if np.asarray(joint.placement).dtype == object:
            raise DescriptionError(f"joint {joint.name!r}: its placement has symbols, and cannot be written as numbers")
    losses = find_losses(robot)
    if losses and not lossy:
        raise DescriptionError(
            f"robot {robot.name!r}: a SYMORO+ .par cannot represent this: {'; '.join(losses)}. "
            "Keep another format, or omit it (--lossy)"
        )
    table = build_par_table(robot)
    if len(table.rows) > MAX_ROWS:
        raise DescriptionError(f"robot {robot.name!r} has {len(table.rows)} rows: the maximum is {MAX_ROWS}")
    text = "\n".join(
        [
            f"(* Robotname = {_quoted(robot.name)} *)",
            "(* Begin of definition *)",
            *(f"(* Lost: {sentence} *)" for sentence in (*losses, *find_harmless_losses(robot))),
            *_header(robot, table),
            *_names(robot, table),
            "\n(* Geometric parameters: m, rad *)",
            *_geometry(table.rows),
            "\n(* Dynamic parameters about the origin of each frame: kg, kg m, kg m^2; at the joint: SI units *)",
            *_dynamics(robot, table.rows[: table.links]),
            "\n(* Joint parameters: 1 elastic, 0 rigid; N m/rad or N/m *)",
            *_elasticity(table.rows[: table.joints]),
            "\n(* Acceleration of gravity: m/s^2 *)",
            _list("G", map(format_number, robot.gravity)),
            "\n(* End of definition *)\n",
        ]
    )
    if len(text) > MAX_PAR_LENGTH:
        raise DescriptionError(
            f"the .par of robot {robot.name!r} has {len(text)} characters: the maximum is {MAX_PAR_LENGTH}"
        )
    return text


def find_losses(robot: Robot) -> list[str]:
    """Return what a .par cannot represent of a robot, as sentences."""
    losses = []
    for joint in robot.joints:
        joint_losses = _joint_losses(joint)
        if joint_losses:
            losses.append(f"joint {_quoted(joint.name)} {' and '.join(joint_losses)}")
    losses += [f"loop {_quoted(loop.name)} is cut at a ball joint" for loop in robot.loops if loop.is_spherical]
    losses += [f"link {_quoted(link.name)} is flexible" for link in robot.links if link.flexibility is not None]
    is_tree = all(loop.is_spherical for loop in robot.loops)
    roles = {joint.role for joint in robot.joints}
    if is_tree and "passive" in roles and roles <= {"passive", "elastic"}:
        losses.append("joints are passive, which needs at least one actuated joint")
    for platform in robot.platforms:
        name = _quoted(robot.links[platform.link].name)
        losses.append(f"link {name} is the platform, free to move in {', '.join(platform.free)}")
    return losses


def _joint_losses(joint: Joint) -> list[str]:
    """Return what a .par cannot represent of a joint, as phrases."""
    losses = []
    if joint.mimic is not None:
        losses.append(f"mimics joint {_quoted(joint.mimic.joint)}")
    if joint.viscous_asymmetry or joint.coulomb_asymmetry:
        losses.append("has asymmetric friction")
    if joint.stribeck_friction:
        losses.append("has Stribeck friction")
    if joint.load_friction:
        losses.append("has load-dependent friction")
    if joint.initial_position != 0:
        losses.append("has an initial position")
    if joint.brake:
        losses.append("has a brake")
    if joint.spring is not None and joint.actuated:
        losses.append("has a spring beside its motor")
    elif joint.spring is not None:
        if joint.spring.rest != 0:
            losses.append("has a spring with a rest position other than zero")
        if joint.spring.damping != 0:
            losses.append("has a spring with damping")
    return losses


def _header(robot: Robot, table: ParTable) -> list[str]:
    """Return the lines of the header."""
    is_chain = all(row.antecedent == number for number, row in enumerate(table.rows))
    kind = 2 if table.loops else 0 if is_chain else 1
    sizes = [f"NL = {table.links}", f"NJ = {table.joints}", f"NF = {len(table.rows)}"]
    return [*sizes, f"Type = {kind}", f"is_floating = {int(robot.moving_base)}", "is_mobile = 0"]


def _names(robot: Robot, table: ParTable) -> list[str]:
    """Return the comments with names."""
    names = {
        "Joints": [_quoted(joint.name) for joint in robot.joints],
        "Links": [_quoted(link.name) for link in robot.links],
        "Loops": [_quoted(loop.name) for loop in table.loops],
        "Frames": [f"{_quoted(name)} {row}" for name, row in table.frames.items()],
    }
    if not table.loops:
        del names["Loops"]
    if not table.frames and len(table.rows) == len(robot.joints):
        del names["Frames"]
    return [f"(* {kind} = {', '.join(kind_names)} *)" for kind, kind_names in names.items()]


def _quoted(name: str) -> str:
    """Return a name as it stands in a comment. Raises DescriptionError where it cannot."""
    quoted = f"'{name}'"
    if "'" in name or "(*" in quoted or "*)" in quoted or any(unicodedata.category(c) in ("Cc", "Cs") for c in name):
        raise DescriptionError(f"name {name!r} cannot stand in a comment of a .par: no quote, no (* *), no line break")
    return quoted


def _geometry(rows: Iterable[ParRow]) -> list[str]:
    """Return the lines of the geometric parameters."""
    lists: dict[str, list[str]] = {key: [] for key in GEOMETRY}
    for number, (antecedent, parameters, joint, _) in enumerate(rows, start=1):
        lists["ant"].append(str(antecedent))
        lists["sigma"].append("2" if joint is None else "1" if joint.prismatic else "0")
        lists["mu"].append(str(int(joint is not None and joint.actuated)))
        entries = {
            key: (format_angle if key in ANGLES else format_number)(value)
            for key, value in parameters._asdict().items()
        }
        if joint is not None:
            key, variable = ("r", f"r{number}") if joint.prismatic else ("theta", f"th{number}")
            entries[key] = _add_constant(variable, entries[key])
        for key, entry in entries.items():
            lists[key].append(entry)
    return [_list(key, entries) for key, entries in lists.items()]


def _add_constant(variable: str, constant: str) -> str:
    """Return the text of a joint variable plus a constant."""
    if constant == "0":
        return variable
    return f"{variable} - {constant[1:]}" if constant.startswith("-") else f"{variable} + {constant}"


def _dynamics(robot: Robot, rows: Sequence[ParRow]) -> list[str]:
    """Return the lines of the dynamic parameters; link 0 is first where the base moves."""
    bodies = [ParRow(0, MDHParameters(), None, robot.links[0].inertia), *rows] if robot.moving_base else rows
    lists = {
        key.upper(): [body.inertia.second_moments[index] for body in bodies] for key, index in INERTIA_ENTRIES.items()
    }
    lists |= {key: [body.inertia.first_moments[k] for body in bodies] for k, key in enumerate(("MX", "MY", "MZ"))}
    lists["M"] = [body.inertia.mass for body in bodies]
    lists |= {key: [getattr(body.joint, name, 0) for body in bodies] for key, name in DRIVE.items()}
    return [_list(key, map(format_number, numbers)) for key, numbers in lists.items()]


def find_harmless_losses(robot: Robot) -> list[str]:
    """Return what a .par has no place for and no equation contains: limits, and the inertia of a fixed base."""
    limited = [_quoted(joint.name) for joint in robot.joints if joint.limits != Limits()]
    losses = [f"limits of {', '.join(limited)}, which enter no equation"] if limited else []
    if not robot.moving_base and np.any(robot.links[0].inertia.spatial):
        losses.append("the inertia of the fixed base, which enters no equation")
    return losses


def _elasticity(rows: Iterable[ParRow]) -> list[str]:
    """Return the lines of the joint parameters."""
    springs = [row.joint.spring if row.joint is not None and row.joint.role == "elastic" else None for row in rows]
    eta = ["0" if spring is None else "1" for spring in springs]
    stiffness = ["0" if spring is None else format_number(spring.stiffness) for spring in springs]
    return [_list("eta", eta), _list("k", stiffness)]


def _list(key: str, entries: Iterable[str]) -> str:
    """Return the line of a list."""
    return f"{key} = {{{','.join(entries)}}}"
