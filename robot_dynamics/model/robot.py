"""A robot as data: a tree of links, each placed by one joint variable in its antecedent, and the loops that close it
(Khalil, section 2).

Link 0 is the base. Joint j moves link j, and a(j) < j is its antecedent. Frame j is fixed to link j with z_j along the
axis of joint j. The links of the description, each in the frame that its author gave it, stay known as named frames.
"""

from collections import Counter
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError, describe_unknown_name
from robot_dynamics.model.beam import Flexibility, RigidBody
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import Joint, check_joint, check_placement, find_suspicious_limits
from robot_dynamics.model.loop import Loop, check_loop
from robot_dynamics.model.platform import Platform, check_platform

EARTH_GRAVITY = (0.0, 0.0, -9.81)
MASSLESS_WARNING = (
    "none of its moving links has a mass, so that weight and inertia are zero in all results: complete the "
    "description, or identify the masses from recordings (robot-dynamics identify)"
)
MAX_JOINTS = 2000  # real robots have a hundred; matrices grow with the square


@dataclass(frozen=True, eq=False)
class Link:
    """A body: its name, its inertia about the origin of its frame, with all that is fixed to it, and what of it bends:
    None of a rigid body. The inertia is that of the straight link, as models of rigid bodies need it."""

    name: str
    inertia: Inertia
    flexibility: Flexibility | None = None

    def transformed_by(self, matrix):
        """The same link in the frame in which `matrix` (4, 4) places its own."""
        bends = None if self.flexibility is None else self.flexibility.transformed_by(matrix)
        return replace(self, inertia=self.inertia.transformed_by(matrix), flexibility=bends)


@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame fixed to a link: the number of the link and jT (4, 4), its placement in the frame of the link."""

    name: str
    link: int
    placement: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """A robot with the structure of a tree, or with loops, cut open into a tree.

    links: n + 1 of them, the base first; joints: n, joints[j - 1] moves links[j]; frames: every link of the
    description, those that are fixed to another one too; moving_base: whether nothing holds link 0; gravity: (3,)
    [m/s²], in the world, which is the frame of the base where the base is fixed; loops: the pairs of frames that
    coincide, none in a tree; platforms: those of a parallel robot, many where parallel modules are put in series.

    Raises DescriptionError where these do not fit together.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    moving_base: bool = False
    gravity: np.ndarray = EARTH_GRAVITY
    loops: tuple[Loop, ...] = ()
    platforms: tuple[Platform, ...] = ()

    def __post_init__(self):
        self._check_gravity_and_base()
        if len(self.links) != len(self.joints) + 1:
            raise DescriptionError(f"{len(self.joints)} joints move {len(self.links)} links: one link more is needed")
        if len(self.joints) > MAX_JOINTS:
            raise DescriptionError(f"{len(self.joints)} moving joints are more than are read: {MAX_JOINTS} at most")
        for kind, items in (("joint", self.joints), ("frame", self.frames), ("loop", self.loops)):
            (repeated, times), *_ = [*Counter(item.name for item in items).most_common(1), ("", 1)]
            if times > 1:
                raise DescriptionError(f"{kind} {repeated!r} is there more than once: names must differ")
        for number, joint in enumerate(self.joints, start=1):
            check_joint(number, joint)
        for loop in self.loops:
            check_loop(loop, len(self.links))
        for link in self.links:
            if not link.inertia.is_finite:
                raise DescriptionError(f"link {link.name!r}: its inertia has an entry that is not a finite number")
            if not link.inertia.has_symbols and link.inertia.mass < 0:
                raise DescriptionError(f"link {link.name!r}: mass {link.inertia.mass:g} kg is negative")
            if link.name not in self.frames_by_name:
                raise DescriptionError(f"link {link.name!r} is no frame: every link is known as one")
        for frame in self.frames:
            if not 0 <= frame.link < len(self.links):
                raise DescriptionError(f"frame {frame.name!r} is on link {frame.link}, of 0 to {len(self.links) - 1}")
            check_placement(f"frame {frame.name!r}", frame.placement)
        for number, link in enumerate(self.links):
            if self.frames_by_name[link.name].link != number:
                raise DescriptionError(f"frame {link.name!r} is on another link than the one of its name")
        for platform in self.platforms:
            check_platform(platform, self)
        if len({platform.link for platform in self.platforms}) < len(self.platforms):
            raise DescriptionError("a link is a platform once: each module has its own")
        _ = self.mimic_relations

    def __repr__(self):
        base = "moving" if self.moving_base else "fixed"
        return f"Robot({self.name!r}, {len(self.joints)} joints, {base} base)"

    def _check_gravity_and_base(self):
        try:
            gravity = np.array(self.gravity, dtype=float)
        except (TypeError, ValueError):
            gravity = np.zeros(0)
        if gravity.shape != (3,) or not np.isfinite(gravity).all():
            raise DescriptionError(f"gravity is {self.gravity!r}: three finite numbers [m/s²] are needed")
        object.__setattr__(self, "gravity", gravity)
        if not isinstance(self.moving_base, bool | np.bool_):
            raise DescriptionError(f"moving_base is {self.moving_base!r}: True or False is needed")

    @property
    def platform(self):
        """The Platform of a parallel robot, None of others. Raises QuestionError where there are many."""
        if len(self.platforms) > 1:
            names = ", ".join(self.platform_links)
            raise InvalidInputError(
                f"{self.name!r} has {len(self.platforms)} platforms ({names}): say which one is meant"
            )
        return self.platforms[0] if self.platforms else None

    @property
    def platform_links(self):
        """Names of the links of the platforms."""
        return tuple(self.links[platform.link].name for platform in self.platforms)

    @property
    def base_link(self):
        """Name of link 0."""
        return self.links[0].name

    @cached_property
    def joint_numbers(self):
        """The number of each joint in `joints`, by name."""
        return {joint.name: number for number, joint in enumerate(self.joints)}

    @cached_property
    def frames_by_name(self):
        return {frame.name: frame for frame in self.frames}

    def frame(self, name):
        """The frame of that name. Raises QuestionError where there is none."""
        try:
            return self.frames_by_name[name]
        except (KeyError, TypeError):
            told = describe_unknown_name("link", name, self.frames_by_name)
            if isinstance(name, str) and name in self.joint_numbers:
                told = f"{name!r} is a joint: it moves link {self.links[self.joint_numbers[name] + 1].name!r}"
            raise InvalidInputError(told) from None

    @cached_property
    def mimic_relations(self):
        """For each joint (number of the joint it depends on, multiplier, offset); an independent one leads itself.

        Raises DescriptionError where a joint follows one that is not there, or in the end itself.
        """
        return tuple(self._leader(number) for number in range(len(self.joints)))

    def _leader(self, number):
        multiplier, offset, passed = 1.0, 0.0, set()
        while (mimic := self.joints[number].mimic) is not None:
            passed.add(number)
            if mimic.joint not in self.joint_numbers:
                leader = describe_unknown_name("moving joint", mimic.joint, self.joint_numbers)
                raise DescriptionError(f"joint {self.joints[number].name!r} mimics {leader}")
            multiplier, offset = multiplier * mimic.multiplier, multiplier * mimic.offset + offset
            number = self.joint_numbers[mimic.joint]
            if number in passed:
                raise DescriptionError(f"joint {self.joints[number].name!r} in the end mimics itself")
        return number, multiplier, offset

    @cached_property
    def is_massless(self) -> bool:
        """Whether it has joints, and no link that they move has a mass or a moment of inertia.

        So are URDFs without `<inertial>`. The base counts as little as rotors do.
        """
        return bool(self.joints) and not any(np.any(link.inertia.spatial) for link in self.links[1:])

    @cached_property
    def warnings(self):
        """What is doubtful: inertias, judged on whole links with all that is fixed to them, and limits. Sentences.

        The inertia of a base that does not move counts nowhere and is not judged; of a link that turns about an axis
        of such a base tables give what counts, the moment about this axis alone.
        """
        first, told_by_moment = (0 if self.moving_base else 1), self._known_by_moment
        judged = [link for number, link in enumerate(self.links[first:], first) if number not in told_by_moment]
        found = [
            f"link {link.name!r}: {objection}" for link in judged for objection in link.inertia.find_inconsistencies()
        ]
        if self.moving_base and not any(link.inertia.mass for link in self.links):
            found.append("the moving base and all that it carries have no mass, so no model has an answer")
        for joint in self.joints:
            found += find_suspicious_limits(joint)
        resisted = self._resisted  # what loops bind is judged with the loops closed
        if self.is_massless:  # said once, and not of each joint
            found.append(MASSLESS_WARNING)
        for number, (leader, _, _) in enumerate(self.mimic_relations):
            if leader == number and not (resisted[number] or number in self.joints_in_loops or self.is_massless):
                found.append(
                    f"link {self.links[number + 1].name!r}: joint {self.joints[number].name!r} moves nothing with "
                    "inertia, so the direct model has no answer"
                )
        for platform in self.platforms:
            found += self._loose(platform)
        return tuple(found)

    def path_to_base(self, link):
        """Numbers of the joints between a link and the base, from the link on."""
        found = []
        while link > 0:
            found.append(link - 1)
            link = self.joints[link - 1].antecedent
        return found

    @cached_property
    def joints_in_loops(self):
        """Numbers of the joints that are part of a loop: on the way of one of its ends, and not of the other."""
        return frozenset().union(
            *(
                set(self.path_to_base(a.link)) ^ set(self.path_to_base(b.link))
                for a, b in (loop.ends for loop in self.loops)
            )
        )

    @cached_property
    def characteristic_length(self):
        """The mean length [m] of the links that are part of loops: what a radian moves."""
        placements = [self.joints[number].placement for number in self.joints_in_loops]
        placements += [end.placement for loop in self.loops for end in loop.ends]
        lengths = [length for placed in placements if (length := np.linalg.norm(placed[:3, 3])) > 0]
        return float(np.mean(lengths)) if lengths else 1.0

    def _loose(self, platform):
        """What is doubtful about how a Platform is held: sentences."""
        held = sum(len({*platform.joints} & ({*self.path_to_base(a.link)} ^ {*self.path_to_base(b.link)})) > 0
                   for a, b in (loop.ends for loop in self.loops))  # fmt: skip
        legs = "no leg" if held == 0 else "one leg alone"
        name = self.links[platform.link].name
        return [f"platform {name!r}: {legs} holds it, and a parallel robot has two at least"] if held < 2 else []

    @property
    def _known_by_moment(self):
        """Numbers of the links of which only the moment about their axis is told, an axis that stands still."""
        still, known = set() if self.moving_base else {0}, set()
        for number, joint in enumerate(self.joints, start=1):
            R, P = joint.placement[:3, :3], joint.placement[:3, 3]
            on_axis = joint.antecedent == 0 or not (np.any(R[:2, 2]) or np.any(P[:2]))
            if joint.antecedent in still and on_axis and not joint.prismatic:
                still.add(number)
                if self.links[number].inertia.is_moment_about_z:
                    known.add(number)
        return known

    @property
    def _resisted(self):
        """For each joint, whether something that it moves, or that moves with it, has inertia.

        At the end of a branch it must be inertia along the axis itself; further down any will do, as what it comes to
        along the axis depends on where the joints are.
        """
        ends = set(range(1, len(self.links))) - {joint.antecedent for joint in self.joints}
        carries = [bool(np.any(link.inertia.spatial)) for link in self.links]
        resisted = [False] * len(self.joints)
        for number, joint in reversed(list(enumerate(self.joints, start=1))):
            resists = carries[number]
            if number in ends:
                diagonal = np.diagonal(self.links[number].inertia.spatial)
                resists = diagonal[2 if joint.prismatic else 5] > 1e-12 * diagonal.max()
            resisted[self.mimic_relations[number - 1][0]] |= bool(resists or joint.rotor_inertia > 0)
            carries[joint.antecedent] |= carries[number]
        return resisted

    def raise_on_warnings(self):
        """Raise DescriptionError where there are `warnings`."""
        if self.warnings:
            raise DescriptionError(f"robot {self.name!r}: {'; '.join(self.warnings)}")

    def with_payload(self, name, inertia):
        """The same robot with an Inertia more, given in the link frame `name` and about its origin.

        Raises QuestionError for an unknown link, a negative mass or a number that is not finite.
        """
        frame = self.frame(name)
        if not isinstance(inertia, Inertia):
            raise InvalidInputError(f"payload on link {name!r} is {inertia!r}: an Inertia is needed")
        if not inertia.is_finite or inertia.mass < 0:
            raise InvalidInputError(
                f"payload on link {name!r} has mass {inertia.mass:g} kg and moments {inertia.first_moments}, "
                f"{inertia.second_moments.tolist()}: finite numbers and a mass of zero or more are needed"
            )
        links = list(self.links)
        carrier = links[frame.link]
        seen = inertia.transformed_by(frame.placement)
        bends = carrier.flexibility and carrier.flexibility.with_body(RigidBody(frame.placement[:3, 3], seen))
        links[frame.link] = replace(carrier, inertia=carrier.inertia + seen, flexibility=bends)
        return replace(self, links=tuple(links))
