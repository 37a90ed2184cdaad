"""Doubtful payloads: those that no physical body is."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.model.inertia import symmetric_entries
from robot_dynamics.model.vector_product import skew

if TYPE_CHECKING:
    from robot_dynamics.model.inertia import Inertia


def find_payload_warnings(name: str, inertia: Inertia) -> list[str]:
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
