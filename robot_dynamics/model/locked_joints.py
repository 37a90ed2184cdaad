"""Reduced robots: joints that are locked at given positions, and the links that are lumped by it.

A locked joint becomes a fixed placement. The link that it moves joins the link of its antecedent, with its inertia by
parallel axes; its named frames stay, on that link. The model of the reduced robot is exactly that of the whole one in
which the locked joints have these positions and neither velocity nor acceleration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError, describe_unknown_name
from robot_dynamics.model.beam import Flexibility, RigidBody
from robot_dynamics.model.joint import LockedJoint
from robot_dynamics.model.loop import LoopEnd
from robot_dynamics.model.mdh import joint_displacement
from robot_dynamics.model.robot_warnings import find_joints_without_inertia

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.joint import Joint
    from robot_dynamics.model.loop import Loop
    from robot_dynamics.model.platform import Platform
    from robot_dynamics.model.robot import Link, Robot

CLOSURE_TOLERANCE = 1e-6
"""Gap [m, rad] of a loop all of whose joints are locked: positions are written with few digits."""
MAX_NAMES = 8  # in one message


def lock_joints(robot: Robot, positions: Mapping[str, float]) -> Robot:
    """Return a robot with locked joints, as `Robot.with_locked_joints` documents it."""
    return _reduce(robot, _positions_by_number(robot, positions), is_massless=False)


def lock_massless_joints(robot: Robot) -> Robot:
    """Return a robot with all joints locked that move nothing with inertia, as `load_robot` documents it.

    Each joint is locked at its initial position, or at the nearest one within its limits. A robot without any mass
    stays as it is.
    """
    if robot.is_massless:
        return robot
    locked: dict[int, float] = {}
    for number in find_joints_without_inertia(robot):
        joint = robot.joints[number]
        locked[number] = float(np.clip(joint.initial_position, joint.limits.lower, joint.limits.upper))
    return _reduce(robot, _with_followers(robot, locked), is_massless=True)


def _positions_by_number(robot: Robot, positions: Mapping[str, float]) -> dict[int, float]:
    """Return the positions of locked joints and of their mimic joints, by number. Raises InvalidInputError."""
    if not isinstance(positions, Mapping):
        raise InvalidInputError(f"locked joints are {positions!r:.60}: {{name: position}} is needed")
    locked: dict[int, float] = {}
    for name, position in positions.items():
        if name not in robot.joint_numbers:
            known = {joint.name: joint.position for joint in robot.locked_joints}
            if name in known:
                raise InvalidInputError(f"joint {name!r} is locked already, at {known[name]:g}")
            raise InvalidInputError(f"locked joint: {describe_unknown_name('moving joint', name, robot.joint_numbers)}")
        locked[robot.joint_numbers[name]] = _check_position(name, position)
    for number, position in locked.items():
        _check_mimic_joint(robot, number, position, locked)
    leaders = {number: position for number, position in locked.items() if robot.joints[number].mimic is None}
    return _with_followers(robot, leaders)


def _check_position(name: str, position: Any) -> float:
    """Return the position of a locked joint as a number. Raises InvalidInputError."""
    value = np.asarray(position)
    if value.shape != () or value.dtype.kind not in "iuf" or not np.isfinite(value):
        raise InvalidInputError(f"locked joint {name!r}: its position is {position!r:.60}, a finite number is needed")
    return float(value)


def _check_mimic_joint(robot: Robot, number: int, position: float, locked: Mapping[int, float]) -> None:
    """Raise InvalidInputError where a mimic joint is to be locked elsewhere than where its leader puts it."""
    leader, multiplier, offset = robot.mimic_relations[number]
    if leader == number:
        return
    name, leader_name = robot.joints[number].name, robot.joints[leader].name
    if leader in locked:
        expected = multiplier * locked[leader] + offset
        if abs(expected - position) > CLOSURE_TOLERANCE:
            raise InvalidInputError(
                f"locked joint {name!r} is to be at {position:g}, but it mimics {leader_name!r}, which puts it at "
                f"{expected:g}: leave it out, it is locked with that joint"
            )
        return
    remedy = f" at {(position - offset) / multiplier:g}" if multiplier else ""
    raise InvalidInputError(
        f"locked joint {name!r} mimics {leader_name!r}: lock {leader_name!r}{remedy}, and {name!r} is locked with it"
    )


def _with_followers(robot: Robot, leaders: Mapping[int, float]) -> dict[int, float]:
    """Return the positions of joints that mimic no other one, and of all joints that mimic them, by number."""
    return {
        number: multiplier * leaders[leader] + offset
        for number, (leader, multiplier, offset) in enumerate(robot.mimic_relations)
        if leader in leaders
    }


def _reduce(robot: Robot, locked: Mapping[int, float], *, is_massless: bool) -> Robot:
    """Return a robot with some joints locked, {number: position}; is_massless: why, for the warnings."""
    if not locked:
        return robot
    platforms = [platform for platform in robot.platforms if not _is_locked_platform(robot, platform, locked)]
    _check_passive_joints(robot, locked)
    links: list[Link] = [robot.links[0]]
    joints: list[Joint] = []
    places: list[LoopEnd] = [LoopEnd(0, np.eye(4))]  # of the frame of each link of the whole robot
    for number, joint in enumerate(robot.joints):
        link = robot.links[number + 1]
        carrier, frame = places[joint.antecedent]
        pose = frame @ joint.placement
        if number in locked:
            place = LoopEnd(carrier, pose @ joint_displacement(joint.prismatic, locked[number]))
            links[carrier] = _lump(links[carrier], link, place.placement, joint.name)
        else:
            joints.append(replace(joint, antecedent=carrier, placement=pose))
            links.append(link)
            place = LoopEnd(len(joints), np.eye(4))
        places.append(place)
    numbers = {number: index for index, number in enumerate(sorted(set(range(len(robot.joints))) - set(locked)))}
    records = [LockedJoint(robot.joints[k].name, q, robot.joints[k].limits, is_massless) for k, q in locked.items()]
    return replace(
        robot,
        links=tuple(links),
        joints=tuple(joints),
        frames=tuple(
            replace(frame, link=places[frame.link].link, placement=places[frame.link].placement @ frame.placement)
            for frame in robot.frames
        ),
        loops=tuple(loop for original in robot.loops if (loop := _relocate_loop(original, places)) is not None),
        platforms=tuple(
            replace(platform, link=places[platform.link].link, joints=tuple(numbers[k] for k in platform.joints))
            for platform in platforms
        ),
        locked_joints=(*robot.locked_joints, *records),
    )


def _is_locked_platform(robot: Robot, platform: Platform, locked: Mapping[int, float]) -> bool:
    """Return whether all coordinates of a platform are locked. Raises DescriptionError where only some are."""
    coordinates = [number for number in platform.joints if number in locked]
    if 0 < len(coordinates) < len(platform.joints):
        raise DescriptionError(
            f"joint {robot.joints[coordinates[0]].name!r} cannot be locked: it is a coordinate of platform "
            f"{robot.links[platform.link].name!r}, which the legs hold. Lock actuated joints of the legs"
        )
    return bool(coordinates)


def _check_passive_joints(robot: Robot, locked: Mapping[int, float]) -> None:
    """Raise DescriptionError where a passive joint of a loop is locked, unless all joints of a loop with it are.

    The actuated and elastic joints of a loop determine its passive ones. With one of these fixed, fewer motions would
    be left than motors.
    """
    determined = [robot.joints_in_loop(loop) for loop in robot.loops]
    fixed = set[int]().union(*(joints for joints in determined if joints <= set(locked)))
    for number in locked:
        leader = robot.mimic_relations[number][0]
        if robot.joints[leader].role != "passive" or number not in robot.joints_in_loops or number in fixed:
            continue
        loop_joints = set[int]().union(*(joints for joints in determined if number in joints))
        motors = [robot.joints[k].name for k in sorted(loop_joints - set(locked)) if robot.joints[k].actuated]
        names = ", ".join(map(repr, motors[:MAX_NAMES])) or "none is left"
        raise DescriptionError(
            f"joint {robot.joints[number].name!r} cannot be locked: it is passive in a loop, and the actuated joints "
            f"of the loop determine its position. Lock these instead: {names}"
        )


def _lump(carrier: Link, link: Link, pose: ScalarArray, joint: str) -> Link:
    """Return a link with another one fixed to it, whose frame stands at `pose` (4, 4); joint: name of the locked one.

    Raises DescriptionError where the links are flexible and do not fit together.
    """
    moved = link.transformed_by(pose)
    flexibility = carrier.flexibility
    if moved.flexibility is not None:
        if flexibility is None:
            raise DescriptionError(
                f"joint {joint!r} cannot be locked: link {link.name!r} is flexible, and link {carrier.name!r}, to "
                "which it would be fixed, is rigid. A link is either one"
            )
        try:
            flexibility = Flexibility(
                (*flexibility.beams, *moved.flexibility.beams), (*flexibility.bodies, *moved.flexibility.bodies)
            )
        except DescriptionError as error:
            raise DescriptionError(
                f"joint {joint!r} cannot be locked: beams of links {carrier.name!r} and {link.name!r}: {error}"
            ) from None
    elif flexibility is not None and np.any(link.inertia.spatial):
        flexibility = flexibility.with_body(RigidBody(pose[:3, 3], moved.inertia))
    return replace(
        carrier,
        inertia=carrier.inertia + moved.inertia,
        flexibility=flexibility,
        lacks_inertial=carrier.lacks_inertial or link.lacks_inertial,
    )


def _relocate_loop(loop: Loop, places: list[LoopEnd]) -> Loop | None:
    """Return a loop of the whole robot in the reduced one; None where all of its joints are locked and it closes.

    places: link of the reduced robot that carries each link of the whole one, and placement there. Raises
    DescriptionError where the joints are all locked, and the loop does not close.
    """
    moved, closed_on = (LoopEnd(places[end.link].link, places[end.link].placement @ end.placement) for end in loop.ends)
    if moved.link != closed_on.link:
        return replace(loop, moved=moved, closed_on=closed_on)
    gap = np.abs(moved.placement - closed_on.placement)
    gap = gap[:3, 3] if loop.is_spherical else gap
    if gap.max() > CLOSURE_TOLERANCE:
        raise DescriptionError(
            f"all joints of loop {loop.name!r} are locked, and it does not close: its ends are {gap.max():.2g} m or "
            "rad apart. Leave its passive joints out: the loop determines them"
        )
    return None
