"""Sections of beams by their outlines. Dimensions [m] are along the axes y and z of the beam."""

import math
from collections.abc import Callable

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.beam import Section

SERIES_TERMS = 20  # of a series that decreases as n⁻⁵


def rectangle(y: float, z: float) -> Section:
    """Return the section of a solid rectangle, y by z.

    Torsion: Saint-Venant's series (Timoshenko, Goodier, Theory of Elasticity, §109).
    """
    _check_dimensions("a rectangle", y=y, z=z)
    b, a = sorted((y, z))
    waves = sum(math.tanh(n * math.pi * a / (2 * b)) / n**5 for n in range(1, 2 * SERIES_TERMS, 2))
    torsion = a * b**3 * (1 / 3 - 64 / math.pi**5 * b / a * waves)
    return Section(y * z, y * z**3 / 12, z * y**3 / 12, torsion)


def circle(diameter: float) -> Section:
    """Return the section of a solid circle."""
    return tube(diameter, diameter / 2)


def tube(diameter: float, wall: float) -> Section:
    """Return the section of a round tube with an outer diameter and a wall of at most half of it."""
    _check_dimensions("a tube", diameter=diameter, wall=wall)
    if wall > diameter / 2:
        raise DescriptionError(f"a tube of {diameter:g} m has a wall of {wall:g} m: the maximum is half the diameter")
    inner = diameter - 2 * wall
    second = math.pi / 64 * (diameter**4 - inner**4)
    return Section(math.pi / 4 * (diameter**2 - inner**2), second, second, 2 * second)


def _check_dimensions(owner: str, **dimensions: float) -> None:
    """Raise DescriptionError unless all dimensions are finite and positive."""
    for name, value in dimensions.items():
        if not (math.isfinite(value) and value > 0):
            raise DescriptionError(f"{name} of {owner} is {value:g} m: it must be positive")


SECTION_SHAPES: dict[str, tuple[Callable[..., Section], tuple[str, ...]]] = {
    "rectangle": (rectangle, ("y", "z")),
    "circle": (circle, ("diameter",)),
    "tube": (tube, ("diameter", "wall")),
}
"""{name of the shape: (function that returns the Section, names of its dimensions)}"""
