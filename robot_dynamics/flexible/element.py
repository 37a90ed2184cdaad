"""The beam element in Rayleigh-Ritz form: it moves with the twist of its beginning, and its end moves besides.

t = [v; ω] (6,) is the twist of the beginning, q_e (6,) the elastic coordinates: by how much the end moves and turns
against where the beginning alone would have taken it, both in the axes of the element, x along it. Between the two,
displacements of the straight beam are interpolated by its shape functions Φ: linear along x and in torsion, cubic in
bending, without shear (Briot, eq. 1 and 2).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from robot_dynamics.model.beam import Material, Section

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Of Gauss and Legendre on [-1, 1]: exact for products of two cubics."""
MASS_POINTS, MASS_WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Where the mass of a bent element is gathered: exact for the squared shortening, of degree ten."""


@dataclass(frozen=True, eq=False)
class Sections:
    """Of an Element, those in which its mass is gathered, and last its end: p of them.

    distances: (p,) [m] from the beginning; shapes: (p, 6, 6) from q_e to displacement and rotation; shortenings: (p, 6,
    6) S, the section coming nearer to the beginning by ½ q_eᵀ S q_e as the beam bends; inertias: (p - 1, 6, 6), of all
    but the end, in their own axes.
    """

    distances: np.ndarray
    shapes: np.ndarray
    shortenings: np.ndarray
    inertias: np.ndarray


@dataclass(frozen=True, eq=False)
class Element:
    """A piece of a beam, of a length [m]; rotary_inertia: as of Beam."""

    length: float
    section: Section
    material: Material
    rotary_inertia: bool = True

    def section_jacobian(self, length_fraction):
        """(6, 12) from [t; q_e] to the twist of the section at a share of the length, at its centre."""
        L, s = self.length, length_fraction
        bend, turn = (3 - 2 * s) * s**2, L * (s - 1) * s**2  # deflection by that of the end, and by its turning
        slope, twist = 6 * s * (1 - s) / L, (3 * s - 2) * s  # their derivatives along x
        # x         y           z           about x, y, z
        rigid = np.eye(6)
        rigid[1, 5], rigid[2, 4] = s * L, -s * L
        elastic = np.diag([s, bend, bend, s, twist, twist])
        elastic[1, 5], elastic[5, 1] = turn, slope
        elastic[2, 4], elastic[4, 2] = -turn, -slope
        return np.hstack([rigid, elastic])

    @property
    def mass_per_metre(self):
        """(6,) of a section, against its displacement and its turning [kg/m, kg m]."""
        section, density = self.section, self.material.density
        bending = float(self.rotary_inertia)
        turning = [section.polar_moment, bending * section.second_moment_y, bending * section.second_moment_z]
        return density * np.array([*[section.area] * 3, *turning])

    @cached_property
    def mass(self):
        """(12, 12) the generalized mass matrix of [t; q_e]: kinetic energy is half of its quadratic form."""
        total = np.zeros((12, 12))
        for point, weight in zip(GAUSS_POINTS, GAUSS_WEIGHTS, strict=True):
            moved = self.section_jacobian((1 + point) / 2)
            total += weight / 2 * self.length * moved.T @ (self.mass_per_metre[:, None] * moved)
        return (total + total.T) / 2

    @cached_property
    def sections(self):
        """The Sections at the points of Gauss and Legendre, which at rest have just the `mass` of the element."""
        shares = np.append((1 + MASS_POINTS) / 2, 1.0)
        return Sections(
            shares * self.length,
            np.array([self.section_jacobian(length_fraction)[:, 6:] for length_fraction in shares]),
            np.array([self._shortening(length_fraction) for length_fraction in shares]),
            (MASS_WEIGHTS * self.length / 2)[:, None, None] * np.diag(self.mass_per_metre),
        )

    def _shortening(self, length_fraction):
        """(6, 6) ∫ v'ᵀ v' + w'ᵀ w' dx up to a share of the length, of rows v' and w' of the shape functions."""
        total = np.zeros((6, 6))
        for point, weight in zip(GAUSS_POINTS, GAUSS_WEIGHTS, strict=True):
            slopes = self.section_jacobian(length_fraction * (1 + point) / 2)[4:6, 6:]
            total += weight / 2 * length_fraction * self.length * slopes.T @ slopes
        return total

    @cached_property
    def stiffness(self):
        """(6, 6) the stiffness matrix of q_e: strain energy is half of its quadratic form."""
        L, E, G, section = self.length, self.material.youngs_modulus, self.material.shear_modulus, self.section
        y, z = E * section.second_moment_y, E * section.second_moment_z
        stretch, torsion = E * section.area / L, G * section.torsion_constant / L
        matrix = np.diag([stretch, 12 * z / L**3, 12 * y / L**3, torsion, 4 * y / L, 4 * z / L])
        matrix[1, 5] = matrix[5, 1] = -6 * z / L**2
        matrix[2, 4] = matrix[4, 2] = 6 * y / L**2
        return matrix
