"""Equality constraints of an MJCF: mimic joints and closed loops."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.joint import Mimic
from robot_dynamics.model.loop import Loop, LoopEnd
from robot_dynamics.model.placement import placement, rotation_from_quaternion

if TYPE_CHECKING:
    from collections.abc import Mapping

    from robot_dynamics.array_types import Array


class Equality(NamedTuple):
    """An equality constraint: its name, type, kind of objects, their numbers and its data."""

    name: str
    type: str
    object_type: str
    objects: tuple[int, int]
    data: list[float]


def active_equalities(model: dict[str, Any]) -> tuple[list[Equality], list[str]]:
    """Return the equality constraints that are active at first, and the names of the others."""
    if {"mjDSBL_EQUALITY", "mjDSBL_CONSTRAINT"} & set(model["disabled"]):
        return [], []
    active, inactive = [], []
    for number, name in enumerate(model["names"]["equality"]):
        name = name or f"equality {number}"
        if not model["eq_active0"][number]:
            inactive.append(name)
            continue
        objects = (model["eq_obj1id"][number], model["eq_obj2id"][number])
        kind, data = model["eq_type"][number], model["eq_data"][number]
        active.append(Equality(name, kind, model["eq_objtype"][number], objects, data))
    return active, inactive


def read_mimics(model: dict[str, Any], equalities: list[Equality], names: list[str]) -> dict[int, Mimic]:
    """Return the mimic relations of joints by number; names: of all joints."""
    mimics: dict[int, Mimic] = {}
    for name, kind, _, (follower, leader), data in equalities:
        if kind != "mjEQ_JOINT":
            continue
        offset, factor, *others = data[:5]
        if leader < 0 or factor == 0:
            raise DescriptionError(f"equality {name!r} holds joint {names[follower]!r}: remove that joint instead")
        if any(others):
            raise DescriptionError(
                f"equality {name!r} of joint {names[follower]!r} is not linear: only polycoef='a b 0 0 0' is read"
            )
        if follower in mimics:
            raise DescriptionError(f"equality {name!r}: joint {names[follower]!r} follows two joints, one is possible")
        rests = [model["qpos0"][model["jnt_qposadr"][joint]] for joint in (follower, leader)]
        mimics[follower] = Mimic(names[leader], factor, rests[0] + offset - factor * rests[1])
    return mimics


def read_loops(
    model: dict[str, Any],
    equalities: list[Equality],
    bodies: Mapping[int, tuple[int, Array]],
) -> tuple[Loop, ...]:
    """Return the loops that connect and weld close.

    Parameters
    ----------
    model : dict
        The compiled model.
    equalities : list of Equality
        The active constraints.
    bodies : mapping
        Number of the link of each body, and placement (4, 4) of the body in that link.

    Raises
    ------
    DescriptionError
        For a constraint of another kind, and one to a body that is no part of the robot.
    """
    loops = []
    for name, kind, object_type, objects, data in equalities:
        if kind == "mjEQ_JOINT":
            continue
        if kind not in ("mjEQ_CONNECT", "mjEQ_WELD"):
            raise DescriptionError(
                f"equality {name!r} is a {kind[5:].lower()} constraint: joint, connect and weld are read"
            )
        is_spherical = kind == "mjEQ_CONNECT"
        if object_type == "mjOBJ_SITE":
            numbers = [model["site_bodyid"][site] for site in objects]
            ends = [
                placement(rotation_from_quaternion(model["site_quat"][site]), model["site_pos"][site])
                for site in objects
            ]
        else:
            numbers = list(objects)
            first, second = (data[0:3], data[3:6]) if is_spherical else (data[3:6], data[0:3])
            turned = np.eye(3) if is_spherical else rotation_from_quaternion(data[6:10])
            ends = [placement(turned, first), placement(None, second)]
        for body in numbers:
            if body not in bodies or model["body_mocapid"][body] >= 0:
                place = model["names"]["body"][body] or "world"
                raise DescriptionError(f"equality {name!r} holds the robot at {place!r}, no part of it: remove it")
        (link, frame), (other_link, other_frame) = (bodies[body] for body in numbers)
        if link == other_link:
            raise DescriptionError(f"equality {name!r} is between bodies that are fixed to each other: remove it")
        moved, closed_on = LoopEnd(link, frame @ ends[0]), LoopEnd(other_link, other_frame @ ends[1])
        loops.append(Loop(name, moved, closed_on, is_spherical))
    return tuple(loops)
