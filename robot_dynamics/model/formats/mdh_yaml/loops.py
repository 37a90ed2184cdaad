"""Loops of a YAML description: the joint at which each loop is cut, and the two frames that coincide there.

    loops:
      - joint: knee
        moved: {antecedent: rod, mdh: {d: l}}           # frame k: these parameters, then the joint variable
        closed_on: {antecedent: crank, xyz: [r, 0, 0]}  # frame k+B, fixed

A revolute or prismatic cut joint becomes a joint of the tree, with a link without inertia (Khalil, section 2.2).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.mdh_yaml.document import YamlPart
from robot_dynamics.model.formats.mdh_yaml.joints import (
    CUT_JOINT_FRICTION_KEYS,
    describe_unknown_link,
    find_role_conflict,
    read_joint,
    read_spring,
)
from robot_dynamics.model.loop import Loop, LoopEnd, check_loop
from robot_dynamics.model.mdh_table import make_unique_name

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.formats.mdh_yaml.document import YamlDocument, YamlMapping, YamlPath
    from robot_dynamics.model.formats.mdh_yaml.evaluator import YamlEvaluator
    from robot_dynamics.model.joint import Joint

JOINT_KEYS = ("link", "role", "spring", *CUT_JOINT_FRICTION_KEYS, "limits", "initial_position", "brake")


class CutLoops(NamedTuple):
    """The parts that loops add to a tree, numbered after those of the tree.

    Attributes
    ----------
    loops : tuple of Loop
        The loops.
    joints : list of Joint
        Revolute and prismatic cut joints.
    links : list of str
        Names of the links that these joints move, which have no inertia.
    """

    loops: tuple[Loop, ...]
    joints: list[Joint]
    links: list[str]


class LoopDescription(NamedTuple):
    """A loop as the document describes it.

    Attributes
    ----------
    mapping : dict
        Its mapping.
    path : tuple
        The path of the mapping.
    evaluator : YamlEvaluator
        Evaluator of its expressions.
    moved, closed_on : tuple of YamlPart
        Placements that lead to the frames at its ends: the first in its antecedent, each next one in the frame before.
    """

    mapping: YamlMapping
    path: YamlPath
    evaluator: YamlEvaluator
    moved: tuple[YamlPart, ...]
    closed_on: tuple[YamlPart, ...]


def list_loops(evaluator: YamlEvaluator) -> list[LoopDescription]:
    """Return the loops in the list `loops` of the document of an evaluator."""
    loops = []
    for number, mapping in enumerate(evaluator.document.data.get("loops", [])):
        path = ("loops", number)
        moved = YamlPart(mapping["moved"], (*path, "moved"))
        closed_on = YamlPart(mapping["closed_on"], (*path, "closed_on"))
        loops.append(LoopDescription(mapping, path, evaluator, (moved,), (closed_on,)))
    return loops


def read_loops(
    document: YamlDocument,
    loops: Sequence[LoopDescription],
    joints: Sequence[Joint],
    links: Sequence[str],
    poses: Mapping[str, tuple[int, ScalarArray]],
) -> CutLoops:
    """Return the parts that the loops of a document add to a tree.

    Parameters
    ----------
    document : YamlDocument
        The document.
    loops : sequence of LoopDescription
        The loops.
    joints : sequence of Joint
        Joints of the tree.
    links : sequence of str
        Names of its links, the base first.
    poses : mapping of str to (int, (4, 4) array)
        For each link and frame by name: number of the link, and placement in the frame of the link.
    """
    return _Reader(document, loops, joints, links, poses).read()


class _Reader:
    """Reads the loops in their order; a loop may end on the cut links of the loops before it."""

    def __init__(
        self,
        document: YamlDocument,
        loops: Sequence[LoopDescription],
        joints: Sequence[Joint],
        links: Sequence[str],
        poses: Mapping[str, tuple[int, ScalarArray]],
    ) -> None:
        self._document = document
        self._loops = loops
        self._tree_joint_count = len(joints)
        self._joints = list(joints)
        self._links = list(links)
        self._poses = dict(poses)
        self._joint_names = {joint.name for joint in joints}
        frames = document.data.get("frames", [])
        self._later_frames = {frame["frame"] for frame in frames}
        mappings = (*(loop.mapping for loop in loops), *frames)
        self._taken = {*poses, *self._later_frames, *(mapping.get("link") for mapping in mappings)}

    def read(self) -> CutLoops:
        """Return the parts that the loops add to the tree."""
        loops: dict[str, Loop] = {}
        for loop in self._loops:
            name = loop.mapping["joint"]
            if name in loops:
                message = f"loop {name!r} is already defined: names must be unique"
                self._document.fail((*loop.path, "joint"), message)
            loops[name] = self._read_loop(loop)
        count = self._tree_joint_count
        return CutLoops(tuple(loops.values()), self._joints[count:], self._links[count + 1 :])

    def _read_loop(self, loop: LoopDescription) -> Loop:
        """Return the Loop of a description, and add its cut joint to the tree."""
        kind = loop.mapping.get("type", "revolute")
        if kind in ("fixed", "spherical"):
            for key in JOINT_KEYS:
                if key in loop.mapping:
                    self._document.fail((*loop.path, key), f"a loop of type {kind} has no joint variable: omit {key}")
            moved = self._read_end(loop.moved, loop.evaluator)
        else:
            moved = self._cut(loop)
        closed_on = self._read_end(loop.closed_on, loop.evaluator)
        closed_loop = Loop(loop.mapping["joint"], moved, closed_on, is_spherical=kind == "spherical")
        try:
            check_loop(closed_loop, len(self._links))
        except DescriptionError as error:
            self._document.fail(loop.path, str(error))
        return closed_loop

    def _cut(self, loop: LoopDescription) -> LoopEnd:
        """Add the cut joint of a loop and its link to the tree, and return the frame of this link."""
        mapping, path, evaluator = loop.mapping, loop.path, loop.evaluator
        name = mapping["joint"]
        if name in self._joint_names:
            self._document.fail((*path, "joint"), f"joint {name!r} is already defined: names must be unique")
        self._joint_names.add(name)
        if mapping.get("role") == "actuated":
            self._document.fail(
                (*path, "role"),
                f"joint {name!r} cannot be actuated, because the loop is cut there: cut the loop at an unactuated "
                "joint, and describe this one in its place",
            )
        spring = read_spring(evaluator, mapping["spring"], (*path, "spring")) if "spring" in mapping else None
        if spring is not None and "role" not in mapping:
            self._document.fail((*path, "spring"), "role missing: elastic (the spring alone holds the joint)")
        if conflict := find_role_conflict(mapping.get("role"), spring):
            self._document.fail((*path, conflict.key), conflict.message)
        end = self._read_end(loop.moved, evaluator)
        number = len(self._links)
        joint = read_joint(
            evaluator,
            mapping,
            path,
            number,
            antecedent=end.link,
            prismatic=mapping.get("type") == "prismatic",
            placement=end.placement,
            actuated=False,
            spring=spring,
        )
        self._joints.append(joint)
        link = mapping.get("link") or make_unique_name(f"{name}_link", self._taken)
        if link in self._poses:
            self._document.fail((*path, "link"), f"link or frame {link!r} is already defined: names must be unique")
        self._taken.add(link)
        self._links.append(link)
        self._poses[link] = (number, np.eye(4))
        return LoopEnd(number, np.eye(4))

    def _read_end(self, parts: Sequence[YamlPart], evaluator: YamlEvaluator) -> LoopEnd:
        """Return the frame to which placements, by mdh or by xyz and rpy, lead from the antecedent of the first."""
        first, path = parts[0]
        name = first["antecedent"]
        if name not in self._poses:
            hint = describe_unknown_link(name, self._poses, self._joints, self._links)
            if name in self._later_frames:
                hint = f"frame {name!r} is defined after the loops: give its link, with the xyz and rpy of the frame"
            self._document.fail((*path, "antecedent"), hint)
        link, frame = self._poses[name]
        for mapping, mapping_path in parts:
            frame = frame @ evaluator.read_placement(mapping, mapping_path)
        return LoopEnd(link, frame)
