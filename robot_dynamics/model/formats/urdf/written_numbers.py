"""Numbers and placements as attributes of a URDF, with no more digits than they have."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from lxml import etree

from robot_dynamics.model.mdh import ROUNDING, clean_angle
from robot_dynamics.model.placement import roll_pitch_yaw

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.array_types import Array, ScalarArray
    from robot_dynamics.model.formats.urdf.document import Element


def insert_origin(element: Element, matrix: Array, size: float) -> None:
    """Insert <origin> at a placement (4, 4) as the first child of an element, unless it is the identity.

    size: magnitude of the lengths from which the placement was computed.
    """
    xyz = write_vector(matrix[:3, 3], size)
    # without rounding errors roll is zero where pitch is a right angle
    roll, pitch, yaw = roll_pitch_yaw(np.where(np.abs(matrix[:3, :3]) <= ROUNDING, 0.0, matrix[:3, :3]))
    angles = [clean_angle(angle) for angle in (roll, pitch, yaw)]
    rpy = write_vector([math.pi if angle == -math.pi else angle for angle in angles], 1.0)
    if (xyz, rpy) != ("0 0 0", "0 0 0"):
        element.insert(0, etree.Element("origin", xyz=xyz, rpy=rpy))


def write_vector(values: Sequence[float] | ScalarArray, size: float = 0.0) -> str:
    """Return a vector as URDF writes it; size: magnitude of the numbers from which it was computed."""
    return " ".join(write_number(value, ROUNDING * size) for value in values)


def write_number(value: Any, rounding: float = 0.0) -> str:
    """Return the digits of a number that read back as it, or fewer digits that differ by at most `rounding`."""
    number = float(value)
    short = 0.0 if abs(number) <= rounding else float(f"{number:.12g}")
    if abs(number - short) <= rounding:
        number = short
    return repr(number).removesuffix(".0")
