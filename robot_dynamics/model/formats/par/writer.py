"""Robot to the text of a SYMORO+ .par, which `read_par` reads back.

Rows are frames of the robot, in the order of its links, then what else has a name. Comments tell the names:

    (* Joints = 'shoulder', 'elbow' *)
    (* Links = 'base', 'upper_arm', 'forearm' *)
    (* Loops = 'knee' *)
    (* Frames = 'forearm' 4, 'tool' 5 *)

Links are the base and the bodies of the rows that a joint moves, in their order, those of cut joints last. Loops are
told in the order of the rows of their frames k. Frames tells the row of each named frame, moved or fixed, 0 the base. A
link that is not among them has its named frame at its own row; one that is has its named frame, in which wrenches on it
are given, there, while its row is where the joint moves it. Fixed rows that Frames does not name only lead to others.
"""

import unicodedata

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.expression import format_angle, format_number
from robot_dynamics.model.formats.par.document import MAX_PAR_LENGTH, MAX_ROWS
from robot_dynamics.model.formats.par.table import ParRow, build_par_table
from robot_dynamics.model.inertia import INERTIA_ENTRIES
from robot_dynamics.model.joint import Limits
from robot_dynamics.model.mdh import MDHParameters

ANGLES = ("gamma", "alpha", "theta")
DRIVE = {"IA": "rotor_inertia", "FV": "viscous_friction", "FS": "coulomb_friction"}


def write_par(robot, *, lossy=False):
    """The text of a Robot in the frames that it has; see `minimal_frames` for those with the fewest numbers.

    lossy: leave out what a .par cannot say (limits, joints that follow others, rest and damping of springs, springs
    beside motors, brakes, initial positions, loops cut at ball joints, links that bend, what the platform is) and tell
    so in comments, instead of raising. The inertia of a base that stands enters no equation and has no place in the
    format either: it is left out, and a comment tells.
    A cut joint that has friction, for which a .par has no place, is written as a joint of the tree, its loop as a weld.

    Raises DescriptionError where something would be lost, a name cannot stand in a comment, or a number is a symbol.
    """
    for joint in robot.joints:
        if np.asarray(joint.placement).dtype == object:
            raise DescriptionError(f"joint {joint.name!r}: its placement has symbols, and cannot be written as numbers")
    lost = find_losses(robot)
    if lost and not lossy:
        raise DescriptionError(
            f"robot {robot.name!r}: a SYMORO+ .par cannot say this: {'; '.join(lost)}. "
            "Keep another format, or write it lossy (--lossy)"
        )
    file = build_par_table(robot)
    if len(file.rows) > MAX_ROWS:
        raise DescriptionError(f"robot {robot.name!r} has {len(file.rows)} rows: more than {MAX_ROWS} are not read")
    text = "\n".join(
        [
            f"(* Robotname = {_quoted(robot.name)} *)",
            *(f"(* Lost: {sentence} *)" for sentence in (*lost, *find_base_loss(robot))),
            *_header(robot, file),
            *_names(robot, file),
            "\n(* Geometric parameters: m, rad *)",
            *_geometry(file.rows),
            "\n(* Dynamic parameters about the origin of each frame: kg, kg m, kg m^2; at the joint: SI units *)",
            *_dynamics(robot, file.rows[: file.links]),
            "\n(* Joint parameters: 1 elastic, 0 rigid; N m/rad or N/m *)",
            *_elasticity(file.rows[: file.joints]),
            "\n(* Acceleration of gravity: m/s^2 *)",
            _list("G", map(format_number, robot.gravity)),
            "\n(* End of definition *)\n",
        ]
    )
    if len(text) > MAX_PAR_LENGTH:
        raise DescriptionError(
            f"robot {robot.name!r} takes {len(text)} characters: more than {MAX_PAR_LENGTH} are not read"
        )
    return text


def find_losses(robot):
    """What the format has no place for: sentences."""
    lost = []
    for joint in robot.joints:
        spring, what = joint.spring, []
        if joint.mimic is not None:
            what.append(f"follows joint {_quoted(joint.mimic.joint)}")
        if joint.limits != Limits():
            what.append("has limits")
        if joint.initial_position != 0:
            what.append("has an initial position")
        if joint.brake:
            what.append("has a brake")
        if spring is not None and joint.actuated:
            what.append("has a spring beside its motor")
        elif spring is not None:
            told = {"rest": "another rest position of its spring than zero", "damping": "damping of its spring"}
            what += [f"has {what_is}" for key, what_is in told.items() if getattr(spring, key) != 0]
        lost += [f"joint {_quoted(joint.name)} {' and '.join(what)}"] if what else []
    roles = {joint.role for joint in robot.joints}
    lost += [f"loop {_quoted(loop.name)} is cut at a ball joint" for loop in robot.loops if loop.is_spherical]
    lost += [f"link {_quoted(link.name)} bends" for link in robot.links if link.flexibility is not None]
    tree = all(loop.is_spherical for loop in robot.loops)
    if tree and "passive" in roles and roles <= {"passive", "elastic"}:
        lost.append("joints are passive, which is understood only where one joint at least is actuated")
    for platform in robot.platforms:
        name, free = robot.links[platform.link].name, ", ".join(platform.free)
        lost.append(f"link {_quoted(name)} is the platform, and free to move by {free}")
    return lost


def _header(robot, file):
    chain = all(row.antecedent == number for number, row in enumerate(file.rows))
    kind = 2 if file.loops else 0 if chain else 1
    sizes = [f"NL = {file.links}", f"NJ = {file.joints}", f"NF = {len(file.rows)}"]
    return [*sizes, f"Type = {kind}", f"is_floating = {int(robot.moving_base)}", "is_mobile = 0"]


def _names(robot, file):
    told = {
        "Joints": [_quoted(joint.name) for joint in robot.joints],
        "Links": [_quoted(link.name) for link in robot.links],
        "Loops": [_quoted(loop.name) for loop in file.loops],
        "Frames": [f"{_quoted(name)} {row}" for name, row in file.frames.items()],
    }
    if not file.loops:
        del told["Loops"]
    if not file.frames and len(file.rows) == len(robot.joints):
        del told["Frames"]
    return [f"(* {kind} = {', '.join(names)} *)" for kind, names in told.items()]


def _quoted(name):
    """A name as it stands in a comment."""
    told = f"'{name}'"
    if "'" in name or "(*" in told or "*)" in told or any(unicodedata.category(c) in ("Cc", "Cs") for c in name):
        raise DescriptionError(f"name {name!r} cannot stand in a comment of a .par: no quote, no (* *), no line break")
    return told


def _geometry(rows):
    told = {"ant": [], "sigma": [], "b": [], "d": [], "r": [], "gamma": [], "alpha": [], "mu": [], "theta": []}
    for number, (antecedent, row, joint, _) in enumerate(rows, start=1):
        told["ant"].append(str(antecedent))
        told["sigma"].append("2" if joint is None else "1" if joint.prismatic else "0")
        told["mu"].append(str(int(joint is not None and joint.actuated)))
        entries = {
            key: (format_angle if key in ANGLES else format_number)(value) for key, value in row._asdict().items()
        }
        if joint is not None:
            key, variable = ("r", f"r{number}") if joint.prismatic else ("theta", f"th{number}")
            entries[key] = _variable(variable, entries[key])
        for key, entry in entries.items():
            told[key].append(entry)
    return [_list(key, entries) for key, entries in told.items()]


def _variable(name, constant):
    """The joint variable and the text of the constant beside it."""
    if constant == "0":
        return name
    return f"{name} - {constant[1:]}" if constant.startswith("-") else f"{name} + {constant}"


def _dynamics(robot, rows):
    bodies = [ParRow(0, MDHParameters(), None, robot.links[0].inertia), *rows] if robot.moving_base else rows
    told = {
        key.upper(): [body.inertia.second_moments[index] for body in bodies] for key, index in INERTIA_ENTRIES.items()
    }
    told |= {key: [body.inertia.first_moments[k] for body in bodies] for k, key in enumerate(("MX", "MY", "MZ"))}
    told["M"] = [body.inertia.mass for body in bodies]
    told |= {key: [getattr(body.joint, name, 0) for body in bodies] for key, name in DRIVE.items()}
    lists = [_list(key, map(format_number, numbers)) for key, numbers in told.items()]
    return lists


def find_base_loss(robot):
    """A sentence where the base stands and has inertia, which is left out of the file; else none."""
    told = not robot.moving_base and np.any(robot.links[0].inertia.spatial)
    return ["the inertia of the base, which stands: it enters no equation"] if told else []


def _elasticity(rows):
    stiffness = [row.joint.spring.stiffness if getattr(row.joint, "role", "") == "elastic" else None for row in rows]
    eta = ["0" if k is None else "1" for k in stiffness]
    return [_list("eta", eta), _list("k", ("0" if k is None else format_number(k) for k in stiffness))]


def _list(key, entries):
    return f"{key} = {{{','.join(entries)}}}"
