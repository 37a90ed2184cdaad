"""The loops of a YAML description: the joint at which each is cut, and the two frames that meet there.

    loops:
      - joint: knee
        moved: {antecedent: rod, mdh: {d: l}}           # frame k: these parameters, then the joint variable
        closed_on: {antecedent: crank, xyz: [r, 0, 0]}  # frame k+B, fixed

A joint that turns or slides is added to the tree, with a link without inertia that it moves (Khalil, section 2.2).
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.formats.mdh_yaml.joints import (
    describe_unknown_link,
    find_role_conflict,
    read_joint,
    read_spring,
)
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import Loop, LoopEnd, check_loop
from robot_dynamics.model.mdh_table import make_unique_name

JOINT_KEYS = ("link", "role", "spring", "viscous_friction", "coulomb_friction", "limits", "initial_position", "brake")


class CutLoops(NamedTuple):
    """What loops add to a tree.

    loops: the Loops; joints: those that turn or slide where the loops are cut; links: names of the links that these
    move, which have no inertia. They are numbered on from those of the tree.
    """

    loops: tuple[Loop, ...]
    joints: list[Joint]
    links: list[str]


class LoopDescription(NamedTuple):
    """A loop as it is told.

    told: its mapping; path: where it stands; numbers: YamlNumbers that know what its expressions come to; moved,
    closed_on: the placements that lead to the frames at its ends, each (mapping, path), the first in its antecedent,
    the next in the frame that this makes.
    """

    told: dict
    path: tuple
    evaluator: object
    moved: tuple
    closed_on: tuple


def list_loops(evaluator):
    """The ToldLoops in `loops` of the document of YamlNumbers; it may have none."""
    found = []
    for number, told in enumerate(evaluator.document.data.get("loops", [])):
        path = ("loops", number)
        ends = (((told[key], (*path, key)),) for key in ("moved", "closed_on"))
        found.append(LoopDescription(told, path, evaluator, *ends))
    return found


def read_loops(document, loops, joints, links, placed):
    """The Cuts of ToldLoops of a document.

    joints, links: the Joints of the tree and the names of its links, the base first; placed: {name: (number of the
    link, placement (4, 4) in its frame)} of all links and frames. Raises DescriptionError.
    """
    return _Reader(document, loops, joints, links, placed).read()


class _Reader:
    """Walks the loops in their order; a loop may end on the links of those before it."""

    def __init__(self, document, loops, joints, links, placed):
        self.document, self.told = document, loops
        self.tree = len(joints)
        self.joints, self.links, self.placed = list(joints), list(links), dict(placed)
        self.joint_names = {joint.name for joint in joints}
        frames = document.data.get("frames", [])
        self.later = {frame["frame"] for frame in frames}
        others = (*(loop.told for loop in loops), *frames)
        self.taken = {*placed, *self.later, *(told.get("link") for told in others)}

    def read(self):
        loops = {}
        for loop in self.told:
            name = loop.told["joint"]
            if name in loops:
                self.document.fail((*loop.path, "joint"), f"loop {name!r} is there already: names must differ")
            self.evaluator = loop.evaluator
            loops[name] = self._loop(loop)
        return CutLoops(tuple(loops.values()), self.joints[self.tree :], self.links[self.tree + 1 :])

    def _loop(self, loop):
        told, path = loop.told, loop.path
        kind = told.get("type", "revolute")
        if kind in ("fixed", "spherical"):
            for key in JOINT_KEYS:
                if key in told:
                    self.document.fail((*path, key), f"a loop of type {kind} has no joint variable: leave out {key}")
            moved = self._end(loop.moved)
        else:
            moved = self._cut(told, path, loop.moved)
        closed_on = self._end(loop.closed_on)
        found = Loop(told["joint"], moved, closed_on, is_spherical=kind == "spherical")
        try:
            check_loop(found, len(self.links))
        except DescriptionError as error:
            self.document.fail(path, str(error))
        return found

    def _cut(self, told, path, moved):
        """The End at the joint of a loop, which is added to the tree with its link."""
        name = told["joint"]
        if name in self.joint_names:
            self.document.fail((*path, "joint"), f"joint {name!r} is there already: names must differ")
        self.joint_names.add(name)
        if told.get("role") == "actuated":
            self.document.fail(
                (*path, "role"),
                f"no motor can drive joint {name!r}, where the loop is cut: cut the loop at another joint, one without "
                "motor, and describe this one where the other was",
            )
        spring = read_spring(self.evaluator, told["spring"], (*path, "spring")) if "spring" in told else None
        if spring is not None and "role" not in told:
            self.document.fail((*path, "spring"), "role missing: elastic (the spring alone holds the joint)")
        if objection := find_role_conflict(told.get("role"), spring):
            self.document.fail((*path, objection[0]), objection[1])
        antecedent, placement = self._end(moved)
        known = {"antecedent": antecedent, "placement": placement, "prismatic": told.get("type") == "prismatic"}
        number = len(self.links)
        self.joints.append(read_joint(self.evaluator, told, path, number, spring=spring, actuated=False, **known))
        link = told.get("link") or make_unique_name(f"{name}_link", self.taken)
        if link in self.placed:
            self.document.fail((*path, "link"), f"link or frame {link!r} is there already: names must differ")
        self.taken.add(link)
        self.links.append(link)
        self.placed[link] = (number, np.eye(4))
        return LoopEnd(number, np.eye(4))

    def _end(self, places):
        """The End at a frame that placements, told by mdh or by xyz and rpy, lead to from their antecedent."""
        first, path = places[0]
        name = first["antecedent"]
        if name not in self.placed:
            hint = describe_unknown_link(name, self.placed, self.joints, self.links)
            if name in self.later:
                hint = f"frame {name!r} is placed after the loops: its link is right, with the xyz and rpy of the frame"
            self.document.fail((*path, "antecedent"), hint)
        link, frame = self.placed[name]
        for told, path in places:
            frame = frame @ self.evaluator.read_placement(told, path)
        return LoopEnd(link, frame)
