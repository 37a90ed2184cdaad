"""Rigid shapes that are drawn with the links of a robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from trimesh import Trimesh

Colour: TypeAlias = tuple[int, int, int]
"""Red, green, blue, 0 to 255."""

BASE_COLOUR: Colour = (92, 99, 112)
LINK_COLOUR: Colour = (168, 178, 194)
PLATFORM_COLOUR: Colour = (222, 168, 72)
ACTUATED_COLOUR: Colour = (42, 111, 187)
PASSIVE_COLOUR: Colour = (226, 230, 236)
ELASTIC_COLOUR: Colour = (60, 160, 100)
SINGULAR_COLOUR: Colour = (204, 48, 48)


@dataclass(frozen=True, eq=False)
class Body:
    """A rigid shape that moves with a link.

    Attributes
    ----------
    name : str
        What it is, as the viewer shows it.
    link : int
        Number of the link.
    mesh : trimesh.Trimesh
        Surface [m], in the frame of the link.
    colour : Colour or None
        Colour of the surface; None where its faces have colours of their own.
    opacity : float
        0 to 1. Default: opaque.
    """

    name: str
    link: int
    mesh: Trimesh
    colour: Colour | None
    opacity: float = 1.0
