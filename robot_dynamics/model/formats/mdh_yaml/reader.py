"""Robot from a YAML text: a table of modified Denavit-Hartenberg parameters, or a URDF with supplements.

mdh.schema.json defines the format.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import jsonschema
import numpy as np

from robot_dynamics.errors import DescriptionError, describe_unknown_name
from robot_dynamics.model.formats.mdh_yaml.beams import FlexibilityReader
from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, YamlPart, make_validator
from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
from robot_dynamics.model.formats.mdh_yaml.inertias import read_inertia
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
from robot_dynamics.model.joint_friction import FRICTION_FIELDS
from robot_dynamics.model.platform import PLATFORM_FRAME
from robot_dynamics.model.robot import EARTH_GRAVITY, MAX_JOINTS, Frame, Link, Robot, SharedLoadError, to_gravity_vector

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike, ScalarArray
    from robot_dynamics.model.formats.mdh_yaml.document import YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.loops import LoopDescription
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.loop import Loop

HINTS = {
    "a": "in modified parameters the distance along x is d, that along z is r (Craig's a and d)",
    "dh": "classical Denavit-Hartenberg parameters differ from these: mdh, with gamma, b, alpha, d, theta, r",
    "name": "names are entries of their own kind: `robot: name`, `joint: name`, `link: name`, `frame: name`",
    "parent": "the link that carries a row is its antecedent",
    "com": "centre_of_mass, or first_moments (mass times centre)",
    "center_of_mass": "centre_of_mass, or first_moments (mass times centre)",
    "joints": "a robot has its joints here or in its urdf, with roles, springs and loops beside it",
    "mimic": "a cut joint mimics no other joint: cut the loop at another joint",
}
SCHEMA = Path(__file__).with_name("mdh.schema.json")
JOINT_KEYS = (
    "joint",
    "rotor_inertia",
    *FRICTION_FIELDS,
    "role",
    "spring",
    "mimic",
    "limits",
    "initial_position",
    "brake",
)


def read_mdh_yaml(
    text: str | bytes,
    *,
    source: str | Path = "MDH table",
    values: Mapping[str, float | str] | None = None,
    moving_base: bool | None = None,
    gravity: ArrayLike | None = None,
) -> Robot:
    """Read a robot from the YAML text of its MDH table, or of a document that supplements its URDF.

    Parameters
    ----------
    text : str or bytes
        The YAML, or the bytes of its file.
    source : str or Path
        Name of the description in error messages; the Path of its file, if it has one: the folder in which a URDF is
        searched.
    values : mapping of str to float or str, optional
        Numbers or expressions in place of entries of `parameters`.
    moving_base : bool, optional
        Whether the base can move freely. Default: from the description, else False.
    gravity : (3,) array_like, optional
        Acceleration of gravity in the world frame [m/s²]. Default: from the description, else the Earth's, along -z.

    Returns
    -------
    Robot
        The robot.

    Raises
    ------
    DescriptionError
        If the text cannot be read. The message has the line and column, the error and the remedy.

    Notes
    -----
    mdh.schema.json defines the format. The parameters are those of Khalil, section 2.
    """
    document = YamlDocument(text, source, "an MDH table in YAML")
    if not isinstance(document.data, dict):
        document.fail((), "a mapping with the keys robot and joints is needed")
    document.validate(_validator(), HINTS)
    if "urdf" in document.data:
        return read_supplemented_urdf(document, values or {}, moving_base, gravity)
    return _Builder(document, values or {}).build(moving_base, gravity)


@cache
def _validator() -> jsonschema.Draft7Validator:
    """Return the validator of SCHEMA, which is read at the first use."""
    return make_validator(json.loads(SCHEMA.read_text(encoding="utf-8")))


class _Builder:
    """Reads the rows of a validated document in their order and collects links, joints and frames."""

    def __init__(self, document: YamlDocument, values: Mapping[str, float | str]) -> None:
        self._document = document
        self._data: YamlMapping = document.data
        self._evaluator = YamlEvaluator(document, values)
        base = self._data.get("base", {})
        self._links: list[str] = [base.get("link", "base_link")]
        self._inertias: list[Inertia] = [read_inertia(self._evaluator, base, ("base",))]
        self._joints: list[Joint] = []
        # all frames by name: number of the link, and placement (4, 4) in its frame
        self._poses: dict[str, tuple[int, ScalarArray]] = {self._links[0]: (0, np.eye(4))}
        self._default_antecedent = self._poses[self._links[0]]  # of a row without antecedent
        self._explicit_frames: set[str] = set()
        self._unnamed_frames: set[str] = set()
        self._mimic_joints: list[tuple[str, YamlPath]] = []  # names of the joints that others follow
        self._load_friction_paths: dict[str, YamlPath] = {}  # by the name of the joint
        self._flexibilities = FlexibilityReader()
        # placements of the frames in which frames on a link are given, where these are not the frames of rows
        self._description_frames: dict[str, ScalarArray] = {}
        # platforms described as bodies, whose base does not exist yet
        self._pending_platforms = [part for part in list_platforms(document) if "coordinates" not in part.mapping]

    def build(self, moving_base: bool | None, gravity: ArrayLike | None) -> Robot:
        """Return the Robot; None: moving_base and gravity from the document."""
        self._add_pending_platforms()
        for number, row in enumerate(self._data.get("joints", [])):
            self._read_row(YamlPart(row, ("joints", number)))
        self._refuse_pending_platforms(*(part.mapping["link"] for part in self._pending_platforms))
        loops = self._read_loops([*self._read_legs(), *list_loops(self._evaluator)])
        has_beams = bool(self._flexibilities)
        platforms = read_platforms(self._document, self._joints, self._links, self._inertias, has_beams)
        for number, frame in enumerate(self._data.get("frames", [])):
            self._read_frame(frame, ("frames", number))
        self._check_mimic_joints()
        if moving_base is None:
            moving_base = self._data.get("base", {}).get("moving", False)
        if gravity is None and "gravity" in self._data:
            gravity = self._evaluator.vector(self._data, "gravity", ())
        try:
            return Robot(
                name=self._data["robot"],
                links=self._robot_links(),
                joints=tuple(self._joints),
                frames=self._robot_frames(),
                moving_base=moving_base,
                gravity=to_gravity_vector(EARTH_GRAVITY if gravity is None else gravity),
                loops=loops,
                platforms=platforms,
            )
        except SharedLoadError as error:
            self._document.fail(self._load_friction_paths[error.joint], str(error))
        except DescriptionError as error:
            self._document.fail((), str(error))

    def _robot_links(self) -> tuple[Link, ...]:
        """Return the links; the inertia of a flexible one includes its beams."""
        links = []
        for number, (name, inertia) in enumerate(zip(self._links, self._inertias, strict=True)):
            flexibility = self._flexibilities.flexibility_of(number)
            links.append(Link(name, inertia if flexibility is None else flexibility.inertia, flexibility))
        return tuple(links)

    def _robot_frames(self) -> tuple[Frame, ...]:
        """Return the named frames."""
        names = [name for name in self._poses if name not in self._unnamed_frames]
        return tuple(Frame(name, *self._poses[name]) for name in names)

    def _add_pending_platforms(self) -> None:
        """Add the pending platforms whose base exists by now, and those that stand on them."""
        pending = self._pending_platforms
        self._pending_platforms = []
        for part in pending:
            if part.mapping.get("base", self._links[0]) in self._poses:
                self._add_platform(part.mapping, part.path)
            else:
                self._pending_platforms.append(part)
        if 0 < len(self._pending_platforms) < len(pending):
            self._add_pending_platforms()

    def _refuse_pending_platforms(self, *links: str) -> None:
        """Raise DescriptionError for a pending platform with one of these links: its base does not exist."""
        for mapping, path in self._pending_platforms:
            if mapping["link"] in links:
                known = [name for name in self._poses if name != mapping["link"]]
                hint = describe_unknown_link(mapping["base"], known, self._joints, self._links)
                self._document.fail((*path, "base"), f"{hint}, links and fixed rows")

    def _add_platform(self, mapping: YamlMapping, path: YamlPath) -> None:
        """Add the joints and links of a platform that is described as a body."""
        link_path = (*path, "link")
        base = self._poses[mapping.get("base", self._links[0])]
        for joint in read_coordinate_joints(self._evaluator, mapping, path, len(self._joints) + 1, base):
            self._refuse_joint(joint.name, link_path)
            self._refuse_name(joint.name, link_path)
            self._add_joint(joint, joint.name, Inertia())
        name = mapping["link"]
        del self._poses[self._links[-1]]  # the last link is the platform itself
        self._refuse_name(name, link_path)
        self._links[-1] = name
        self._inertias[-1] = read_inertia(self._evaluator, mapping, path).transformed_by(PLATFORM_FRAME)
        self._poses[name] = (len(self._joints), PLATFORM_FRAME)
        self._description_frames[name] = PLATFORM_FRAME
        self._explicit_frames.add(name)

    def _add_joint(self, joint: Joint, link: str, inertia: Inertia) -> None:
        """Add a joint and the link that it moves."""
        if len(self._joints) >= MAX_JOINTS:
            self._document.fail((), f"more than {MAX_JOINTS} moving joints are too many")
        self._joints.append(joint)
        self._links.append(link)
        self._inertias.append(inertia)
        self._poses[link] = (len(self._joints), np.eye(4))

    def _read_legs(self) -> list[LoopDescription]:
        """Add the rows of all legs, and return the loops that close them."""
        evaluator = self._evaluator
        loops = []
        for leg in expand_legs(evaluator):
            self._evaluator = leg.evaluator
            base = {"antecedent": self._links[0], **leg.base.mapping}
            link, frame = self._antecedent(base, leg.base.path)
            self._default_antecedent = (link, frame @ leg.evaluator.read_placement(*leg.base))
            for row in leg.rows:
                self._read_row(row)
            loops += leg.loops
        self._evaluator = evaluator
        return loops

    def _read_loops(self, loops: list[LoopDescription]) -> tuple[Loop, ...]:
        """Return the loops, and add their cut joints."""
        cuts = read_loops(self._document, loops, self._joints, self._links, self._poses)
        for joint, link in zip(cuts.joints, cuts.links, strict=True):
            self._add_joint(joint, link, Inertia())
        return cuts.loops

    def _read_row(self, row: YamlPart) -> None:
        """Add a row, and the pending platforms that stand on it."""
        if row.mapping.get("type") == "fixed":
            self._add_fixed_row(row.mapping, row.path)
        else:
            self._add_moving_row(row.mapping, row.path)
        if self._pending_platforms:
            self._add_pending_platforms()

    def _row_frame(self, row: YamlMapping, path: YamlPath) -> tuple[int, ScalarArray]:
        """Return the frame of a row: number of the link in which it is placed, and placement (4, 4) there."""
        self._refuse_name(row["link"], (*path, "link"))
        link, frame = self._antecedent(row, path)
        return link, frame @ self._evaluator.mdh(row, path)

    def _add_fixed_row(self, row: YamlMapping, path: YamlPath) -> None:
        """Add a fixed frame, and lump its inertia into its link."""
        name = row["link"]
        link, frame = self._row_frame(row, path)
        inertia = read_inertia(self._evaluator, row, path)
        self._flexibilities.add(self._evaluator, link, row, path, frame, inertia)
        for key in JOINT_KEYS:
            if key in row:
                self._document.fail((*path, key), f"a fixed row has no joint: omit {key}, or the type")
        self._inertias[link] += inertia.transformed_by(frame)
        self._poses[name] = (link, frame)
        self._default_antecedent = self._poses[name]
        if row.get("named") is False:
            self._unnamed_frames.add(name)

    def _add_moving_row(self, row: YamlMapping, path: YamlPath) -> None:
        """Add a joint and its link."""
        name = row["link"]
        antecedent, frame = self._row_frame(row, path)
        inertia = read_inertia(self._evaluator, row, path)
        self._flexibilities.add(self._evaluator, len(self._joints) + 1, row, path, np.eye(4), inertia)
        if "named" in row:
            self._document.fail((*path, "named"), "a link with a joint always has a named frame: omit named")
        if "joint" not in row:
            self._document.fail(path, "joint missing: the name of the joint, or type: fixed")
        self._add_joint(self._read_joint(row, antecedent, frame, path), name, inertia)
        self._default_antecedent = self._poses[name]

    def _refuse_name(self, name: str, path: YamlPath) -> None:
        """Raise DescriptionError where a link or frame has this name."""
        if name in self._poses:
            self._document.fail(path, f"link or frame {name!r} is already defined: names must be unique")

    def _refuse_joint(self, name: str, path: YamlPath) -> None:
        """Raise DescriptionError where a joint has this name."""
        if any(joint.name == name for joint in self._joints):
            self._document.fail(path, f"joint {name!r} is already defined: names must be unique")

    def _antecedent(self, row: YamlMapping, path: YamlPath) -> tuple[int, ScalarArray]:
        """Return the frame in which a row is placed, by default that of the row before: link number and placement."""
        if "antecedent" not in row:
            return self._default_antecedent
        name = row["antecedent"]
        if name not in self._poses:
            self._refuse_pending_platforms(name)
            hint = describe_unknown_link(name, self._poses, self._joints, self._links)
            self._document.fail((*path, "antecedent"), f"{hint}. A row comes after its antecedent")
        return self._poses[name]

    def _read_joint(self, row: YamlMapping, antecedent: int, frame: ScalarArray, path: YamlPath) -> Joint:
        """Return the joint of a row."""
        self._refuse_joint(row["joint"], (*path, "joint"))
        spring = read_spring(self._evaluator, row["spring"], (*path, "spring")) if "spring" in row else None
        if conflict := find_role_conflict(row.get("role"), spring, "mimic" in row):
            self._document.fail((*path, conflict.key), conflict.message)
        joint = read_joint(
            self._evaluator,
            row,
            path,
            len(self._joints) + 1,
            antecedent=antecedent,
            prismatic=row.get("type") == "prismatic",
            placement=frame,
            mimic=self._read_mimic(row["mimic"], (*path, "mimic")) if "mimic" in row else None,
            actuated=row.get("role") in (None, "actuated"),
            spring=spring,
        )
        self._load_friction_paths[joint.name] = (*path, "load_friction")
        return joint

    def _read_mimic(self, mapping: YamlMapping, path: YamlPath) -> Mimic:
        """Return the mimic relation in the mapping at a path."""
        self._mimic_joints.append((mapping["joint"], path))
        multiplier = self._evaluator.number(mapping, "multiplier", path, 1.0)
        offset = self._evaluator.number(mapping, "offset", path)
        return Mimic(mapping["joint"], multiplier, offset)

    def _check_mimic_joints(self) -> None:
        """Raise DescriptionError where a joint follows an unknown joint."""
        names = [joint.name for joint in self._joints]
        for name, path in self._mimic_joints:
            if name not in names:
                self._document.fail((*path, "joint"), describe_unknown_name("joint", name, names))

    def _read_frame(self, frame: YamlMapping, path: YamlPath) -> None:
        """Add a named frame on a link. A frame with the name of its link is that of wrenches and payloads on it."""
        name, link = frame["frame"], frame["link"]
        if link not in self._links:
            hint = describe_unknown_link(link, self._links, self._joints, self._links)
            self._document.fail((*path, "link"), hint)
        if name == self._links[0]:
            self._document.fail((*path, "frame"), f"{name!r} is the base, whose frame is frame 0: choose another name")
        if not (name == link and name not in self._explicit_frames):
            self._refuse_name(name, (*path, "frame"))
        self._explicit_frames.add(name)
        pose = self._description_frames.get(link, np.eye(4)) @ self._evaluator.pose(frame, path)
        self._poses[name] = (self._links.index(link), pose)
