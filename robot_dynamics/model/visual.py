"""Visual geometry: the shapes that a viewer draws for the links of a robot. The dynamics do not depend on it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

if TYPE_CHECKING:
    from pathlib import Path

    from robot_dynamics.array_types import Array


@dataclass(frozen=True, eq=False)
class BoxShape:
    """A box whose centre is the origin.

    Attributes
    ----------
    size : (3,) array
        Lengths of the edges along x, y and z [m].
    """

    size: Array


@dataclass(frozen=True)
class CylinderShape:
    """A cylinder along z whose centre is the origin.

    Attributes
    ----------
    radius, length : float
        Radius, and length along z [m].
    """

    radius: float
    length: float


@dataclass(frozen=True)
class SphereShape:
    """A sphere whose centre is the origin.

    Attributes
    ----------
    radius : float
        Radius [m].
    """

    radius: float


@dataclass(frozen=True, eq=False)
class MeshShape:
    """A mesh in a file, which is not read before a viewer needs it.

    Attributes
    ----------
    file : str
        Name of the file as the description writes it: a path, or `package://`, `file://` and a path.
    scale : (3,) array
        Factors of the coordinates of the mesh along x, y and z. A negative factor mirrors the mesh.
    folder : Path or None
        Folder of the file of the description, in which a relative path begins; None where the description is a text
        without a file.
    """

    file: str
    scale: Array
    folder: Path | None


@dataclass(frozen=True, eq=False)
class HullShape:
    """The convex hull of balls: a rod with round ends for two points, a plate for three or more.

    Formats without such a shape have the primitives of `hull_primitives` in its place.

    Attributes
    ----------
    points : (n, 3) array
        Centres of the balls [m].
    radius : float
        Radius of the balls [m].
    """

    points: Array
    radius: float


Shape: TypeAlias = BoxShape | CylinderShape | SphereShape | MeshShape | HullShape


@dataclass(frozen=True, eq=False)
class Visual:
    """A shape that is fixed to a named frame.

    Attributes
    ----------
    frame : str
        Name of the frame.
    placement : (4, 4) array
        Placement of the shape in that frame.
    shape : BoxShape, CylinderShape, SphereShape, MeshShape or HullShape
        The shape.
    colour : tuple of float or None
        Red, green, blue and opacity, each from 0 to 1; None where the description has no colour of its own.
    name : str or None
        Name of the visual, None where it has none.
    """

    frame: str
    placement: Array
    shape: Shape
    colour: tuple[float, float, float, float] | None = None
    name: str | None = None
