"""Mass properties of a rigid body about the origin of a frame."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import DescriptionError, InvalidInputError
from robot_dynamics.model.vector_product import skew

if TYPE_CHECKING:
    from robot_dynamics.array_types import ArrayLike, ScalarArray

# Descriptions print few digits: rounding may make a flat plate violate the triangle inequality by this fraction.
TRIANGLE_TOLERANCE = 1e-3

INERTIA_ENTRIES = {"xx": (0, 0), "xy": (0, 1), "xz": (0, 2), "yy": (1, 1), "yz": (1, 2), "zz": (2, 2)}
"""Indices of the six entries of a symmetric matrix, in the order that is used everywhere."""


def symmetric_matrix(
    xx: ArrayLike, xy: ArrayLike, xz: ArrayLike, yy: ArrayLike, yz: ArrayLike, zz: ArrayLike
) -> ScalarArray:
    """Return symmetric matrices (..., 3, 3) of their six entries (...)."""
    entries = np.broadcast_arrays(xx, xy, xz, xy, yy, yz, xz, yz, zz)
    return np.stack(entries, axis=-1).reshape(*entries[0].shape, 3, 3)


def symmetric_entries(matrix: ScalarArray) -> tuple[Any, ...]:
    """Return xx, xy, xz, yy, yz, zz (...) of symmetric matrices (..., 3, 3)."""
    return tuple(matrix[..., row, column] for row, column in INERTIA_ENTRIES.values())


@dataclass(frozen=True, eq=False)
class Inertia:
    """The ten standard inertial parameters of a rigid body, about the origin of its frame and along its axes.

    Parameters
    ----------
    mass : float
        M [kg].
    first_moments : (3,) array_like
        MS = M·c [kg m], where c is the centre of mass. Default: zeros.
    second_moments : (3, 3) array_like
        Inertia matrix J about the origin of the frame [kg m²], symmetric. Default: zeros.

    Raises
    ------
    DescriptionError
        If a shape is wrong, an entry is not a number, or J is not symmetric.

    Notes
    -----
    Source: Khalil, section 2. In traced models the numbers are symbols (dtype object).
    """

    mass: float = 0.0
    first_moments: ScalarArray = field(default_factory=lambda: np.zeros(3))
    second_moments: ScalarArray = field(default_factory=lambda: np.zeros((3, 3)))

    if TYPE_CHECKING:  # the attributes are arrays; the arguments may be sequences too

        def __init__(
            self, mass: float = ..., first_moments: ArrayLike = ..., second_moments: ArrayLike = ...
        ) -> None: ...

    def __post_init__(self) -> None:
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
    def about_centre_of_mass(cls, mass: float, inertia: ArrayLike, frame: ArrayLike | ScalarArray) -> Inertia:
        """Return an inertia from its values about the centre of mass, as URDF gives them.

        Parameters
        ----------
        mass : float
            Mass [kg].
        inertia : (3, 3) array_like
            Inertia matrix about the centre of mass [kg m²], along the axes of frame c.
        frame : (4, 4) or (3,) array_like
            Placement of frame c, which has its origin at the centre of mass, in the frame of the result. (3,): the
            centre of mass [m]; the axes of both frames are parallel.

        Returns
        -------
        Inertia
            The inertia about the origin of the frame of the result.
        """
        placement = np.asarray(frame)
        if placement.shape == (3,):
            centre, placement = placement, np.eye(4)
            placement[:3, 3] = centre
        if placement.shape != (4, 4):
            raise InvalidInputError(
                f"frame of an inertia has shape {placement.shape}: a placement (4, 4) or a centre (3,) is needed"
            )
        return cls(mass, np.zeros(3), inertia).transformed_by(placement)

    def transformed_by(self, placement: ScalarArray) -> Inertia:
        """Return the inertia of the same body about another frame.

        Parameters
        ----------
        placement : (4, 4) array
            iTj, the placement of the frame j of this inertia in the frame i of the result.

        Returns
        -------
        Inertia
            The inertia about the origin of frame i, along its axes.
        """
        R, P = placement[:3, :3], placement[:3, 3]
        first, second = R @ self.first_moments, R @ self.second_moments @ R.T
        offset, moment = skew(P), skew(first)
        # parallel axes for a point that is not the centre of mass: J_i = R J Rᵀ − P̂ M̂S − M̂S P̂ − M P̂ P̂
        second = second - offset @ moment - moment @ offset - self.mass * offset @ offset
        return Inertia(self.mass, first + self.mass * P, (second + second.T) / 2)

    def __add__(self, other: Inertia) -> Inertia:
        """Return the inertia of two bodies that are fixed to each other; both inertias are in the same frame."""
        return Inertia(
            self.mass + other.mass,
            self.first_moments + other.first_moments,
            self.second_moments + other.second_moments,
        )

    @cached_property
    def spatial(self) -> ScalarArray:
        """Spatial inertia (6, 6): maps [V̇; ω̇] of the frame's origin to [force; moment] there (Khalil, section 3)."""
        MS = skew(self.first_moments)
        return np.block([[self.mass * np.eye(3), -MS], [MS, self.second_moments]])

    @cached_property
    def is_finite(self) -> bool:
        """Whether all numbers are finite; symbols count as finite."""
        return self.has_symbols or bool(np.isfinite(self.spatial).all())

    @cached_property
    def has_symbols(self) -> bool:
        """Whether some of the numbers are symbols without a value."""
        return bool(self.spatial.dtype == object)

    @property
    def is_moment_about_z(self) -> bool:
        """Whether the only parameter that is not zero is a positive moment of inertia about the z axis."""
        others = np.delete(self.spatial.ravel(), -1)
        return bool(self.second_moments[2, 2] > 0 and not np.any(others))

    @property
    def central_moments(self) -> ScalarArray:
        """Inertia matrix (3, 3) about the centre of mass [kg m²], along the axes of the frame; the mass is not zero."""
        offset = skew(self.first_moments / self.mass)
        return self.second_moments + self.mass * offset @ offset

    def find_inconsistencies(self) -> list[str]:
        """Return why no physical body has these parameters, as sentences.

        Returns
        -------
        list of str
            Empty for an inertia that a physical body can have.
        """
        if self.mass < 0:
            return [f"mass {self.mass:g} kg is negative"]
        if self.mass == 0:
            if np.any(self.first_moments) or np.any(self.second_moments):
                return ["mass is zero but moments are not"]
            return []
        central = self.central_moments
        rounding = 1e-12 * max(np.abs(central).max(), np.abs(self.second_moments).max())
        smallest, middle, largest = np.linalg.eigvalsh(central)
        moments = f"principal moments about the centre of mass {smallest:.4g}, {middle:.4g}, {largest:.4g} kg m²"
        if smallest < -rounding:
            return [f"inertia is not positive definite: {moments}"]
        if largest > (smallest + middle) * (1 + TRIANGLE_TOLERANCE) + rounding:
            return [f"inertia violates the triangle inequality: {moments}"]
        return []
