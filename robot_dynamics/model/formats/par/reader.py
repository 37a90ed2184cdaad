"""SYMORO+ .par to Robot: rows with a joint become links; fixed rows are lumped into the links that carry them.

Row j places frame j in that of its antecedent by the six MDH parameters. Entry j of theta (revolute, sigma = 0) or of r
(prismatic, sigma = 1) contains the joint variable: `th2`, or `th2 - pi/2` where frame j is turned by -π/2 at th2 = 0.

The rows NL + 1 to NJ are cut joints, frames k: passive joints that move a link without inertia, or welds (sigma = 2).
The rows NJ + 1 to NF are the fixed frames k+B with which they coincide, in the same order (Khalil, section 2.2).
"""

from __future__ import annotations

import logging
from collections.abc import Container, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.par.document import DRIVE, FORCES, MOTION, ParDocument
from robot_dynamics.model.formats.par.evaluator import ParEvaluator
from robot_dynamics.model.inertia import INERTIA_ENTRIES, Inertia, symmetric_matrix
from robot_dynamics.model.joint import Joint, Spring
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.mdh import MDHParameters, placement_from_mdh
from robot_dynamics.model.robot import EARTH_GRAVITY, Frame, Link, Robot, to_gravity_vector

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike, ScalarArray
    from robot_dynamics.model.formats.par.document import Entry, NameComment

logger = logging.getLogger(__name__)

STATE = (*MOTION, "W0", "WP0", "V0", "VP0", *FORCES)


def read_par(
    text: str | bytes,
    *,
    source: str | Path = "par",
    values: Mapping[str, float | str] | None = None,
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
) -> Robot:
    """Read a robot from the text of a SYMORO+ .par.

    Parameters
    ----------
    text : str or bytes
        The .par, or the bytes of its file.
    source : str or Path
        Name of the description in error messages.
    values : mapping of str to float or str, optional
        Numbers or expressions of pi for names in the text. The one name without value in theta or r of a row is the
        joint variable.
    moving_base : bool, optional
        Whether the base can move freely. Default: as is_floating.
    gravity : (3,) array_like, optional
        Acceleration of gravity in the world frame [m/s²]. Default: G, which is that vector in frame 0; without G the
        Earth's, along -z.

    Returns
    -------
    Robot
        The robot.

    Raises
    ------
    DescriptionError
        If the text cannot be read. The message has the line, the error and the remedy.

    Notes
    -----
    Of row j the joint is joint_j, the link link_j and a fixed frame frame_j, unless comments of `write_par` contain
    other names. A loop has the name of its cut joint; a welded one is loop_j. Data about a state (QP, QDP, GAM, W0 to
    VP0, FX to CZ) and Z, the pose of frame 0, are ignored. An elastic joint (eta = 1) is at rest at zero position.
    """
    document = ParDocument(text, source)
    evaluator = ParEvaluator(document, {} if values is None else values)
    return _Builder(document, evaluator).build(moving_base, gravity)


@dataclass(frozen=True)
class _Drive:
    """Drive of a joint: rotor inertia, friction, and a motor or a spring."""

    rotor_inertia: float
    viscous_friction: float
    coulomb_friction: float
    actuated: bool
    spring: Spring | None


@dataclass(frozen=True)
class _JointRow:
    """A joint without its name, and the row that it moves."""

    row: int
    antecedent: int
    prismatic: bool
    placement: ScalarArray
    drive: _Drive

    def joint(self, name: str) -> Joint:
        """Return the Joint with a name."""
        return Joint(name, self.antecedent, self.prismatic, self.placement, **vars(self.drive))


class _Builder:
    """Reads the rows in their order and collects links, joints and frames."""

    def __init__(self, document: ParDocument, evaluator: ParEvaluator) -> None:
        self._document = document
        self._evaluator = evaluator
        # for each row, link 0 first: the link that carries its frame, and jT (4, 4) in the frame of the link
        self._poses: list[tuple[int, ScalarArray]] = [(0, np.eye(4))]
        self._variable_rows: dict[str, int] = {}
        self._joint_rows: list[_JointRow] = []
        self._inertias: list[Inertia] = []

    def build(self, moving_base: bool | None, gravity: ArrayLike | None) -> Robot:
        """Return the Robot; None: moving_base and gravity from the document."""
        if moving_base is None:
            moving_base = self._document.is_floating
        with np.errstate(all="ignore"):  # numbers that are not finite raise DescriptionError later
            self._inertias.append(self._inertia(0) if moving_base else Inertia())
            for row in range(1, self._document.frames + 1):
                self._read_row(row)
            self._check_loop_ends()
            gravity = self._gravity() if gravity is None else gravity
            self._refuse_missing_values()
            self._warn_of_ignored_data()
            return self._robot(moving_base, gravity)

    def _read_row(self, row: int) -> None:
        """Read a row: its frame, and its joint and link, or the body that is fixed to its antecedent."""
        choices: tuple[int, ...] = (0, 1, 2)
        requirement = "0 (revolute), 1 (prismatic) or 2 (fixed)"
        if row > self._document.joints:
            choices = (2,)
            requirement = f"2 (fixed), as it closes the loop that row {self._cut_row(row)} cuts,"
        sigma = self._choice("sigma", row, choices, requirement)
        requirement = f"0 to {row - 1}, a frame that comes before," if row > 1 else "0, the base,"
        link, frame = self._poses[self._choice("ant", row, range(row), requirement)]
        frame = frame @ placement_from_mdh(self._mdh(row, sigma))
        if not np.isfinite(frame).all():
            self._document.fail(self._entry("d", row).line, f"row {row} places its frame too far away to be computed")
        inertia = self._inertia(row)
        if sigma == 2:
            self._inertias[link] += inertia.transformed_by(frame)
            self._poses.append((link, frame))
            return
        self._joint_rows.append(_JointRow(row, link, sigma == 1, frame, self._drive(row)))
        self._inertias.append(inertia)
        self._poses.append((len(self._joint_rows), np.eye(4)))

    def _cut_row(self, row: int) -> int:
        """Return the row of frame k of the frame k+B in a row."""
        return row - (self._document.joints - self._document.links)

    def _loop_rows(self) -> list[tuple[int, int]]:
        """Return (row of frame k, row of frame k+B) of each loop."""
        return [(self._cut_row(row), row) for row in range(self._document.joints + 1, self._document.frames + 1)]

    def _check_loop_ends(self) -> None:
        """Raise DescriptionError where both frames of a loop are on the same link."""
        for moved, closed_on in self._loop_rows():
            if self._poses[moved][0] == self._poses[closed_on][0]:
                self._document.fail(
                    self._entry("ant", closed_on).line,
                    f"rows {moved} and {closed_on}, which must coincide, are on the same link, so that they close "
                    "nothing",
                )

    def _entry(self, key: str, row: int) -> Entry:
        """Return the entry of a row in a list of the document that begins with row 1."""
        return self._document.lists[key][row - 1]

    def _choice(self, key: str, row: int, choices: Container[int], requirement: str) -> int:
        """Return a whole number of a row, one of the choices."""
        return self._evaluator.choice(self._entry(key, row), f"{key} of row {row}", choices, requirement)

    def _mdh(self, row: int, sigma: int) -> MDHParameters:
        """Return the parameters of a row at zero joint position, and note its joint variable."""
        entries = {key: self._entry(key, row) for key in MDHParameters._fields}
        variable_key = {0: "theta", 1: "r"}.get(sigma)
        numbers = {key: self._evaluator.number(entry) for key, entry in entries.items() if key != variable_key}
        if variable_key is not None:
            entry = entries[variable_key]
            variable, constant = self._evaluator.split_joint_variable(entry, f"{variable_key} of row {row}")
            numbers[variable_key] = constant
            if variable in self._variable_rows:
                self._document.fail(
                    entry.line,
                    f"{variable} is the joint variable of row {self._variable_rows[variable]} and of row {row}: each "
                    "joint needs its own variable, dependent joints are not supported",
                )
            if variable is not None:
                self._variable_rows[variable] = row
        return MDHParameters(**numbers)

    def _link_entry(self, key: str, row: int) -> Entry | None:
        """Return the entry of a row in a list of links, which begins with link 0 where the base floats.

        None where the list does not exist, and for cut joints and a fixed base.
        """
        if row > self._document.links:
            return None
        number = row - 1 + self._document.is_floating
        return self._evaluator.entry(key, number) if number >= 0 else None

    def _not_negative(self, entry: Entry | None, quantity: str) -> float:
        """Return the value of an entry, which must not be negative; zero where it does not exist."""
        number = self._evaluator.number(entry)
        if entry is not None and number < 0:
            self._document.fail(entry.line, f"{quantity} is {number:g}: zero or more is needed")
        return number

    def _inertia(self, row: int) -> Inertia:
        """Return the inertia of the link of a row."""
        second = [self._evaluator.number(self._link_entry(key.upper(), row)) for key in INERTIA_ENTRIES]
        first = [self._evaluator.number(self._link_entry(key, row)) for key in ("MX", "MY", "MZ")]
        mass = self._not_negative(self._link_entry("M", row), f"mass M of link {row}")
        return Inertia(mass, first, symmetric_matrix(*second))

    def _drive(self, row: int) -> _Drive:
        """Return the drive of the joint of a row; an elastic joint is unactuated with a spring."""
        numbers = [self._not_negative(self._link_entry(key, row), f"{key} of row {row}") for key in DRIVE]
        mu = self._choice("mu", row, (0, 1), "0 or 1, whether a motor drives it,") if self._has("mu") else 1
        if mu and row > self._document.links:
            self._document.fail(
                self._entry("mu", row).line,
                f"mu of row {row} is 1, but a loop is cut there (NL = {self._document.links}), where no motor can be: "
                "0 is needed, or cut the loop at an unactuated joint",
            )
        eta = self._choice("eta", row, (0, 1), "0 (rigid) or 1 (elastic)") if self._has("eta") else 0
        spring = None
        if eta:
            if not self._has("k"):
                self._document.fail(self._entry("eta", row).line, f"row {row} is elastic, but the list k is missing")
            spring = Spring(self._not_negative(self._entry("k", row), f"k of row {row}"))
        rotor_inertia, viscous_friction, coulomb_friction = numbers
        return _Drive(rotor_inertia, viscous_friction, coulomb_friction, bool(mu and not eta), spring)

    def _has(self, key: str) -> bool:
        """Return whether the document has a list."""
        return key in self._document.lists

    def _gravity(self) -> ArrayLike:
        """Return G (3,), or the Earth's gravity."""
        return tuple(map(self._evaluator.number, self._document.lists["G"])) if self._has("G") else EARTH_GRAVITY

    def _refuse_missing_values(self) -> None:
        """Raise DescriptionError where a name without value is needed."""
        missing = self._evaluator.missing
        for name, line in missing.items():
            if name in self._variable_rows:
                row = self._variable_rows[name]
                self._document.fail(line, f"{name} is the joint variable of row {row}: it cannot occur elsewhere")
        if missing:
            names = sorted(missing, key=lambda name: missing[name] or 0)
            first = names[0]
            more = f" and {len(missing) - 500} more" if len(missing) > 500 else ""
            self._document.fail(
                missing[first],
                f"no value for {', '.join(names[:500])}{more}: write a number in its place, or give values (to the "
                f"command robot-dynamics: --set {first}=0.5 or --values FILE, with one line {first}: 0.5 for each)",
            )

    def _warn_of_ignored_data(self) -> None:
        """Log data of the document that is not part of the robot."""
        lists = self._document.lists
        entries: dict[str, list[Entry | None]] = {key: [*lists.get(key, [])] for key in STATE}
        fixed_rows = [row for row in self._fixed_rows() if row <= self._document.links]
        entries.update({key: [self._link_entry(key, row) for row in fixed_rows] for key in DRIVE if self._has(key)})
        ignored = [key for key, row_entries in entries.items() if any(map(self._is_nonzero, row_entries))]
        source = self._document.source
        if ignored:
            logger.warning("%s: %s are not part of the robot and are ignored", source, ", ".join(ignored))
        pose = [
            None if self._evaluator.unbound_names(entry) else self._evaluator.evaluate_entry(entry)
            for entry in lists.get("Z", [])
        ]
        if pose and pose != np.eye(4).ravel().tolist():
            logger.warning("%s: Z is ignored: positions and G are expressed in frame 0", source)

    def _is_nonzero(self, entry: Entry | None) -> bool:
        """Return whether an entry has a value other than zero."""
        if entry is None or self._evaluator.unbound_names(entry):
            return False
        return self._evaluator.evaluate_entry(entry) != 0

    def _robot(self, moving_base: bool, gravity: ArrayLike) -> Robot:
        """Return the Robot of all rows."""
        rows = [joint_row.row for joint_row in self._joint_rows]
        links = self._names("Links", ["link_0", *(f"link_{row}" for row in rows)], "links, the base first")
        names = self._names("Joints", [f"joint_{row}" for row in rows], "joints")
        self._actuate_tree_without_motors()
        frames = tuple(self._frames(links))
        try:
            return Robot(
                name=self._document.robot_name,
                links=tuple(map(Link, links, self._inertias)),
                joints=tuple(row.joint(name) for row, name in zip(self._joint_rows, names, strict=True)),
                frames=frames,
                moving_base=moving_base,
                gravity=to_gravity_vector(gravity),
                loops=self._loops(names),
            )
        except DescriptionError as error:
            self._document.fail(None, str(error))

    def _actuate_tree_without_motors(self) -> None:
        """Actuate all rigid joints of a tree in which mu is 0 everywhere: the table leaves the motors out."""
        drives = [joint_row.drive for joint_row in self._joint_rows]
        is_tree = self._document.joints == self._document.links
        has_rigid_joint = any(drive.spring is None for drive in drives)
        if is_tree and has_rigid_joint and not any(drive.actuated for drive in drives):
            logger.warning("%s: mu is 0 throughout: all rigid joints count as actuated", self._document.source)
            self._joint_rows = [
                replace(row, drive=replace(row.drive, actuated=row.drive.spring is None)) for row in self._joint_rows
            ]

    def _loops(self, joint_names: Iterable[str]) -> tuple[Loop, ...]:
        """Return the loops, which have the names of their cut joints or of a comment."""
        joints = {joint_row.row: name for joint_row, name in zip(self._joint_rows, joint_names, strict=True)}
        cut_rows = range(self._document.links + 1, self._document.joints + 1)
        names = self._names("Loops", [joints.get(row, f"loop_{row}") for row in cut_rows], "loops")
        return tuple(
            Loop(name, LoopEnd(*self._poses[moved]), LoopEnd(*self._poses[closed_on]))
            for name, (moved, closed_on) in zip(names, self._loop_rows(), strict=True)
        )

    def _fixed_rows(self) -> list[int]:
        """Return the rows without a joint."""
        return sorted(set(range(1, len(self._poses))) - {joint_row.row for joint_row in self._joint_rows})

    def _names(self, kind: str, defaults: list[str], description: str) -> list[str]:
        """Return the names in the comment of a kind, else the defaults; description: of the named parts."""
        comment = self._document.names.get(kind)
        if comment is None:
            return defaults
        if len(comment.names) != len(defaults):
            count = len(comment.names)
            self._document.fail(
                comment.line, f"the comment {kind} = has {count} names: there are {len(defaults)} {description}"
            )
        return [name for name, _ in comment.names]

    def _frames(self, links: list[str]) -> list[Frame]:
        """Return the frames: those in the comment Frames, else the fixed rows, and each other link at its own row."""
        comment = self._document.names.get("Frames")
        named = [(f"frame_{row}", row) for row in self._fixed_rows()] if comment is None else _rows_of_names(comment)
        numbers = {name: number for number, name in enumerate(links)}
        line = None if comment is None else comment.line
        for name, row in named:
            if row >= len(self._poses):
                self._document.fail(line, f"frame {name!r} is at row {row}: there are rows 0 to {len(self._poses) - 1}")
            if self._poses[row][0] != numbers.get(name, self._poses[row][0]):
                self._document.fail(
                    line, f"frame {name!r} is at row {row}, which is not fixed to the link of that name"
                )
        elsewhere = {name for name, _ in named}
        own = [Frame(name, link, np.eye(4)) for link, name in enumerate(links) if name not in elsewhere]
        return [*own, *(Frame(name, *self._poses[row]) for name, row in named)]


def _rows_of_names(comment: NameComment) -> list[tuple[str, int]]:
    """Return the names of a comment that have a row, with their rows."""
    return [(name, row) for name, row in comment.names if row is not None]
