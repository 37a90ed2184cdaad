"""The beam element in Rayleigh-Ritz form: it moves with the twist of its start, and its end also moves elastically.

t = [v; ω] (6,) is the twist of the start, q_e (6,) the elastic coordinates: displacement and rotation of the end
relative to where the start alone would carry it, in the axes of the element, x along it. In between, displacements of
the straight beam are interpolated by its shape functions Φ: linear along x and in torsion, cubic in bending, without
shear (Briot, eq. 1 and 2).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.beam import Material, Section

GAUSS_POINTS, GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(4)
"""Gauss-Legendre rule on [-1, 1], exact for products of two cubic functions."""
MASS_POINTS, MASS_WEIGHTS = np.polynomial.legendre.leggauss(6)
"""Rule for the mass of a bent element, exact for the squared shortening, of degree ten."""


@dataclass(frozen=True, eq=False)
class Sections:
    """The p sections of an Element in which its mass is concentrated; the last is its end, without mass.

    distances: (p,) from the start [m]; shapes: (p, 6, 6) from q_e to displacement and rotation; shortenings: (p, 6, 6)
    S, with which bending moves the section towards the start by ½ q_eᵀ S q_e; inertias: (p - 1, 6, 6), of all but the
    end, in their own axes.
    """

    distances: Array
    shapes: Array
    shortenings: Array
    inertias: Array


@dataclass(frozen=True, eq=False)
class Element:
    """A part of a beam, length in m; rotary_inertia: as of Beam."""

    length: float
    section: Section
    material: Material
    rotary_inertia: bool = True

    def section_jacobian(self, length_fraction: float) -> Array:
        """Return (6, 12) from [t; q_e] to the twist of the section at a fraction of the length, at its centre."""
        L = self.length
        s = length_fraction
        # deflection for unit displacement and for unit rotation of the end, and their derivatives along x
        deflection = (3 - 2 * s) * s**2
        rotation_deflection = L * (s - 1) * s**2
        slope = 6 * s * (1 - s) / L
        rotation_slope = (3 * s - 2) * s
        rigid = np.eye(6)
        rigid[1, 5] = s * L
        rigid[2, 4] = -s * L
        elastic = np.diag([s, deflection, deflection, s, rotation_slope, rotation_slope])
        elastic[1, 5] = rotation_deflection
        elastic[5, 1] = slope
        elastic[2, 4] = -rotation_deflection
        elastic[4, 2] = -slope
        return np.hstack([rigid, elastic])

    @property
    def mass_per_metre(self) -> Array:
        """(6,) inertia of a section per length, against displacement and rotation [kg/m, kg m]."""
        section = self.section
        bending = float(self.rotary_inertia)
        moments = [section.polar_moment, bending * section.second_moment_y, bending * section.second_moment_z]
        inertias: Array = self.material.density * np.array([*[section.area] * 3, *moments])
        return inertias

    @cached_property
    def mass(self) -> Array:
        """(12, 12) generalized mass matrix of [t; q_e]: kinetic energy is half its quadratic form."""
        total = np.zeros((12, 12))
        for point, weight in zip(GAUSS_POINTS, GAUSS_WEIGHTS, strict=True):
            jacobian = self.section_jacobian((1 + point) / 2)
            total += weight / 2 * self.length * jacobian.T @ (self.mass_per_metre[:, None] * jacobian)
        mass: Array = (total + total.T) / 2
        return mass

    @cached_property
    def sections(self) -> Sections:
        """The Sections at the Gauss-Legendre points, which have the `mass` of the element at rest."""
        fractions = np.append((1 + MASS_POINTS) / 2, 1.0)
        return Sections(
            fractions * self.length,
            np.array([self.section_jacobian(fraction)[:, 6:] for fraction in fractions]),
            np.array([self._shortening(fraction) for fraction in fractions]),
            (MASS_WEIGHTS * self.length / 2)[:, None, None] * np.diag(self.mass_per_metre),
        )

    def _shortening(self, length_fraction: float) -> Array:
        """Return (6, 6) ∫ v'ᵀ v' + w'ᵀ w' dx up to a fraction of the length, of the rows v' and w' of the shapes."""
        total = np.zeros((6, 6))
        for point, weight in zip(GAUSS_POINTS, GAUSS_WEIGHTS, strict=True):
            slopes = self.section_jacobian(length_fraction * (1 + point) / 2)[4:6, 6:]
            total += weight / 2 * length_fraction * self.length * slopes.T @ slopes
        return total

    @cached_property
    def stiffness(self) -> Array:
        """(6, 6) stiffness matrix of q_e: strain energy is half its quadratic form."""
        L = self.length
        E = self.material.youngs_modulus
        G = self.material.shear_modulus
        EI_y = E * self.section.second_moment_y
        EI_z = E * self.section.second_moment_z
        axial = E * self.section.area / L
        torsion = G * self.section.torsion_constant / L
        matrix = np.diag([axial, 12 * EI_z / L**3, 12 * EI_y / L**3, torsion, 4 * EI_y / L, 4 * EI_z / L])
        matrix[1, 5] = matrix[5, 1] = -6 * EI_z / L**2
        matrix[2, 4] = matrix[4, 2] = 6 * EI_y / L**2
        return matrix
