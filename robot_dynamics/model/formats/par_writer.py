"""Robot to the text of a SYMORO+ .par, which `read_par` reads back.

Rows are frames of the robot, in the order of its links, then what else has a name. Comments tell the names:

    (* Joints = 'shoulder', 'elbow' *)
    (* Links = 'base', 'upper_arm', 'forearm' *)
    (* Frames = 'forearm' 4, 'tool' 5 *)

Links are the base and the bodies of the rows that a joint moves, in their order. Frames tells the row of each named
frame, moved or fixed, 0 the base. A link that is not among them has its named frame at its own row; one that is has
its named frame, in which wrenches on it are given, there, while its row is where the joint moves it. A fixed row that
Frames does not name only leads to another one.
"""

import unicodedata
from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.expression import angle_text, number_text
from robot_dynamics.model.formats.par_document import LARGEST, MOST_ROWS
from robot_dynamics.model.inertia import MOMENTS, Inertia
from robot_dynamics.model.joint import Joint, Limits
from robot_dynamics.model.mdh import Row, rows_of
from robot_dynamics.model.mdh_table import table

ANGLES = ("gamma", "alpha", "theta")
DRIVE = {"IA": "rotor_inertia", "FV": "viscous_friction", "FS": "coulomb_friction"}


class _FileRow(NamedTuple):
    """One row of the file: number of the row that it is placed in, its six parameters, and what a joint moves there."""

    antecedent: int
    row: Row
    joint: Joint | None = None
    inertia: Inertia = Inertia()


def write_par(robot, *, lossy=False):
    """The text of a Robot in the frames that it has; see `minimal_frames` for those with the fewest numbers.

    lossy: leave out what a .par cannot say (limits, joints that follow others, rest and damping of springs, springs
    beside motors) and tell so in comments, instead of raising. The inertia of a base that stands enters no equation
    and has no place in the format either: it is left out, and a comment tells.

    Raises DescriptionError where something would be lost, a name cannot stand in a comment, or a number is a symbol.
    """
    for joint in robot.joints:
        if np.asarray(joint.placement).dtype == object:
            raise DescriptionError(f"joint {joint.name!r}: its placement has symbols, and cannot be written as numbers")
    lost = losses(robot)
    if lost and not lossy:
        raise DescriptionError(
            f"robot {robot.name!r}: a SYMORO+ .par cannot say this: {'; '.join(lost)}. "
            "Keep another format, or write it lossy (--lossy)"
        )
    rows, frames = _rows(robot)
    if len(rows) > MOST_ROWS:
        raise DescriptionError(f"robot {robot.name!r} has {len(rows)} rows: more than {MOST_ROWS} would not be read")
    text = "\n".join(
        [
            f"(* Robotname = {_quoted(robot.name)} *)",
            *(f"(* Lost: {sentence} *)" for sentence in (*lost, *standing_base(robot))),
            *_header(robot, rows),
            *_names(robot, rows, frames),
            "\n(* Geometric parameters: m, rad *)",
            *_geometry(rows),
            "\n(* Dynamic parameters about the origin of each frame: kg, kg m, kg m^2; at the joint: SI units *)",
            *_dynamics(robot, rows),
            "\n(* Joint parameters: 1 elastic, 0 rigid; N m/rad or N/m *)",
            *_elasticity(rows),
            "\n(* Acceleration of gravity: m/s^2 *)",
            _list("G", map(number_text, robot.gravity)),
            "\n(* End of definition *)\n",
        ]
    )
    if len(text) > LARGEST:
        raise DescriptionError(f"robot {robot.name!r} takes {len(text)} characters: more than {LARGEST} are not read")
    return text


def losses(robot):
    """What the format has no place for: sentences."""
    lost = []
    for joint in robot.joints:
        spring, what = joint.spring, []
        if joint.mimic is not None:
            what.append(f"follows joint {_quoted(joint.mimic.joint)}")
        if joint.limits != Limits():
            what.append("has limits")
        if spring is not None and joint.actuated:
            what.append("has a spring beside its motor")
        elif spring is not None:
            told = {"rest": "another rest position of its spring than zero", "damping": "damping of its spring"}
            what += [f"has {what_is}" for key, what_is in told.items() if getattr(spring, key) != 0]
        lost += [f"joint {_quoted(joint.name)} {' and '.join(what)}"] if what else []
    roles = {joint.role for joint in robot.joints}
    if "passive" in roles and roles <= {"passive", "elastic"}:
        lost.append("joints are passive, which is understood only where one joint at least is actuated")
    return lost


def _rows(robot):
    """(_FileRows, row of each named frame that is not that of a link at its own row)."""
    rows, numbers = [], {robot.base_link: 0}
    inertias = {link.name: link.inertia for link in robot.links}
    for told in table(robot):
        inertia = Inertia() if told.joint is None else inertias[told.name]
        rows.append(_FileRow(numbers[told.antecedent], told.row, told.joint, inertia))
        numbers[told.name] = len(rows)
    frames = {}
    for frame in robot.frames:
        link = robot.links[frame.link].name
        number = numbers[link]
        if not np.array_equal(frame.placement, np.eye(4)):
            for row in rows_of(frame.placement):
                rows.append(_FileRow(number, row))
                number = len(rows)
        if (frame.name, number) != (link, numbers[link]):
            frames[frame.name] = number
    return rows, frames


def _header(robot, rows):
    chain = all(row.antecedent == number for number, row in enumerate(rows))
    sizes = [f"{key} = {len(rows)}" for key in ("NL", "NJ", "NF")]
    return [*sizes, f"Type = {0 if chain else 1}", f"is_floating = {int(robot.moving_base)}", "is_mobile = 0"]


def _names(robot, rows, frames):
    told = {
        "Joints": [_quoted(joint.name) for joint in robot.joints],
        "Links": [_quoted(link.name) for link in robot.links],
        "Frames": [f"{_quoted(name)} {row}" for name, row in frames.items()],
    }
    if not frames and len(rows) == len(robot.joints):
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
        entries = {key: (angle_text if key in ANGLES else number_text)(value) for key, value in row._asdict().items()}
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
    bodies = [_FileRow(0, Row(), None, robot.links[0].inertia), *rows] if robot.moving_base else rows
    told = {key.upper(): [body.inertia.second_moments[index] for body in bodies] for key, index in MOMENTS.items()}
    told |= {key: [body.inertia.first_moments[k] for body in bodies] for k, key in enumerate(("MX", "MY", "MZ"))}
    told["M"] = [body.inertia.mass for body in bodies]
    told |= {key: [getattr(body.joint, name, 0) for body in bodies] for key, name in DRIVE.items()}
    lists = [_list(key, map(number_text, numbers)) for key, numbers in told.items()]
    return lists


def standing_base(robot):
    """A sentence where the base stands and has inertia, which is left out of the file; else none."""
    told = not robot.moving_base and np.any(robot.links[0].inertia.spatial)
    return ["the inertia of the base, which stands: it enters no equation"] if told else []


def _elasticity(rows):
    stiffness = [row.joint.spring.stiffness if getattr(row.joint, "role", "") == "elastic" else None for row in rows]
    eta = ["0" if k is None else "1" for k in stiffness]
    return [_list("eta", eta), _list("k", ("0" if k is None else number_text(k) for k in stiffness))]


def _list(key, entries):
    return f"{key} = {{{','.join(entries)}}}"
