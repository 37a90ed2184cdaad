"""Sections of beams by their outlines. Sizes [m] are along the axes y and z of the beam."""

import math

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.beam import Section

SERIES_TERMS = 20  # of a series that falls as n⁻⁵


def rectangle(y, z):
    """A solid rectangle, y by z. Torsion: Saint-Venant's series (Timoshenko, Goodier, Theory of Elasticity, §109)."""
    _check("a rectangle", y=y, z=z)
    b, a = sorted((y, z))
    waves = sum(math.tanh(n * math.pi * a / (2 * b)) / n**5 for n in range(1, 2 * SERIES_TERMS, 2))
    torsion = a * b**3 * (1 / 3 - 64 / math.pi**5 * b / a * waves)
    return Section(y * z, y * z**3 / 12, z * y**3 / 12, torsion)


def circle(diameter):
    """A solid circle."""
    return tube(diameter, diameter / 2)


def tube(diameter, wall):
    """A round tube of an outer diameter; its wall is at most half of it."""
    _check("a tube", diameter=diameter, wall=wall)
    if wall > diameter / 2:
        raise DescriptionError(f"a tube of {diameter:g} m has a wall of {wall:g} m: at most half of it is right")
    inner = diameter - 2 * wall
    second = math.pi / 64 * (diameter**4 - inner**4)
    return Section(math.pi / 4 * (diameter**2 - inner**2), second, second, 2 * second)


def _check(what, **sizes):
    for name, size in sizes.items():
        if not (math.isfinite(size) and size > 0):
            raise DescriptionError(f"{name} of {what} is {size:g} m: it must be positive")


SECTION_SHAPES = {
    "rectangle": (rectangle, ("y", "z")),
    "circle": (circle, ("diameter",)),
    "tube": (tube, ("diameter", "wall")),
}
"""By name: what makes the Section, and the names of its sizes."""
