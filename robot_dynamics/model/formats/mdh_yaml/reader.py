"""Robot from a YAML text: a table of modified Denavit-Hartenberg parameters, or a URDF and what it cannot say; the
format is mdh.schema.json.
"""

import json
from functools import cache
from pathlib import Path

import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.mdh_yaml.beams import FlexibilityReader
from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, make_validator
from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
from robot_dynamics.model.formats.mdh_yaml.joints import (
    describe_unknown_link,
    find_role_conflict,
    read_joint,
    read_spring,
)
from robot_dynamics.model.formats.mdh_yaml.legs import expand_legs
from robot_dynamics.model.formats.mdh_yaml.loops import list_loops, read_loops
from robot_dynamics.model.formats.mdh_yaml.platforms import list_platforms, read_coordinate_joints, read_platforms
from robot_dynamics.model.formats.mdh_yaml.supplemented_urdf import read_supplemented_urdf
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Mimic
from robot_dynamics.model.placement import placement
from robot_dynamics.model.platform import PLATFORM_FRAME
from robot_dynamics.model.robot import EARTH_GRAVITY, Frame, Link, Robot

HINTS = {
    "a": "in modified parameters the distance along x is d, that along z is r (Craig's a and d)",
    "dh": "classical Denavit-Hartenberg parameters are others than these: mdh, with gamma, b, alpha, d, theta, r",
    "name": "a robot is told as `robot: name`, a joint as `joint: name`, a link as `link: name`, a frame `frame: name`",
    "parent": "the link that a row hangs on is its antecedent",
    "com": "centre_of_mass, or first_moments (mass times centre)",
    "center_of_mass": "centre_of_mass, or first_moments (mass times centre)",
    "joints": "a robot has its joints here or in its urdf, which roles, springs and loops are told beside",
    "mimic": "where a loop is cut no joint follows another: cut the loop at another joint",
}
SCHEMA = Path(__file__).with_name("mdh.schema.json")
INERTIA_KEYS = ("mass", "first_moments", "inertia", "centre_of_mass", "central_inertia")
JOINT_KEYS = (
    *("joint", "rotor_inertia", "viscous_friction", "coulomb_friction", "role", "spring", "mimic", "limits"),
    *("initial_position", "brake"),
)


def read_mdh_yaml(text, *, source="MDH table", values=None, moving_base=None, gravity=None):
    """Read a robot from the YAML text (str or bytes) of its MDH table, or of a document that has its URDF.

    source: what to call the description in errors; the Path of the file that it comes from, in whose folder the URDF
    is looked for. values: {name: number or expression} in the place of entries of `parameters`. moving_base, gravity
    (3,) [m/s²]: None: as the description says, else a fixed base and the Earth's.

    Raises DescriptionError, which tells line and column, what is wrong and what would be right.
    """
    document = YamlDocument(text, source, "an MDH table in YAML")
    if not isinstance(document.data, dict):
        document.fail((), "a mapping with the keys robot and joints is needed")
    document.validate(_validator(), HINTS)
    if "urdf" in document.data:
        return read_supplemented_urdf(document, values or {}, moving_base, gravity)
    return _Builder(document, values or {}).build(moving_base, gravity)


@cache
def _validator():
    return make_validator(json.loads(SCHEMA.read_text(encoding="utf-8")))


class _Builder:
    """Walks the rows of a validated document in their order and gathers links, joints and frames."""

    def __init__(self, document, values):
        self.document, self.data = document, document.data
        self.evaluator = YamlEvaluator(document, values)

    def build(self, moving_base, gravity):
        base = self.data.get("base", {})
        self.links = [base.get("link", "base_link")]
        self.inertias, self.joints = [self._inertia(base, ("base",))], []
        self.placed = {self.links[0]: (0, np.eye(4))}  # link number and placement in its frame, of all frames by name
        self.told_frames, self.nameless, self.followers = set(), set(), []
        self.flexibilities = FlexibilityReader()
        self.own_frames = {}  # frames of links in which what is on them is told, where they are not those of rows
        self.waiting = [(told, path) for told, path in list_platforms(self.document) if "coordinates" not in told]
        self._hang_platforms()
        self.here = self.placed[self.links[0]]  # what a row hangs on that does not tell
        for number, row in enumerate(self.data.get("joints", [])):
            self._row(row, ("joints", number))
        self._refuse_waiting(*(told["link"] for told, _ in self.waiting))
        loops = self._loops([*self._legs(), *list_loops(self.evaluator)])
        bends = bool(self.flexibilities)
        platforms = read_platforms(self.document, self.joints, self.links, self.inertias, bends)
        for number, frame in enumerate(self.data.get("frames", [])):
            self._frame(frame, ("frames", number))
        self._check_leaders()
        if moving_base is None:
            moving_base = base.get("moving", False)
        if gravity is None:
            gravity = self.evaluator.vector(self.data, "gravity", ()) if "gravity" in self.data else EARTH_GRAVITY
        try:
            return Robot(
                name=self.data["robot"],
                links=self._built_links(),
                joints=tuple(self.joints),
                frames=tuple(Frame(name, *place) for name, place in self.placed.items() if name not in self.nameless),
                moving_base=moving_base,
                gravity=gravity,
                loops=loops,
                platforms=platforms,
            )
        except DescriptionError as error:
            self.document.fail((), str(error))

    def _hang_platforms(self):
        """Hangs those of the waiting platforms, described as bodies, of which the base is there by now."""
        waiting, self.waiting = self.waiting, []
        for told, path in waiting:
            if told.get("base", self.links[0]) in self.placed:
                self._hang_platform(told, path)
            else:
                self.waiting.append((told, path))
        if 0 < len(self.waiting) < len(waiting):
            self._hang_platforms()

    def _refuse_waiting(self, *links):
        """Tell of the waiting platforms with these links that what they stand on is not there."""
        for told, path in self.waiting:
            if told["link"] in links:
                known = [name for name in self.placed if name != told["link"]]
                self.document.fail((*path, "base"), f"{self._unknown_link(told['base'], known)}, links and fixed rows")

    def _hang_platform(self, told, path):
        """The joints and links of a platform that is described as a body."""
        base = self.placed[told.get("base", self.links[0])]
        for joint in read_coordinate_joints(self.evaluator, told, path, len(self.joints) + 1, base):
            if joint.name in {other.name for other in self.joints}:
                self.document.fail((*path, "link"), f"joint {joint.name!r} is there already: names must differ")
            self._refuse_taken(joint.name, (*path, "link"))
            self.joints.append(joint)
            self.links.append(joint.name)
            self.inertias.append(Inertia())
            self.placed[joint.name] = (len(self.joints), np.eye(4))
        name = told["link"]
        self.placed.pop(self.links[-1])
        self._refuse_taken(name, (*path, "link"))
        self.links[-1] = name
        self.inertias[-1] = self._inertia(told, path).transformed_by(PLATFORM_FRAME)
        self.placed[name], self.own_frames[name] = (len(self.joints), PLATFORM_FRAME), PLATFORM_FRAME
        self.told_frames.add(name)

    def _legs(self):
        """Adds the rows of all legs; the ToldLoops by which they are closed."""
        whole, loops = self.evaluator, []
        for leg in expand_legs(whole):
            told, path = leg.base
            self.evaluator = leg.evaluator
            link, frame = self._antecedent({"antecedent": self.links[0], **told}, path)
            self.here = link, frame @ self.evaluator.read_placement(told, path)
            for row, path in leg.rows:
                self._row(row, path)
            loops += leg.loops
        self.evaluator = whole
        return loops

    def _built_links(self):
        """The Links, of those that bend with the inertia of their beams."""
        bends = [self.flexibilities.flexibility_of(number) for number in range(len(self.links))]
        inertias = [part if bend is None else bend.inertia for bend, part in zip(bends, self.inertias, strict=True)]
        return tuple(map(Link, self.links, inertias, bends))

    def _loops(self, told):
        cuts = read_loops(self.document, told, self.joints, self.links, self.placed)
        for joint, link in zip(cuts.joints, cuts.links, strict=True):
            self.joints.append(joint)
            self.links.append(link)
            self.inertias.append(Inertia())
            self.placed[link] = (len(self.joints), np.eye(4))
        return cuts.loops

    def _row(self, row, path):
        self._add_row(row, path)
        if self.waiting:
            self._hang_platforms()

    def _add_row(self, row, path):
        name = row["link"]
        self._refuse_taken(name, (*path, "link"))
        link, frame = self._antecedent(row, path)
        frame = frame @ self.evaluator.mdh(row, path)
        inertia = self._inertia(row, path)
        moves = row.get("type") != "fixed"
        number, seen = (len(self.joints) + 1, np.eye(4)) if moves else (link, frame)
        self.flexibilities.add(self.evaluator, number, row, path, seen, inertia)
        if not moves:
            for key in JOINT_KEYS:
                if key in row:
                    self.document.fail((*path, key), f"a fixed row moves nothing: leave out {key}, or the type")
            self.inertias[link] += inertia.transformed_by(frame)
            self.here = self.placed[name] = (link, frame)
            if row.get("named") is False:
                self.nameless.add(name)
            return
        if "named" in row:
            self.document.fail((*path, "named"), "a link that a joint moves is always known: leave out named")
        if "joint" not in row:
            self.document.fail(path, "joint missing: the name of the joint, or type: fixed")
        self.joints.append(self._joint(row, link, frame, path))
        self.links.append(name)
        self.inertias.append(inertia)
        self.here = self.placed[name] = (len(self.joints), np.eye(4))

    def _refuse_taken(self, name, path):
        if name in self.placed:
            self.document.fail(path, f"link or frame {name!r} is there already: names must differ")

    def _antecedent(self, row, path):
        """Link number and placement of the frame that a row is placed in; left out, that of the row before."""
        if "antecedent" not in row:
            return self.here
        name = row["antecedent"]
        if name not in self.placed:
            self._refuse_waiting(name)
            hint = self._unknown_link(name, self.placed)
            self.document.fail((*path, "antecedent"), f"{hint}. A row comes after the one it hangs on")
        return self.placed[name]

    def _unknown_link(self, name, known):
        return describe_unknown_link(name, known, self.joints, self.links)

    def _joint(self, row, antecedent, placed, path):
        if row["joint"] in {joint.name for joint in self.joints}:
            self.document.fail((*path, "joint"), f"joint {row['joint']!r} is there already: names must differ")
        spring = read_spring(self.evaluator, row["spring"], (*path, "spring")) if "spring" in row else None
        if objection := find_role_conflict(row.get("role"), spring, "mimic" in row):
            self.document.fail((*path, objection[0]), objection[1])
        return read_joint(
            self.evaluator,
            row,
            path,
            len(self.joints) + 1,
            antecedent=antecedent,
            prismatic=row.get("type") == "prismatic",
            placement=placed,
            mimic=self._mimic(row, path),
            actuated=row.get("role") in (None, "actuated"),
            spring=spring,
        )

    def _mimic(self, row, path):
        if "mimic" not in row:
            return None
        told, path = row["mimic"], (*path, "mimic")
        self.followers.append((told["joint"], path))
        return Mimic(
            told["joint"],
            self.evaluator.number(told, "multiplier", path, 1.0),
            self.evaluator.number(told, "offset", path),
        )

    def _check_leaders(self):
        names = [joint.name for joint in self.joints]
        for leader, path in self.followers:
            if leader not in names:
                self.document.fail((*path, "joint"), describe_unknown_name("joint", leader, names))

    def _frame(self, frame, path):
        """A named frame on a link; one of the link's own name says where wrenches and payloads on it are meant."""
        name, link = frame["frame"], frame["link"]
        if link not in self.links:
            self.document.fail((*path, "link"), self._unknown_link(link, self.links))
        number = self.links.index(link)
        if name == self.links[0]:
            self.document.fail((*path, "frame"), f"{name!r} is the base, whose frame is frame 0: take another name")
        if name in self.placed and not (name == link and name not in self.told_frames):
            self.document.fail((*path, "frame"), f"link or frame {name!r} is there already: names must differ")
        self.told_frames.add(name)
        self.placed[name] = (number, self.own_frames.get(link, np.eye(4)) @ self.evaluator.pose(frame, path))

    def _inertia(self, body, path):
        """The Inertia about the frame's origin of a mapping that may have the keys of BODY."""
        about_centre = {"centre_of_mass", "central_inertia"} & body.keys()
        about_origin = {"first_moments", "inertia"} & body.keys()
        if about_centre and about_origin:
            self.document.fail(
                path,
                f"{about_centre.pop()} and {about_origin.pop()} say the same twice: give first_moments and inertia "
                "about the origin of the frame, or centre_of_mass and central_inertia",
            )
        if about_centre and "mass" not in body:
            self.document.fail(path, f"mass missing: {about_centre.pop()} has no meaning without")
        mass = self.evaluator.number(body, "mass", path)
        if mass < 0:
            self.document.fail((*path, "mass"), f"mass {mass:g} kg is negative")
        if not about_centre:
            return Inertia(
                mass, self.evaluator.vector(body, "first_moments", path), self.evaluator.matrix(body, "inertia", path)
            )
        centre = placement(translation=self.evaluator.vector(body, "centre_of_mass", path))
        return Inertia.about_centre_of_mass(mass, self.evaluator.matrix(body, "central_inertia", path), centre)
