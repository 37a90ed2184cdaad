"""Text of maps over poses: their titles and axes."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.parallel.pose_map import COORDINATE_UNITS

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence


def map_title(name: str, fixed_coordinates: Mapping[str, float], acceleration: Sequence[float] | None = None) -> str:
    """Return the title of a pose map: the robot, the coordinates that do not vary, and the acceleration.

    Parameters
    ----------
    name : str
        Name of the robot; empty: without it.
    fixed_coordinates : mapping of str to float
        [m or rad].
    acceleration : (6,) sequence of float, optional
        Of the platform [m/s², rad/s²]. Default: at rest.
    """
    fixed = fixed_text(fixed_coordinates)
    title = (f"{name}: " if name else "") + "platform" + (f" at {fixed}; " if fixed else ", ")
    if acceleration is None or not np.any(acceleration):
        return title + "at rest"
    return title + "accelerated by " + " ".join(f"{value:g}" for value in acceleration) + " m/s², rad/s²"


def fixed_text(fixed_coordinates: Mapping[str, float]) -> str:
    """Return the coordinates that do not vary, with their units."""
    return ", ".join(
        f"{name} = {round(value, 9) + 0.0:.4g} {COORDINATE_UNITS[name]}" for name, value in fixed_coordinates.items()
    )


def axis_label(coordinate: str) -> str:
    """Return the name of a coordinate with its unit."""
    return f"{coordinate} [{COORDINATE_UNITS[coordinate]}]"
