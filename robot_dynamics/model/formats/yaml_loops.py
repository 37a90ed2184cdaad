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
from robot_dynamics.model.formats.yaml_joints import joint_told, objection_to_role, spring_told, unknown_link
from robot_dynamics.model.joint import Joint
from robot_dynamics.model.loop import End, Loop, check_loop
from robot_dynamics.model.mdh_table import free_name

OF_A_JOINT = ("link", "role", "spring", "viscous_friction", "coulomb_friction", "limits", "initial_position")


class Cuts(NamedTuple):
    """What loops add to a tree.

    loops: the Loops; joints: those that turn or slide where the loops are cut; links: names of the links that these
    move, which have no inertia. They are numbered on from those of the tree.
    """

    loops: tuple[Loop, ...]
    joints: list[Joint]
    links: list[str]


def read_loops(numbers, joints, links, placed):
    """The Cuts of the loops in the document of YamlNumbers; it may have none.

    joints, links: the Joints of the tree and the names of its links, the base first; placed: {name: (number of the
    link, placement (4, 4) in its frame)} of all links and frames. Raises DescriptionError.
    """
    return _Reader(numbers, joints, links, placed).read()


class _Reader:
    """Walks the loops in their order; a loop may end on the links of those before it."""

    def __init__(self, numbers, joints, links, placed):
        self.numbers, self.document = numbers, numbers.document
        self.tree = len(joints)
        self.joints, self.links, self.placed = list(joints), list(links), dict(placed)
        self.told = self.document.data.get("loops", [])
        others = (*self.told, *self.document.data.get("frames", []))
        self.taken = {*placed, *(told.get("link") for told in others), *(told.get("frame") for told in others)}

    def read(self):
        loops = []
        for number, told in enumerate(self.told):
            path = ("loops", number)
            if told["joint"] in {loop.name for loop in loops}:
                self.document.fail((*path, "joint"), f"loop {told['joint']!r} is there already: names must differ")
            loops.append(self._loop(told, path))
        return Cuts(tuple(loops), self.joints[self.tree :], self.links[self.tree + 1 :])

    def _loop(self, told, path):
        kind = told.get("type", "revolute")
        if kind in ("fixed", "spherical"):
            for key in OF_A_JOINT:
                if key in told:
                    self.document.fail((*path, key), f"a loop of type {kind} has no joint variable: leave out {key}")
            moved = self._end(told["moved"], (*path, "moved"))
        else:
            moved = self._cut(told, path)
        closed_on = self._end(told["closed_on"], (*path, "closed_on"))
        loop = Loop(told["joint"], moved, closed_on, ball=kind == "spherical")
        try:
            check_loop(loop, len(self.links))
        except DescriptionError as error:
            self.document.fail(path, str(error))
        return loop

    def _cut(self, told, path):
        """The End at the joint of a loop, which is added to the tree with its link."""
        name = told["joint"]
        if name in {joint.name for joint in self.joints}:
            self.document.fail((*path, "joint"), f"joint {name!r} is there already: names must differ")
        if told.get("role") == "actuated":
            self.document.fail(
                (*path, "role"),
                f"no motor can drive joint {name!r}, where the loop is cut: cut the loop at another joint, one without "
                "motor, and describe this one where the other was",
            )
        spring = spring_told(self.numbers, told["spring"], (*path, "spring")) if "spring" in told else None
        if spring is not None and "role" not in told:
            self.document.fail((*path, "spring"), "role missing: elastic (the spring alone holds the joint)")
        if objection := objection_to_role(told.get("role"), spring):
            self.document.fail((*path, objection[0]), objection[1])
        antecedent, placement = self._end(told["moved"], (*path, "moved"))
        known = {"antecedent": antecedent, "placement": placement, "prismatic": told.get("type") == "prismatic"}
        number = len(self.links)
        self.joints.append(joint_told(self.numbers, told, path, number, spring=spring, actuated=False, **known))
        link = told.get("link") or free_name(f"{name}_link", self.taken)
        if link in self.placed:
            self.document.fail((*path, "link"), f"link or frame {link!r} is there already: names must differ")
        self.taken.add(link)
        self.links.append(link)
        self.placed[link] = (number, np.eye(4))
        return End(number, np.eye(4))

    def _end(self, told, path):
        """The End at a frame, told by mdh or by xyz and rpy, in the frame of its antecedent."""
        name = told["antecedent"]
        if name not in self.placed:
            hint = unknown_link(name, self.placed, self.joints, self.links)
            self.document.fail((*path, "antecedent"), hint)
        twice = next((key for key in ("xyz", "rpy") if key in told and "mdh" in told), None)
        if twice is not None:
            self.document.fail((*path, twice), f"mdh and {twice} say the same twice: mdh is right, or xyz and rpy")
        link, frame = self.placed[name]
        place = self.numbers.mdh if "mdh" in told else self.numbers.pose
        return End(link, frame @ place(told, path))
