"""A robot as data: a tree of links, each placed by one joint variable in its antecedent (Khalil, section 2).

Link 0 is the base. Joint j moves link j, and a(j) < j is its antecedent. Frame j is fixed to link j with z_j along the
axis of joint j. The links of the description, each in the frame that its author gave it, stay known as named frames.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from robot_dynamics.errors import DescriptionError, QuestionError, unknown_name
from robot_dynamics.model.inertia import Inertia

EARTH = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Limits:
    """What a joint may do: positions [rad or m], velocity [rad/s or m/s], effort [N m or N]; infinite if not said."""

    lower: float = -np.inf
    upper: float = np.inf
    velocity: float = np.inf
    effort: float = np.inf


@dataclass(frozen=True)
class Mimic:
    """A joint that follows another one: position = multiplier · position of `joint` + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True, eq=False)
class Joint:
    """A joint with one degree of freedom, and how it places the frame of its link.

    antecedent: a(j), the number of the link that carries it. prismatic: σ. placement: iTj (4, 4) of frame j in the
    frame of the antecedent where the joint variable is zero; the variable then turns frame j about z_j or moves it
    along z_j. rotor_inertia: Ia, seen at the joint [kg m² or kg]; viscous_friction: Fv [N m s/rad or N s/m];
    coulomb_friction: Fs [N m or N].
    """

    name: str
    antecedent: int
    prismatic: bool
    placement: np.ndarray
    rotor_inertia: float = 0.0
    viscous_friction: float = 0.0
    coulomb_friction: float = 0.0
    limits: Limits = field(default_factory=Limits)
    mimic: Mimic | None = None


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body: its name, its inertia about the origin of its frame, with all that is fixed to it."""

    name: str
    inertia: Inertia


@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame fixed to a link: the number of the link and jT (4, 4), its placement in the frame of the link."""

    name: str
    link: int
    placement: np.ndarray


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree-structured robot.

    links: n + 1 of them, the base first; joints: n, joints[j - 1] moves links[j]; frames: every link of the
    description, those that are fixed to another one too; moving_base: whether nothing holds link 0; gravity: (3,)
    [m/s²], in the world, which is the frame of the base where the base is fixed.

    Raises DescriptionError where these do not fit together.
    """

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    moving_base: bool = False
    gravity: np.ndarray = EARTH

    def __post_init__(self):
        object.__setattr__(self, "gravity", np.array(self.gravity, dtype=float))
        if self.gravity.shape != (3,) or not np.isfinite(self.gravity).all():
            raise DescriptionError(f"gravity is {self.gravity}: three finite numbers [m/s²] are needed")
        if len(self.links) != len(self.joints) + 1:
            raise DescriptionError(f"{len(self.joints)} joints move {len(self.links)} links: one link more is needed")
        for number, joint in enumerate(self.joints, start=1):
            if not 0 <= joint.antecedent < number:
                raise DescriptionError(
                    f"joint {joint.name!r} moves link {number} but hangs on link {joint.antecedent}: "
                    "a link comes after its antecedent"
                )
        for kind, items in (("joint", self.joints), ("frame", self.frames)):
            names = [item.name for item in items]
            repeated = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
            if repeated:
                raise DescriptionError(f"{kind} {repeated[0]!r} is there more than once: names must differ")
        for link in self.links:
            if not link.inertia.is_finite:
                raise DescriptionError(f"link {link.name!r}: its inertia has an entry that is not a finite number")
            if link.inertia.mass < 0:
                raise DescriptionError(f"link {link.name!r}: mass {link.inertia.mass:g} kg is negative")
        _ = self.leaders

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
            raise QuestionError(unknown_name("link", name, self.frames_by_name)) from None

    @cached_property
    def leaders(self):
        """For each joint (number of the joint it depends on, multiplier, offset); an independent one leads itself.

        Raises DescriptionError where a joint follows one that is not there, or in the end itself.
        """
        return tuple(self._leader(number) for number in range(len(self.joints)))

    def _leader(self, number):
        multiplier, offset, passed = 1.0, 0.0, set()
        while (mimic := self.joints[number].mimic) is not None:
            passed.add(number)
            if mimic.joint not in self.joint_numbers:
                leader = unknown_name("moving joint", mimic.joint, self.joint_numbers)
                raise DescriptionError(f"joint {self.joints[number].name!r} mimics {leader}")
            multiplier, offset = multiplier * mimic.multiplier, multiplier * mimic.offset + offset
            number = self.joint_numbers[mimic.joint]
            if number in passed:
                raise DescriptionError(f"joint {self.joints[number].name!r} in the end mimics itself")
        return number, multiplier, offset

    @cached_property
    def warnings(self):
        """What is doubtful about the inertias, judged on whole links with all that is fixed to them: sentences.

        The inertia of a base that does not move counts nowhere and is not judged.
        """
        carried = [link.inertia.mass for link in self.links]
        for number, joint in reversed(list(enumerate(self.joints, start=1))):
            carried[joint.antecedent] += carried[number]
        found = []
        for number in range(0 if self.moving_base else 1, len(self.links)):
            link = self.links[number]
            found += [f"link {link.name!r}: {objection}" for objection in link.inertia.objections()]
            if carried[number] == 0 and (number == 0 or self.joints[number - 1].rotor_inertia == 0):
                moved = f"joint {self.joints[number - 1].name!r} moves" if number else "the moving base carries"
                found.append(f"link {link.name!r}: {moved} no mass at all, so the direct model has no answer")
        return tuple(found)

    def refuse_doubtful(self):
        """Raise DescriptionError where there are `warnings`."""
        if self.warnings:
            raise DescriptionError(f"robot {self.name!r}: {'; '.join(self.warnings)}")

    def with_payload(self, name, inertia):
        """The same robot with an Inertia more, given in the link frame `name` and about its origin.

        Raises QuestionError for an unknown link, a negative mass or a number that is not finite.
        """
        frame = self.frame(name)
        if not inertia.is_finite or inertia.mass < 0:
            raise QuestionError(
                f"payload on link {name!r} has mass {inertia.mass:g} kg and moments {inertia.first_moments}, "
                f"{inertia.second_moments.tolist()}: finite numbers and a mass of zero or more are needed"
            )
        links = list(self.links)
        carrier = links[frame.link]
        links[frame.link] = replace(carrier, inertia=carrier.inertia + inertia.seen_from(frame.placement))
        return replace(self, links=tuple(links))
