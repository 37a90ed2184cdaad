"""SYMORO+ .par to Robot: rows that a joint moves become links, fixed ones are lumped into what carries them exactly.

Row j places frame j in that of its antecedent by the six MDH parameters; entry j of theta (revolute, sigma = 0) or of r
(prismatic, sigma = 1) holds the joint variable: `th2`, or `th2 - pi/2` where frame j is turned by -π/2 at th2 = 0.

The rows NL + 1 to NJ are cut joints, frames k: passive ones that move a link without inertia, or welds (sigma = 2). The
rows NJ + 1 to NF are the fixed frames k+B with which they coincide, in the same order (Khalil, section 2.2).
"""

import logging

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.par.document import DRIVE, FORCES, MOTION, ParDocument
from robot_dynamics.model.formats.par.evaluator import ParEvaluator
from robot_dynamics.model.inertia import INERTIA_ENTRIES, Inertia, symmetric_matrix
from robot_dynamics.model.joint import Joint, Spring
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.robot import EARTH_GRAVITY, Frame, Link, Robot

logger = logging.getLogger(__name__)

STATE = (*MOTION, "W0", "WP0", "V0", "VP0", *FORCES)


def read_par(text, *, source="par", values=None, moving_base=None, gravity=None):
    """Read a robot from the text of a SYMORO+ .par (str or bytes).

    source: what to call the description in errors. values: {name: number or expression of pi} for the names in it; the
    one name in theta or r of a row that has no value is the joint variable. moving_base: None: as is_floating says.
    gravity: (3,) [m/s²], in the world; None: G, which is that vector in frame 0, and without G the Earth's.

    Joints are joint_j, links link_j, fixed frames frame_j, of row j, where comments of `write_par` do not tell other
    names; a loop has the name of the joint at which it is cut, one that is welded is loop_j. What a .par tells of a
    state (QP, QDP, GAM, W0 ... VP0, FX ... CZ) and Z, where frame 0 stands for its user, is no part of the robot. An
    elastic joint (eta = 1) is at rest where its variable is zero.

    Raises DescriptionError, which tells the line, what is wrong and what would be right.
    """
    document = ParDocument(text, source)
    numbers = ParEvaluator(document, {} if values is None else values)
    return _Builder(document, numbers).build(moving_base, gravity)


class _Builder:
    """Walks the rows in their order and gathers links, joints and frames."""

    def __init__(self, document, numbers):
        self.document, self.evaluator = document, numbers
        self.placed = [(0, np.eye(4))]  # of each row, link 0 first: the link it belongs to and jT in the link's frame
        self.variables = {}  # row of each joint variable
        self.told_joints, self.rows = [], []  # of each joint: what Joint takes of it, and the row that it moves

    def build(self, moving_base, gravity):
        if moving_base is None:
            moving_base = self.document.is_floating
        with np.errstate(all="ignore"):  # what is not finite is refused
            self.inertias = [self._inertia(0) if moving_base else Inertia()]
            for row in range(1, self.document.frames + 1):
                self._row(row)
            self._check_ends()
            gravity = self._gravity() if gravity is None else gravity
            self._refuse_missing()
            self._tell_ignored()
            return self._robot(moving_base, gravity)

    def _row(self, row):
        choices, needed = (0, 1, 2), "0 (revolute), 1 (prismatic) or 2 (fixed)"
        if row > self.document.joints:
            choices, needed = (2,), f"2 (fixed), as it closes the loop that row {self._moved(row)} cuts,"
        sigma = self._choice("sigma", row, choices, needed)
        before = f"0 to {row - 1}, a frame that comes before," if row > 1 else "0, the base,"
        link, frame = self.placed[self._choice("ant", row, range(row), before)]
        frame = frame @ placement_from_mdh(self._mdh(row, sigma))
        if not np.isfinite(frame).all():
            self.document.fail(self._entry("d", row).line, f"row {row} places its frame too far away to be computed")
        inertia = self._inertia(row)
        if sigma == 2:
            self.inertias[link] += inertia.transformed_by(frame)
            self.placed.append((link, frame))
            return
        self.told_joints.append({"antecedent": link, "prismatic": sigma == 1, "placement": frame, **self._drive(row)})
        self.rows.append(row)
        self.inertias.append(inertia)
        self.placed.append((len(self.rows), np.eye(4)))

    def _moved(self, row):
        """The row of frame k of which a row is the frame k+B."""
        return row - (self.document.joints - self.document.links)

    def _loop_ends(self):
        """(row of frame k, row of frame k+B) of each loop."""
        return [(self._moved(row), row) for row in range(self.document.joints + 1, self.document.frames + 1)]

    def _check_ends(self):
        for moved, closed_on in self._loop_ends():
            if self.placed[moved][0] == self.placed[closed_on][0]:
                self.document.fail(
                    self._entry("ant", closed_on).line,
                    f"rows {moved} and {closed_on}, which are to coincide, are on the same link, so that they close "
                    "nothing",
                )

    def _entry(self, key, row):
        """The Entry of a row in a list that begins with row 1."""
        return self.evaluator.entry(key, row - 1)

    def _choice(self, key, row, choices, needed):
        return self.evaluator.choice(self._entry(key, row), f"{key} of row {row}", choices, needed)

    def _mdh(self, row, sigma):
        entries = {key: self._entry(key, row) for key in MDHParameters._fields}
        variable_in = {0: "theta", 1: "r"}.get(sigma)
        told = {key: self.evaluator.number(entry) for key, entry in entries.items() if key != variable_in}
        if variable_in is not None:
            entry = entries[variable_in]
            variable, told[variable_in] = self.evaluator.split_joint_variable(entry, f"{variable_in} of row {row}")
            if variable in self.variables:
                self.document.fail(
                    entry.line,
                    f"{variable} is the joint variable of row {self.variables[variable]} and of row {row}: each joint "
                    "needs one of its own, joints that depend on each other are not read",
                )
            if variable is not None:
                self.variables[variable] = row
        return MDHParameters(**told)

    def _of_link(self, key, row):
        """The Entry of a row in a list that begins with link 0 where the base floats, and has none of cut joints."""
        if row > self.document.links:
            return None
        number = row - 1 + self.document.is_floating
        return self.evaluator.entry(key, number) if number >= 0 else None

    def _not_negative(self, entry, what):
        number = self.evaluator.number(entry)
        if number < 0:
            self.document.fail(entry.line, f"{what} is {number:g}: zero or more is needed")
        return number

    def _inertia(self, row):
        second = [self.evaluator.number(self._of_link(key.upper(), row)) for key in INERTIA_ENTRIES]
        first = [self.evaluator.number(self._of_link(key, row)) for key in ("MX", "MY", "MZ")]
        mass = self._not_negative(self._of_link("M", row), f"mass M of link {row}")
        return Inertia(mass, first, symmetric_matrix(*second))

    def _drive(self, row):
        """What moves the joint of a row; spring None where it is rigid, or None without a motor."""
        told = ("rotor_inertia", "viscous_friction", "coulomb_friction")
        drive = {
            name: self._not_negative(self._of_link(key, row), f"{key} of row {row}")
            for name, key in zip(told, DRIVE, strict=True)
        }
        mu = self._choice("mu", row, (0, 1), "0 or 1, whether a motor drives it,") if self._has("mu") else 1
        if mu and row > self.document.links:
            self.document.fail(
                self._entry("mu", row).line,
                f"mu of row {row} is 1, but a loop is cut there (NL = {self.document.links}), where no motor can be: 0 "
                "is needed, or cut the loop at another joint, one without motor",
            )
        eta = self._choice("eta", row, (0, 1), "0 (rigid) or 1 (elastic)") if self._has("eta") else 0
        spring = None
        if eta:
            if not self._has("k"):
                self.document.fail(self._entry("eta", row).line, f"row {row} is elastic, but the list k is missing")
            spring = Spring(self._not_negative(self._entry("k", row), f"k of row {row}"))
        return {**drive, "actuated": bool(mu and not eta), "spring": spring}

    def _has(self, key):
        return key in self.document.lists

    def _gravity(self):
        return tuple(map(self.evaluator.number, self.document.lists["G"])) if self._has("G") else EARTH_GRAVITY

    def _refuse_missing(self):
        missing = self.evaluator.missing
        for name, line in missing.items():
            if name in self.variables:
                self.document.fail(
                    line, f"{name} is the variable of the joint of row {self.variables[name]}: it can stand only there"
                )
        if missing:
            names = sorted(missing, key=missing.get)
            first, line = names[0], missing[names[0]]
            told = ", ".join(names[:500]) + (f" and {len(missing) - 500} more" if len(missing) > 500 else "")
            self.document.fail(
                line,
                f"no value for {told}: write a number in its place, or give values (to the command robot-dynamics: "
                f"--set {first}=0.5 or --values FILE, with one line {first}: 0.5 for each)",
            )

    def _tell_ignored(self):
        """Log what the document says that the robot does not take up."""
        lists, numbers = self.document.lists, self.evaluator
        entries = {key: lists.get(key, []) for key in STATE}
        fixed = [row for row in self._fixed_rows() if row <= self.document.links]
        entries.update({key: [self._of_link(key, row) for row in fixed] for key in DRIVE if self._has(key)})
        told = [key for key, those in entries.items() if any(self._is_nonzero(entry) for entry in those)]
        if told:
            logger.warning("%s: %s say no part of the robot and are left out", self.document.source, ", ".join(told))
        pose = [None if numbers.unbound(entry) else numbers.evaluate_entry(entry) for entry in lists.get("Z", [])]
        if pose and pose != np.eye(4).ravel().tolist():
            logger.warning("%s: Z is left out: positions are told in frame 0, and G is", self.document.source)

    def _is_nonzero(self, entry):
        return not self.evaluator.unbound(entry) and self.evaluator.evaluate_entry(entry) != 0

    def _robot(self, moving_base, gravity):
        links = self._told_names("Links", ["link_0", *(f"link_{row}" for row in self.rows)], "links, the base first")
        names = self._told_names("Joints", [f"joint_{row}" for row in self.rows], "joints")
        rigid = [told["spring"] is None for told in self.told_joints]
        tree = self.document.joints == self.document.links
        if tree and any(rigid) and not any(told["actuated"] for told in self.told_joints):
            logger.warning("%s: mu is 0 throughout and taken as not said: joints are actuated", self.document.source)
            self.told_joints = [{**told, "actuated": told["spring"] is None} for told in self.told_joints]
        frames = tuple(self._frames(links))
        try:
            return Robot(
                name=self.document.robot_name,
                links=tuple(map(Link, links, self.inertias)),
                joints=tuple(Joint(name, **told) for name, told in zip(names, self.told_joints, strict=True)),
                frames=frames,
                moving_base=moving_base,
                gravity=gravity,
                loops=self._loops(names),
            )
        except DescriptionError as error:
            self.document.fail(None, str(error))

    def _loops(self, joint_names):
        joints = dict(zip(self.rows, joint_names, strict=True))
        cut = range(self.document.links + 1, self.document.joints + 1)
        names = self._told_names("Loops", [joints.get(row, f"loop_{row}") for row in cut], "loops")
        ends = [[LoopEnd(*self.placed[row]) for row in rows] for rows in self._loop_ends()]
        return tuple(Loop(name, *pair) for name, pair in zip(names, ends, strict=True))

    def _fixed_rows(self):
        return sorted(set(range(1, len(self.placed))) - set(self.rows))

    def _told_names(self, kind, names, what):
        line, told = self.document.names.get(kind, (None, [(name, None) for name in names]))
        if len(told) != len(names):
            self.document.fail(line, f"the comment {kind} = has {len(told)} names: there are {len(names)} {what}")
        return [name for name, _ in told]

    def _frames(self, links):
        """Each link is a frame at its own row, or at the one that the comment Frames = tells for its name."""
        unnamed = [(f"frame_{row}", row) for row in self._fixed_rows()]
        line, told = self.document.names.get("Frames", (None, unnamed))
        numbers = {name: number for number, name in enumerate(links)}
        for name, row in told:
            if row >= len(self.placed):
                self.document.fail(line, f"frame {name!r} is at row {row}: there are rows 0 to {len(self.placed) - 1}")
            if self.placed[row][0] != numbers.get(name, self.placed[row][0]):
                self.document.fail(line, f"frame {name!r} is at row {row}, which is not fixed to the link of that name")
        elsewhere = {name for name, _ in told}
        own = [Frame(name, link, np.eye(4)) for link, name in enumerate(links) if name not in elsewhere]
        return [*own, *(Frame(name, *self.placed[row]) for name, row in told)]
