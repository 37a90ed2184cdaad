"""A robot as data: a tree of links, and the loops that close it (Khalil, section 2).

Link 0 is the base. Joint j moves link j, and a(j) < j is its antecedent. Frame j is fixed to link j with z_j along the
axis of joint j. The links of the description, each in its original frame, remain available as named frames.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError, describe_unknown_name
from robot_dynamics.model.beam import RigidBody
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import check_joint, check_placement
from robot_dynamics.model.joint_friction import has_value
from robot_dynamics.model.locked_joints import lock_joints
from robot_dynamics.model.loop import check_loop
from robot_dynamics.model.payload import find_payload_warnings
from robot_dynamics.model.platform import check_platform
from robot_dynamics.model.robot_warnings import MASSLESS_WARNING as MASSLESS_WARNING
from robot_dynamics.model.robot_warnings import find_warnings
from robot_dynamics.notebook_display import notebook_html

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.beam import Flexibility
    from robot_dynamics.model.joint import Joint, LockedJoint
    from robot_dynamics.model.loop import Loop
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.visual import Visual

logger = logging.getLogger(__name__)

EARTH_GRAVITY = (0.0, 0.0, -9.81)
MAX_JOINTS = 2000  # real robots have a hundred; matrices grow with the square


class SharedLoadError(DescriptionError):
    """A joint has load friction, but no load of its own.

    Attributes
    ----------
    joint : str
        Name of the joint.
    """

    def __init__(self, joint: str, reason: str) -> None:
        super().__init__(f"joint {joint!r} has no load of its own: {reason}. Leave load_friction out")
        self.joint = joint


@dataclass(frozen=True, eq=False)
class Link:
    """A link of the tree, with all bodies that are fixed to it.

    Parameters
    ----------
    name : str
        Name of the link.
    inertia : Inertia
        Inertia about the origin of the link's frame; of a flexible link that of the undeformed one.
    flexibility : Flexibility, optional
        Beams and bodies of a flexible link. Default: the link is rigid.
    lacks_inertial : bool
        Whether the description has a shape of the link, but no inertia. Default: False.
    """

    name: str
    inertia: Inertia
    flexibility: Flexibility | None = None
    lacks_inertial: bool = False

    def transformed_by(self, matrix: ScalarArray) -> Link:
        """Return the same link in the frame i in which `matrix`, iTj (4, 4), places its frame j."""
        flexibility = None if self.flexibility is None else self.flexibility.transformed_by(matrix)
        return replace(self, inertia=self.inertia.transformed_by(matrix), flexibility=flexibility)


@dataclass(frozen=True, eq=False)
class Frame:
    """A named frame that is fixed to a link.

    Attributes
    ----------
    name : str
        Name of the frame.
    link : int
        Number of the link.
    placement : (4, 4) array
        Placement of the frame in the frame of the link.
    """

    name: str
    link: int
    placement: ScalarArray


@dataclass(frozen=True, eq=False, repr=False)
class Robot:
    """An immutable robot: a tree of links, with loops that close it.

    Parameters
    ----------
    name : str
        Name of the robot.
    links : tuple of Link
        n + 1 links, the base first.
    joints : tuple of Joint
        n joints; joints[j - 1] moves links[j].
    frames : tuple of Frame
        All links of the description, including those that are fixed to another link.
    moving_base : bool
        Whether link 0 can move freely.
    gravity : (3,) array
        Acceleration of gravity [m/s²] in the world frame, which is the frame of a fixed base. Default: the Earth's,
        along -z.
    loops : tuple of Loop
        Pairs of frames that coincide. Default: none, a tree.
    platforms : tuple of Platform
        Platforms of a parallel robot, several where parallel modules are in series.
    reader_warnings : tuple of str
        Sentences about the text of the description. Default: none.
    payload_warnings : tuple of str
        Sentences about payloads that no physical body is. Default: none.
    visuals : tuple of Visual
        Shapes that a viewer draws. No model and no fingerprint of a program depends on them. Default: none.
    locked_joints : tuple of LockedJoint
        Joints of the description that are locked and therefore not among `joints`. No model depends on them.
        Default: none.

    Raises
    ------
    DescriptionError
        If the parts do not fit together.

    Notes
    -----
    Source: Khalil, section 2.
    """

    _repr_html_ = notebook_html

    name: str
    links: tuple[Link, ...]
    joints: tuple[Joint, ...]
    frames: tuple[Frame, ...]
    moving_base: bool = False
    gravity: Array = field(default_factory=lambda: np.array(EARTH_GRAVITY))
    loops: tuple[Loop, ...] = ()
    platforms: tuple[Platform, ...] = ()
    reader_warnings: tuple[str, ...] = ()
    payload_warnings: tuple[str, ...] = ()
    visuals: tuple[Visual, ...] = field(default=(), metadata={"in_fingerprint": False})
    locked_joints: tuple[LockedJoint, ...] = field(default=(), metadata={"in_fingerprint": False})

    def __post_init__(self) -> None:
        object.__setattr__(self, "gravity", to_gravity_vector(self.gravity))
        if not isinstance(self.moving_base, bool | np.bool_):
            raise DescriptionError(f"moving_base is {self.moving_base!r}: True or False is needed")
        if len(self.links) != len(self.joints) + 1:
            raise DescriptionError(f"{len(self.joints)} joints move {len(self.links)} links: one link more is needed")
        if len(self.joints) > MAX_JOINTS:
            raise DescriptionError(f"{len(self.joints)} moving joints are too many: the maximum is {MAX_JOINTS}")
        _check_unique("joint", (joint.name for joint in self.joints))
        _check_unique("frame", (frame.name for frame in self.frames))
        _check_unique("loop", (loop.name for loop in self.loops))
        for number, joint in enumerate(self.joints, start=1):
            check_joint(number, joint)
        for loop in self.loops:
            check_loop(loop, len(self.links))
        for link in self.links:
            self._check_link(link)
        self._check_frames()
        for platform in self.platforms:
            check_platform(platform, self)
        if len({platform.link for platform in self.platforms}) < len(self.platforms):
            raise DescriptionError("two platforms have the same link: each module needs its own")
        _ = self.mimic_relations  # raises DescriptionError
        self._check_load_friction()

    def __repr__(self) -> str:
        base = "moving" if self.moving_base else "fixed"
        return f"Robot({self.name!r}, {len(self.joints)} joints, {base} base)"

    def _check_link(self, link: Link) -> None:
        """Raise DescriptionError where a link has an impossible inertia or no frame."""
        if not link.inertia.is_finite:
            raise DescriptionError(f"link {link.name!r}: its inertia has an entry that is not a finite number")
        if not link.inertia.has_symbols and link.inertia.mass < 0:
            raise DescriptionError(f"link {link.name!r}: mass {link.inertia.mass:g} kg is negative")
        if link.name not in self.frames_by_name:
            raise DescriptionError(f"link {link.name!r} has no frame: every link needs a frame of its name")

    def _check_frames(self) -> None:
        """Raise DescriptionError where a frame is on no link or not on that of its name, or a visual on no frame."""
        for frame in self.frames:
            if not 0 <= frame.link < len(self.links):
                raise DescriptionError(f"frame {frame.name!r} is on link {frame.link}, of 0 to {len(self.links) - 1}")
            check_placement(f"frame {frame.name!r}", frame.placement)
        for number, link in enumerate(self.links):
            if self.frames_by_name[link.name].link != number:
                raise DescriptionError(f"frame {link.name!r} is not on the link of its name")
        for visual in self.visuals:
            if visual.frame not in self.frames_by_name:
                raise DescriptionError(f"a visual is on frame {visual.frame!r}, which the robot does not have")

    def _check_load_friction(self) -> None:
        """Raise SharedLoadError where a joint in a loop, or one that mimic joints follow, has load friction."""
        for number, joint in enumerate(self.joints):
            if not has_value(joint.load_friction):
                continue
            if number in self.joints_in_loops:
                raise SharedLoadError(joint.name, "it is in a loop, whose joints share the load")
            relations = enumerate(self.mimic_relations)
            followers = [self.joints[k].name for k, (leader, _, _) in relations if leader == number != k]
            if followers:
                raise SharedLoadError(joint.name, f"it carries those of its mimic joints ({', '.join(followers)})")

    @property
    def platform(self) -> Platform | None:
        """Platform of a parallel robot, None of other robots. Raises InvalidInputError where there are several."""
        if len(self.platforms) > 1:
            names = ", ".join(self.platform_links)
            raise InvalidInputError(f"{self.name!r} has {len(self.platforms)} platforms ({names}): name one of them")
        return self.platforms[0] if self.platforms else None

    @property
    def platform_links(self) -> tuple[str, ...]:
        """Names of the links of the platforms."""
        return tuple(self.links[platform.link].name for platform in self.platforms)

    @property
    def base_link(self) -> str:
        """Name of link 0."""
        return self.links[0].name

    @cached_property
    def joint_numbers(self) -> dict[str, int]:
        """Number of each joint in `joints`, by name."""
        return {joint.name: number for number, joint in enumerate(self.joints)}

    @cached_property
    def frames_by_name(self) -> dict[str, Frame]:
        """Frames by name."""
        return {frame.name: frame for frame in self.frames}

    def frame(self, name: str) -> Frame:
        """Return the frame of a name.

        Raises
        ------
        InvalidInputError
            If there is no such frame.
        """
        try:
            return self.frames_by_name[name]
        except (KeyError, TypeError):
            message = describe_unknown_name("link", name, self.frames_by_name)
            if isinstance(name, str) and name in self.joint_numbers:
                message = f"{name!r} is a joint: it moves link {self.links[self.joint_numbers[name] + 1].name!r}"
            raise InvalidInputError(message) from None

    @cached_property
    def mimic_relations(self) -> tuple[tuple[int, float, float], ...]:
        """For each joint (number of the joint that it follows, multiplier, offset); itself, 1, 0 where it follows none.

        Raises DescriptionError where a joint mimics an unknown joint, or joints mimic each other in a cycle.
        """
        return tuple(self._resolve_mimic(number) for number in range(len(self.joints)))

    def _resolve_mimic(self, number: int) -> tuple[int, float, float]:
        """Return the mimic relation of a joint to the joint at the end of its chain of mimic joints."""
        multiplier, offset = 1.0, 0.0
        passed = set()
        while (mimic := self.joints[number].mimic) is not None:
            passed.add(number)
            if mimic.joint not in self.joint_numbers:
                unknown = describe_unknown_name("moving joint", mimic.joint, self.joint_numbers)
                raise DescriptionError(f"joint {self.joints[number].name!r} mimics {unknown}")
            multiplier, offset = multiplier * mimic.multiplier, multiplier * mimic.offset + offset
            number = self.joint_numbers[mimic.joint]
            if number in passed:
                raise DescriptionError(f"joint {self.joints[number].name!r} mimics itself through a cycle of joints")
        return number, multiplier, offset

    @cached_property
    def is_massless(self) -> bool:
        """Whether the robot has joints, and no moving link has a mass or a moment of inertia.

        This is the case for a URDF without `<inertial>`. Neither the base nor rotors count.
        """
        return bool(self.joints) and not any(np.any(link.inertia.spatial) for link in self.links[1:])

    @cached_property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about doubtful parts of the description, payloads, inertias, limits and platforms."""
        return self.reader_warnings + self.payload_warnings + find_warnings(self)

    def raise_on_warnings(self) -> None:
        """Raise DescriptionError if the robot has `warnings`."""
        if self.warnings:
            raise DescriptionError(f"robot {self.name!r}: {'; '.join(self.warnings)}")

    def path_to_base(self, link: int) -> list[int]:
        """Return the numbers of the joints between a link and the base, starting at the link."""
        path = []
        while link > 0:
            path.append(link - 1)
            link = self.joints[link - 1].antecedent
        return path

    def joints_in_loop(self, loop: Loop) -> set[int]:
        """Return the numbers of the joints on the path to the base of one end of a loop, and not of the other."""
        return set(self.path_to_base(loop.moved.link)) ^ set(self.path_to_base(loop.closed_on.link))

    @cached_property
    def joints_in_loops(self) -> frozenset[int]:
        """Numbers of the joints that are part of a loop."""
        return frozenset[int]().union(*(self.joints_in_loop(loop) for loop in self.loops))

    @cached_property
    def characteristic_length(self) -> float:
        """Mean length of the links in loops [m]: the displacement that corresponds to one radian."""
        placements = [self.joints[number].placement for number in self.joints_in_loops]
        placements += [end.placement for loop in self.loops for end in loop.ends]
        lengths = [length for matrix in placements if (length := np.linalg.norm(matrix[:3, 3])) > 0]
        return float(np.mean(lengths)) if lengths else 1.0

    def with_payload(self, name: str, inertia: Inertia) -> Robot:
        """Return the same robot with an additional payload.

        Parameters
        ----------
        name : str
            Name of the frame to which the payload is fixed.
        inertia : Inertia
            Inertia of the payload in this frame, about its origin.

        Returns
        -------
        Robot
            The robot with the payload lumped into the link of the frame. Where no physical body has the inertia of
            the payload, a warning is logged, and is one of its `warnings`.

        Raises
        ------
        InvalidInputError
            If the frame is unknown, the mass negative, or a number not finite.
        """
        robot = attach_payload(self, name, inertia)
        for warning in robot.payload_warnings[len(self.payload_warnings) :]:
            logger.warning("robot %r: %s", self.name, warning)
        return robot

    def with_locked_joints(self, positions: Mapping[str, float]) -> Robot:
        """Return the same robot with locked joints: a model of fewer joints, with the same dynamics at rest there.

        Parameters
        ----------
        positions : mapping of str to float
            Positions [rad or m] of the joints to lock, by name. Joints that mimic one of them are locked with it.

        Returns
        -------
        Robot
            The robot without these joints. Each link that they move is lumped into the link of its antecedent, and
            its frames keep their names. Rotor inertia, friction, springs and motors of locked joints have no effect
            any more. A loop or platform all of whose joints are locked is left out. A position outside the limits is
            one of its `warnings`, which is logged.

        Raises
        ------
        InvalidInputError
            If a joint is unknown or locked already, a position is not a finite number, or a mimic joint is locked
            without the joint that it follows.
        DescriptionError
            If a locked joint is passive in a loop or a coordinate of a platform, a loop of locked joints does not
            close, or a flexible link would become part of a rigid one.
        """
        robot = lock_joints(self, positions)
        for joint in robot.locked_joints[len(self.locked_joints) :]:
            if objection := joint.find_objection():
                logger.warning("robot %r: %s", self.name, objection)
        return robot


def attach_payload(robot: Robot, name: str, inertia: Inertia) -> Robot:
    """Return a robot with a payload, as `Robot.with_payload` does, but log no warning."""
    frame = robot.frame(name)
    if not isinstance(inertia, Inertia):
        raise InvalidInputError(f"payload on link {name!r} is {inertia!r}: an Inertia is needed")
    if not inertia.is_finite or inertia.mass < 0:
        raise InvalidInputError(
            f"payload on link {name!r} has mass {inertia.mass:g} kg and moments {inertia.first_moments}, "
            f"{inertia.second_moments.tolist()}: finite numbers and a mass of zero or more are needed"
        )
    carrier = robot.links[frame.link]
    payload = inertia.transformed_by(frame.placement)
    flexibility = carrier.flexibility
    if flexibility is not None:
        flexibility = flexibility.with_body(RigidBody(frame.placement[:3, 3], payload))
    links = list(robot.links)
    links[frame.link] = replace(carrier, inertia=carrier.inertia + payload, flexibility=flexibility)
    warnings = (*robot.payload_warnings, *find_payload_warnings(name, inertia))
    return replace(robot, links=tuple(links), payload_warnings=warnings)


def to_gravity_vector(gravity: object) -> Array:
    """Return gravity as an array (3,) [m/s²]. Raises DescriptionError unless it is three finite numbers."""
    try:
        vector = np.array(gravity, dtype=float)
    except (TypeError, ValueError):
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise DescriptionError(f"gravity is {gravity!r}: three finite numbers [m/s²] are needed")
    return vector


def _check_unique(kind: str, names: Iterable[str]) -> None:
    """Raise DescriptionError where a name occurs more than once."""
    for name, count in Counter(names).most_common(1):
        if count > 1:
            raise DescriptionError(f"{kind} {name!r} is defined more than once: names must be unique")
