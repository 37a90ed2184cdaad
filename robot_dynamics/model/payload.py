"""A payload that is fixed to a frame of a robot, and whether a body with its parameters can exist."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError
from robot_dynamics.model.beam import RigidBody
from robot_dynamics.model.inertia import Inertia, symmetric_entries
from robot_dynamics.model.vector_product import skew

if TYPE_CHECKING:
    from robot_dynamics.model.robot import Robot


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
    warnings = (*robot.payload_warnings, *_find_payload_warnings(name, inertia))
    return replace(robot, links=tuple(links), payload_warnings=warnings)


def _find_payload_warnings(name: str, inertia: Inertia) -> list[str]:
    """Return sentences about a payload that no physical body is; name: of the frame that carries it."""
    if inertia.has_symbols:
        return []
    warnings = [f"payload on link {name!r}: {objection}" for objection in inertia.find_inconsistencies()]
    if warnings and inertia.mass > 0 and not np.any(inertia.second_moments):
        offset = skew(inertia.first_moments)
        entries = [float(f"{entry:.4g}") + 0.0 for entry in symmetric_entries(-offset @ offset / inertia.mass)]
        warnings[0] += (
            ". Its second moments about the origin of the frame are zero: those of a point mass at its centre are "
            f"xx, xy, xz, yy, yz, zz = {entries} kg m²"
        )
    return warnings
