"""Doubtful payloads: those that no physical body is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.inertia import Inertia, symmetric_entries

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray


INERTIA_TOLERANCE = 1e-5
"""Share of the largest moment by which moments about the centre of mass may be below zero: rounding of the numbers."""


def point_mass(mass: float, first_moments: ScalarArray) -> Inertia:
    """Return the inertia of a point mass [kg] with first moments (3,) [kg m]."""
    return Inertia.about_centre_of_mass(mass, np.zeros((3, 3)), first_moments / mass)


def find_control_objection(name: str, inertia: Inertia) -> str:
    """Return why feedback by a model with a payload is not safe, empty where it is; name: of the frame that carries it.

    With an inertia that no body has the mass matrix can have a negative eigenvalue, and feedback by the model then
    drives the robot away from its reference.
    """
    warnings = find_payload_warnings(name, inertia)
    if not warnings or inertia.mass <= 0:
        return "".join(warnings[:1])
    moments = np.linalg.eigvalsh(inertia.central_moments)
    largest = max(np.abs(moments).max(), np.abs(inertia.second_moments).max())
    return "" if moments[0] >= -INERTIA_TOLERANCE * largest else warnings[0]


def find_payload_warnings(name: str, inertia: Inertia) -> list[str]:
    """Return sentences about a payload that no physical body is; name: of the frame that carries it."""
    if inertia.has_symbols:
        return []
    warnings = [f"payload on link {name!r}: {objection}" for objection in inertia.find_inconsistencies()]
    if warnings and inertia.mass > 0 and not np.any(inertia.second_moments):
        second_moments = point_mass(inertia.mass, inertia.first_moments).second_moments
        entries = [float(f"{entry:.4g}") + 0.0 for entry in symmetric_entries(second_moments)]
        warnings[0] += (
            ". Its second moments about the origin of the frame are zero: those of a point mass at its centre are "
            f"xx, xy, xz, yy, yz, zz = {entries} kg m²"
        )
    return warnings
