"""Links that bend, as data: beams, what they are made of, and the rigid bodies that they carry (Briot, section 2).

A beam is straight and uniform. Its frame has x along it, y and z along the principal axes of its section:
second_moment_z resists bending in its x-y plane, second_moment_y in its x-z plane.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.model.inertia import Inertia
from robot_dynamics.model.joint import check_placement
from robot_dynamics.model.placement import placement

COINCIDENCE_TOLERANCE = 1e-9  # [m] within which two points of a link are one
MAX_ELEMENTS = 1000  # of a beam


@dataclass(frozen=True)
class Material:
    """youngs_modulus: E, shear_modulus: G [Pa]; density: ρ [kg/m³]. Raises DescriptionError unless E, G > 0, ρ ≥ 0."""

    youngs_modulus: float
    shear_modulus: float
    density: float

    def __post_init__(self):
        _check(self, "a material", may_be_zero=("density",))

    @classmethod
    def isotropic(cls, youngs_modulus, poissons_ratio, density):
        """With G = E / 2(1 + ν)."""
        if not -1 < poissons_ratio <= 0.5:
            raise DescriptionError(f"poissons_ratio of a material is {poissons_ratio:g}: it lies between -1 and 0.5")
        return cls(youngs_modulus, youngs_modulus / (2 * (1 + poissons_ratio)), density)


@dataclass(frozen=True)
class Section:
    """Of a beam: area: A [m²]; second_moment_y, second_moment_z: I_y = ∫z² dA, I_z = ∫y² dA; torsion_constant: I_0,
    which with G resists twisting; polar_moment: I_p, which with ρ is the inertia against it, I_y + I_z [m⁴].

    Raises DescriptionError unless all are positive.
    """

    area: float
    second_moment_y: float
    second_moment_z: float
    torsion_constant: float
    polar_moment: float | None = None

    def __post_init__(self):
        if self.polar_moment is None:
            object.__setattr__(self, "polar_moment", self.second_moment_y + self.second_moment_z)
        _check(self, "a section")


def _check(thing, what, may_be_zero=()):
    for field in fields(thing):
        value = getattr(thing, field.name)
        enough = value >= 0 if field.name in may_be_zero else value > 0
        if not (np.isfinite(value) and enough):
            need = "zero or more" if field.name in may_be_zero else "positive"
            raise DescriptionError(f"{field.name} of {what} is {value:g}: it must be {need}")


@dataclass(frozen=True, eq=False)
class Beam:
    """start: (4, 4) placement of the beam's frame in that of its link, its origin at the beginning of the beam; length
    [m]; elements: into how many of equal length it is cut; rotary_inertia: whether its sections resist being turned by
    bending (Rayleigh's beam) or not (that of Euler and Bernoulli)."""

    placement: np.ndarray
    length: float
    section: Section
    material: Material
    elements: int = 1
    rotary_inertia: bool = True

    def __post_init__(self):
        check_placement("a beam", self.placement)
        if not (np.isfinite(self.length) and self.length > 0):
            raise DescriptionError(f"a beam is {self.length:g} m long: its ends must be apart")
        if not 1 <= self.elements <= MAX_ELEMENTS or self.elements != int(self.elements):
            raise DescriptionError(f"a beam has {self.elements:g} elements: 1 to {MAX_ELEMENTS} are right")

    @classmethod
    def between(cls, start, end, section, material, y=None, **options):
        """From point `start` to point `end`, (3,) [m] in the frame of the link.

        y: (3,) a direction to which the section's y is as near as it can be; left out: z is as near as can be to the
        z axis of the link, or where the beam is along that, y to its y axis.
        """
        start, end = np.array(start, dtype=float), np.array(end, dtype=float)
        along, length = end - start, float(np.linalg.norm(end - start))
        if not length > 0:
            raise DescriptionError("a beam is 0 m long: its ends must be apart")
        x = along / length
        if y is None:
            upright = abs(x[2]) > 1 - 1e-12
            near = np.cross([0.0, 0.0, 1.0], x) if not upright else np.array([0.0, 1.0, 0.0])
        else:
            near = np.array(y, dtype=float)
        across = near - x * (near @ x)
        if not np.linalg.norm(across) > 1e-6 * np.linalg.norm(near):
            raise DescriptionError("the y axis of a beam's section is along the beam: it must lie across it")
        across /= np.linalg.norm(across)
        rotation = np.column_stack([x, across, np.cross(x, across)])
        return cls(placement(rotation + 0.0, start), length, section, material, **options)

    @property
    def end(self):
        """(3,) the point of its other end, in the frame of the link."""
        return self.point(1.0)

    def point(self, share):
        """(3,) the point at a share of its length, in the frame of the link."""
        return self.placement[:3, 3] + share * self.length * self.placement[:3, 0]

    @property
    def inertia(self):
        """The Inertia of the beam while it is straight, in the frame of its link."""
        section, density = self.section, self.material.density
        mass = density * section.area * self.length
        bending = float(self.rotary_inertia) * np.array([section.second_moment_y, section.second_moment_z])
        central = np.array([section.polar_moment, *bending])
        central = density * self.length * central + mass * self.length**2 / 12 * np.array([0, 1, 1])
        centre = self.placement @ placement(translation=[self.length / 2, 0, 0])
        return Inertia.about_centre_of_mass(mass, np.diag(central), centre)

    def transformed_by(self, matrix):
        """The same beam in the frame in which `matrix` (4, 4) places that of its link."""
        return replace(self, placement=matrix @ self.placement)


@dataclass(frozen=True, eq=False)
class RigidBody:
    """A rigid body on a link that bends: point: (3,) where it is fastened, in the frame of the link [m]; inertia: about
    the origin of that frame."""

    point: np.ndarray
    inertia: Inertia

    def transformed_by(self, matrix):
        return RigidBody(matrix[:3, :3] @ self.point + matrix[:3, 3], self.inertia.transformed_by(matrix))


@dataclass(frozen=True, eq=False)
class Flexibility:
    """What of a link bends. beams: each begins at the origin of the link's frame or on a beam before it, the first
    anywhere; bodies: what they carry. Raises DescriptionError where a beam begins elsewhere."""

    beams: tuple[Beam, ...]
    bodies: tuple[RigidBody, ...] = ()

    def __post_init__(self):
        for number, beam in enumerate(self.beams):
            start = beam.placement[:3, 3]
            before = self.beams[:number]
            reached = (
                number == 0
                or not np.any(np.abs(start) > COINCIDENCE_TOLERANCE)
                or any(locate_on_beam(b, start) for b in before)
            )
            if not reached:
                raise DescriptionError(
                    f"beam {number + 1} begins at {start.tolist()}, where nothing is: it begins at the origin of the "
                    "link's frame or on a beam before it"
                )

    @property
    def inertia(self):
        """The Inertia of the link while it is straight."""
        return sum((part.inertia for part in (*self.beams, *self.bodies)), Inertia())

    def transformed_by(self, matrix):
        """The same in the frame in which `matrix` (4, 4) places that of the link."""
        return Flexibility(
            *(tuple(part.transformed_by(matrix) for part in parts) for parts in (self.beams, self.bodies))
        )

    def with_body(self, body):
        return replace(self, bodies=(*self.bodies, body))


def locate_on_beam(beam, point):
    """The share of a Beam's length at which a point (3,) of the link's frame lies on it; None if it does not."""
    along, *across = beam.placement[:3, :3].T @ (point - beam.placement[:3, 3])
    if (
        np.hypot(*across) > COINCIDENCE_TOLERANCE
        or not -COINCIDENCE_TOLERANCE <= along <= beam.length + COINCIDENCE_TOLERANCE
    ):
        return None
    return float(np.clip(along / beam.length, 0.0, 1.0))
