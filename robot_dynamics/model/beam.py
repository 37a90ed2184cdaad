"""Flexible links as data: beams, their sections and materials, and the rigid bodies on them (Briot, section 2).

A beam is straight and uniform. Its frame has x along it, y and z along the principal axes of its section:
second_moment_z resists bending in its x-y plane, second_moment_y in its x-z plane.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import check_placement
from robot_dynamics.model.placement import placement

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, ArrayLike, BoolArray, ScalarArray

COINCIDENCE_TOLERANCE = 1e-9  # [m] points of a link that are this near coincide
MAX_ELEMENTS = 1000  # of a beam


@dataclass(frozen=True)
class Material:
    """A linear elastic, isotropic material. Raises DescriptionError unless E, G > 0 and ρ ≥ 0.

    Attributes
    ----------
    youngs_modulus : float
        E [Pa].
    shear_modulus : float
        G [Pa].
    density : float
        ρ [kg/m³].
    """

    youngs_modulus: float
    shear_modulus: float
    density: float

    def __post_init__(self) -> None:
        _check_values(self, "a material", may_be_zero=("density",))

    @classmethod
    def isotropic(cls, youngs_modulus: float, poissons_ratio: float, density: float) -> Material:
        """Return the material with G = E / 2(1 + ν)."""
        if not -1 < poissons_ratio <= 0.5:
            raise DescriptionError(f"poissons_ratio of a material is {poissons_ratio:g}: it lies between -1 and 0.5")
        return cls(youngs_modulus, youngs_modulus / (2 * (1 + poissons_ratio)), density)


@dataclass(frozen=True)
class Section:
    """The cross-section of a beam. Raises DescriptionError unless all values are positive.

    Attributes
    ----------
    area : float
        A [m²].
    second_moment_y, second_moment_z : float
        I_y = ∫z² dA and I_z = ∫y² dA [m⁴].
    torsion_constant : float
        I_0 [m⁴], the torsional stiffness of the section divided by G.
    polar_moment : float, optional
        I_p [m⁴], the moment of inertia about x per length divided by ρ. Default: I_y + I_z.
    """

    area: float
    second_moment_y: float
    second_moment_z: float
    torsion_constant: float
    polar_moment: float = None  # type: ignore[assignment]  # __post_init__ replaces None by I_y + I_z

    def __post_init__(self) -> None:
        if vars(self)["polar_moment"] is None:
            object.__setattr__(self, "polar_moment", self.second_moment_y + self.second_moment_z)
        _check_values(self, "a section")


def _check_values(instance: Material | Section, owner: str, may_be_zero: tuple[str, ...] = ()) -> None:
    """Raise DescriptionError unless all values of a material or section are finite and positive."""
    for field in fields(instance):
        value = getattr(instance, field.name)
        in_range = value >= 0 if field.name in may_be_zero else value > 0
        if not (np.isfinite(value) and in_range):
            need = "zero or more" if field.name in may_be_zero else "positive"
            raise DescriptionError(f"{field.name} of {owner} is {value:g}: it must be {need}")


@dataclass(frozen=True, eq=False)
class Beam:
    """A straight, uniform beam of a link.

    Attributes
    ----------
    placement : (4, 4) array
        Frame of the beam in the frame of its link, with the origin at the start of the beam.
    length : float
        Length [m].
    section : Section
        Cross-section.
    material : Material
        Material.
    elements : int
        Number of finite elements, all of equal length.
    rotary_inertia : bool
        Whether bending turns the sections against their inertia (Rayleigh beam), or not (Euler-Bernoulli beam).
    """

    placement: ScalarArray
    length: float
    section: Section
    material: Material
    elements: int = 1
    rotary_inertia: bool = True

    def __post_init__(self) -> None:
        check_placement("a beam", self.placement)
        if not (np.isfinite(self.length) and self.length > 0):
            raise DescriptionError(f"a beam is {self.length:g} m long: its ends must be apart")
        if not 1 <= self.elements <= MAX_ELEMENTS or self.elements != int(self.elements):
            raise DescriptionError(f"a beam has {self.elements:g} elements: 1 to {MAX_ELEMENTS} are allowed")

    @classmethod
    def between(
        cls,
        start: ArrayLike,
        end: ArrayLike,
        section: Section,
        material: Material,
        y: ArrayLike | None = None,
        *,
        elements: int = 1,
        rotary_inertia: bool = True,
    ) -> Beam:
        """Return the beam between two points.

        Parameters
        ----------
        start, end : (3,) array_like
            End points in the frame of the link [m].
        section, material : Section, Material
            Cross-section and material.
        y : (3,) array_like, optional
            Direction to which the section's y is as near as possible. Default: the section's z is as near as possible
            to the z axis of the link; where the beam is along that axis, its y to the y axis of the link.
        elements, rotary_inertia : int, bool
            As the attributes.
        """
        start_point = np.array(start, dtype=float)
        end_point = np.array(end, dtype=float)
        along = end_point - start_point
        length = float(np.linalg.norm(end_point - start_point))
        if not length > 0:
            raise DescriptionError("a beam is 0 m long: its ends must be apart")
        x = along / length
        across = _direction_across(x, y)
        rotation = np.column_stack([x, across, np.cross(x, across)])
        return cls(placement(rotation + 0.0, start_point), length, section, material, elements, rotary_inertia)

    @property
    def end(self) -> Array:
        """End point (3,) in the frame of the link [m]."""
        return self.point_at(1.0)

    def point_at(self, fraction: float) -> Array:
        """Return the point (3,) at a fraction of the length, in the frame of the link [m]."""
        point: Array = self.placement[:3, 3] + fraction * self.length * self.placement[:3, 0]
        return point

    @property
    def inertia(self) -> Inertia:
        """Inertia of the undeformed beam, in the frame of its link."""
        section = self.section
        density = self.material.density
        mass = density * section.area * self.length
        bending = float(self.rotary_inertia) * np.array([section.second_moment_y, section.second_moment_z])
        central = np.array([section.polar_moment, *bending])
        central = density * self.length * central + mass * self.length**2 / 12 * np.array([0, 1, 1])
        centre = self.placement @ placement(translation=[self.length / 2, 0, 0])
        return Inertia.about_centre_of_mass(mass, np.diag(central), centre)

    def transformed_by(self, matrix: ScalarArray) -> Beam:
        """Return the same beam in the frame i in which `matrix`, iTj (4, 4), places the frame of its link."""
        return replace(self, placement=matrix @ self.placement)


def _direction_across(x: Array, y: ArrayLike | None) -> Array:
    """Return the y axis (3,) of a beam along x (3,), nearest to `y` (3,); None: as `Beam.between` states."""
    if y is not None:
        preferred = np.array(y, dtype=float)
    elif abs(x[2]) > 1 - 1e-12:
        preferred = np.array([0.0, 1.0, 0.0])
    else:
        preferred = np.cross([0.0, 0.0, 1.0], x)
    across: Array = preferred - x * (preferred @ x)
    if not np.linalg.norm(across) > 1e-6 * np.linalg.norm(preferred):
        raise DescriptionError("the y axis of a beam's section is along the beam: it must lie across it")
    across /= np.linalg.norm(across)
    return across


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body on a flexible link.

    Attributes
    ----------
    point : (3,) array
        Point at which the body is fixed, in the frame of the link [m].
    inertia : Inertia
        Inertia about the origin of the frame of the link.
    """

    point: ScalarArray
    inertia: Inertia

    def transformed_by(self, matrix: ScalarArray) -> RigidBody:
        """Return the same body in the frame i in which `matrix`, iTj (4, 4), places the frame of its link."""
        return RigidBody(matrix[:3, :3] @ self.point + matrix[:3, 3], self.inertia.transformed_by(matrix))


@dataclass(frozen=True, eq=False)
class Flexibility:
    """The beams of a flexible link and the rigid bodies on them.

    Attributes
    ----------
    beams : tuple of Beam
        The first begins anywhere, each other one at the origin of the link's frame or on a beam before it. A beam
        that begins elsewhere raises DescriptionError.
    bodies : tuple of RigidBody
        Rigid bodies fixed to the beams.
    """

    beams: tuple[Beam, ...]
    bodies: tuple[RigidBody, ...] = ()

    def __post_init__(self) -> None:
        geometry = BeamGeometry()
        for beam in self.beams:
            geometry.add(beam)

    @property
    def inertia(self) -> Inertia:
        """Inertia of the undeformed link."""
        inertias = [beam.inertia for beam in self.beams] + [body.inertia for body in self.bodies]
        return sum(inertias, Inertia())

    def transformed_by(self, matrix: ScalarArray) -> Flexibility:
        """Return the same flexibility in the frame i in which `matrix`, iTj (4, 4), places the frame of the link."""
        beams = tuple(beam.transformed_by(matrix) for beam in self.beams)
        bodies = tuple(body.transformed_by(matrix) for body in self.bodies)
        return Flexibility(beams, bodies)

    def with_body(self, body: RigidBody) -> Flexibility:
        """Return the same flexibility with one more rigid body."""
        return replace(self, bodies=(*self.bodies, body))


class BeamGeometry:
    """Where the beams of a link are, to check one after the other that it begins on those before it."""

    def __init__(self) -> None:
        self._count = 0
        self._starts = np.empty((8, 3))
        self._rotations = np.empty((8, 3, 3))
        self._lengths = np.empty(8)

    def add(self, beam: Beam) -> None:
        """Add a beam. Raises DescriptionError if it begins neither at the origin nor on a beam before it."""
        count = self._count
        start = beam.placement[:3, 3]
        if count and np.any(np.abs(start) > COINCIDENCE_TOLERANCE):
            offsets = start - self._starts[:count]
            if not _are_on(self._rotations[:count], offsets, self._lengths[:count]).any():
                raise DescriptionError(
                    f"beam {count + 1} begins at {start.tolist()}, which is on no beam: it must begin at the origin "
                    "of the link's frame or on a beam before it"
                )
        if count == len(self._lengths):
            self._starts = np.concatenate([self._starts, self._starts])
            self._rotations = np.concatenate([self._rotations, self._rotations])
            self._lengths = np.concatenate([self._lengths, self._lengths])
        self._starts[count] = start
        self._rotations[count] = beam.placement[:3, :3]
        self._lengths[count] = beam.length
        self._count += 1


def locate_on_beam(beam: Beam, point: ScalarArray) -> float | None:
    """Return the fraction of a beam's length at which a point (3,) of the link's frame lies on it, else None."""
    rotation = beam.placement[:3, :3]
    offset = point - beam.placement[:3, 3]
    if not _are_on(rotation, offset, np.asarray(beam.length)):
        return None
    return float(np.clip(rotation[:, 0] @ offset / beam.length, 0.0, 1.0))


def _are_on(rotations: ScalarArray, offsets: ScalarArray, lengths: Array) -> BoolArray:
    """Whether points lie on beams (...): rotations (..., 3, 3), offsets (..., 3) from their starts, lengths (...)."""
    along, y, z = np.moveaxis((np.swapaxes(rotations, -1, -2) @ offsets[..., None])[..., 0], -1, 0)
    is_near = np.hypot(y, z) <= COINCIDENCE_TOLERANCE
    is_between = (-COINCIDENCE_TOLERANCE <= along) & (along <= lengths + COINCIDENCE_TOLERANCE)
    on: BoolArray = is_near & is_between
    return on
