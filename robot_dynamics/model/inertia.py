"""Mass properties of a rigid body about the origin of a frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.errors import DescriptionError

# descriptions print few digits: a flat plate of which each moment is rounded may miss the triangle inequality by this
TRIANGLE_TOLERANCE = 1e-3


def skew(vector):
    """The matrices (..., 3, 3) of the vector product with `vector` (..., 3): skew(a) @ b = a × b."""
    x, y, z = vector[..., 0], vector[..., 1], vector[..., 2]
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


# where the entries of a symmetric matrix stand, in the order in which they are always told
INERTIA_ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}


def symmetric_matrix(xx, xy, xz, yy, yz, zz):
    """Symmetric matrices (..., 3, 3) of their entries (...)."""
    entries = np.broadcast_arrays(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    return np.stack(entries, axis=-1).reshape(*entries[0].shape, 3, 3)


def symmetric_entries(matrix):
    """xx, xy, xz, yy, yz, zz of symmetric matrices (..., 3, 3)."""
    return tuple(matrix[..., row, column] for row, column in INERTIA_ENTRIES.values())


@dataclass(frozen=True, eq=False)
class Inertia:
    """The ten standard inertial parameters of a body, about the origin of its frame and along its axes.

    mass: M [kg]. first_moments: MS = M·c (3,) [kg m], c the centre of mass. second_moments: J (3, 3) [kg m²].

    Raises DescriptionError for another shape, for what is no number, and for a J that is not symmetric.
    """

    mass: float = 0.0
    first_moments: np.ndarray = (0.0, 0.0, 0.0)
    second_moments: np.ndarray = ((0.0,) * 3,) * 3

    def __post_init__(self):
        for name, shape in (("mass", ()), ("first_moments", (3,)), ("second_moments", (3, 3))):
            try:
                value = np.array(getattr(self, name))
            except ValueError:
                value = np.array("ragged")
            if value.shape != shape or value.dtype.kind not in "biufO":  # O: symbols
                raise DescriptionError(f"{name} of an inertia is {getattr(self, name)!r}: numbers {shape} are needed")
            if name != "mass":
                object.__setattr__(self, name, value)
        J = self.second_moments
        if J.dtype != object and np.abs(J - J.T).max() > 1e-9 * np.abs(J).max():
            raise DescriptionError(f"second_moments of an inertia are {J.tolist()}: a symmetric matrix is needed")

    @classmethod
    def about_centre_of_mass(cls, mass, inertia, frame):
        """From the mass [kg] and the inertia (3, 3) [kg m²] about the centre of mass, where `frame` (4, 4) places a
        frame with its origin in the centre of mass and the axes of `inertia`, as URDF does."""
        return cls(mass, np.zeros(3), inertia).transformed_by(frame)

    def transformed_by(self, placement):
        """The same body about the frame i in which `placement`, iTj (4, 4), places the frame j of this inertia."""
        R, P = placement[:3, :3], placement[:3, 3]
        first, second = R @ self.first_moments, R @ self.second_moments @ R.T
        offset, moment = skew(P), skew(first)
        # parallel axes for a point that is not the centre of mass: J_i = R J Rᵀ − P̂ M̂S − M̂S P̂ − M P̂ P̂
        second = second - offset @ moment - moment @ offset - self.mass * offset @ offset
        return Inertia(self.mass, first + self.mass * P, (second + second.T) / 2)

    def __add__(self, other):
        return Inertia(
            self.mass + other.mass,
            self.first_moments + other.first_moments,
            self.second_moments + other.second_moments,
        )

    @cached_property
    def spatial(self):
        """The (6, 6) inertia that maps [V̇; ω̇] of the frame's origin to [force; moment] there (Khalil, section 3)."""
        MS = skew(self.first_moments)
        return np.block([[self.mass * np.eye(3), -MS], [MS, self.second_moments]])

    @cached_property
    def is_finite(self):
        return self.has_symbols or bool(np.isfinite(self.spatial).all())

    @cached_property
    def has_symbols(self):
        """Whether some of the numbers have no value yet."""
        return self.spatial.dtype == object

    @property
    def is_moment_about_z(self):
        """Whether nothing is there but a positive moment of inertia about the z axis."""
        others = np.delete(self.spatial.ravel(), -1)
        return bool(self.second_moments[2, 2] > 0 and not np.any(others))

    def find_inconsistencies(self):
        """Why no real body has these parameters: a list of sentences, empty for a body that can exist."""
        if self.mass < 0:
            return [f"mass {self.mass:g} kg is negative"]
        if self.mass == 0:
            if np.any(self.first_moments) or np.any(self.second_moments):
                return ["mass is zero but moments are not"]
            return []
        offset = skew(self.first_moments / self.mass)
        central = self.second_moments + self.mass * offset @ offset
        rounding = 1e-12 * max(np.abs(central).max(), np.abs(self.second_moments).max())
        smallest, middle, largest = np.linalg.eigvalsh(central)
        moments = f"principal moments about the centre of mass {smallest:.4g}, {middle:.4g}, {largest:.4g} kg m²"
        if smallest < -rounding:
            return [f"inertia is not positive definite: {moments}"]
        if largest > (smallest + middle) * (1 + TRIANGLE_TOLERANCE) + rounding:
            return [f"inertia violates the triangle inequality: {moments}"]
        return []
