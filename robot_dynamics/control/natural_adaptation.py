"""Adaptation of inertial parameters along the natural gradient: they stay those of bodies that can exist.

The parameters of a link are its pseudo-inertia P, a positive definite matrix (4, 4). With the distance

    D(P ‖ P̂) = tr(P̂⁻¹ P) - log det(P̂⁻¹ P) - 4

from the estimate P̂ to the true P, the gradient g of a power by the parameters, and B with tr(B P) = gᵀ θ, the law is

    dP̂/dt = γ P̂ B P̂

It leaves the set of positive definite matrices at no time, is independent of units and frames, and gives
dD/dt = -γ gᵀ (θ - θ̂). Parameters that are one number above zero (rotor inertias, friction) obey the same law in one
dimension, dx/dt = γ x² g.

T. Lee, J. Kwon, F. C. Park, A natural adaptive control law for robot manipulators, IROS 2018.

Within a time step h the estimate moves along the geodesic of the metric in this direction, P̂ = L exp(γ h Lᵀ B L) Lᵀ for
P̂ = L Lᵀ. It is positive definite for any h, and equals the law to first order.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.newton_euler.pseudo_inertia import dual_matrices, link_parameters, pseudo_inertias

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array, BoolArray

SMALLEST_EIGENVALUE = 1e-10
"""Least eigenvalue of a pseudo-inertia, with ones on its diagonal, of a body that can be adapted."""


@dataclass(frozen=True)
class AdaptationLimits:
    """Limits of an adaptation.

    Attributes
    ----------
    max_ratio : float
        Largest ratio of a parameter and its initial value, and of the initial value and the parameter: of masses, of
        second moments about any axis, and of all other eigenvalues of P̂ relative to the initial P. Above 1.
    max_rate : float
        Largest relative rate of change [1/s].
    """

    max_ratio: float = 20.0
    max_rate: float = 2.0


@dataclass(frozen=True)
class AdaptationSettings:
    """Settings of the adaptation.

    Attributes
    ----------
    gain : float
        γ [1/J]: an error of 1 W for 1 s changes parameters by about this fraction. Zero: no adaptation.
    dead_zone : float
        Largest component of s [rad/s or m/s] at which nothing is adapted, so that noise does not move parameters.
    limits : AdaptationLimits
    """

    gain: float = 1.0
    dead_zone: float = 0.01
    limits: AdaptationLimits = field(default_factory=AdaptationLimits)


class NaturalAdaptation:
    """Estimates of the parameters of links and of positive numbers.

    Parameters
    ----------
    links : ndarray, shape (L, 10)
        Initial LINK_PARAMETERS. Links without mass or without extent stay as they are.
    numbers : ndarray, shape (K,)
        Initial positive numbers; those that are zero stay so.
    limits : AdaptationLimits

    Attributes
    ----------
    is_adapted : ndarray of bool, shape (L,)
        Which links are adapted.
    limits : AdaptationLimits
    links, numbers : ndarray, shape (L, 10) and (K,)
        The present estimates.
    """

    def __init__(self, links: Array, numbers: Array, limits: AdaptationLimits) -> None:
        self.limits = limits
        self._initial_links = np.array(links, dtype=float).reshape(-1, 10)
        self._initial_numbers = np.array(numbers, dtype=float)
        self.is_adapted: BoolArray = np.array([_is_body(P) for P in pseudo_inertias(self._initial_links)], dtype=bool)
        # P = F X Fᵀ with P = F Fᵀ at the beginning: X (4, 4) begins as 1, and has the ratios to the initial P
        self._factors = np.linalg.cholesky(pseudo_inertias(self._initial_links[self.is_adapted]))
        self.reset()

    def reset(self) -> None:
        """Return to the initial parameters."""
        self.links = self._initial_links.copy()
        self.numbers = self._initial_numbers.copy()
        self._ratios: Array = np.tile(np.eye(4), (len(self._factors), 1, 1))

    def update(self, step: float, gain: float, links: Array, numbers: Array) -> None:
        """Move the estimates for a time.

        Parameters
        ----------
        step : float
            Time [s].
        gain : float
            γ [1/J].
        links, numbers : ndarray, shape (L, 10) and (K,)
            Gradients g of the power by the parameters [W per unit of the parameter].
        """
        limits = self.limits
        F = self._factors
        roots = _matrix_function(self._ratios, np.sqrt)
        directions = roots @ np.swapaxes(F, -1, -2) @ dual_matrices(links[self.is_adapted]) @ F @ roots
        relative = self.numbers * numbers
        if not (np.isfinite(directions).all() and np.isfinite(relative).all()):
            return
        largest = max(
            float(np.abs(np.linalg.eigvalsh(directions)).max(initial=0.0)), float(np.abs(relative).max(initial=0.0))
        )
        least, most = 1 / limits.max_ratio, limits.max_ratio
        # one factor for all parameters, so that the direction stays; farther than from one bound to the other is none
        farthest = min(limits.max_rate * step, 2 * np.log(most))
        h = min(gain * step, farthest / largest) if largest > 0 else 0.0
        moved = roots @ _matrix_function(h * directions, np.exp) @ roots
        self._ratios = _matrix_function(moved, lambda ratio: np.clip(ratio, least, most))
        self.numbers = np.clip(
            self.numbers * np.exp(h * relative), least * self._initial_numbers, most * self._initial_numbers
        )
        self.links[self.is_adapted] = link_parameters(F @ self._ratios @ np.swapaxes(F, -1, -2))

    def distance(self, links: Array, numbers: Array) -> float:
        """Distance D from the estimates to parameters (L, 10) and (K,) of adapted links and numbers above zero."""
        true = pseudo_inertias(np.asarray(links)[self.is_adapted])
        quotients = np.linalg.solve(pseudo_inertias(self.links[self.is_adapted]), true)
        distances = np.trace(quotients, axis1=-2, axis2=-1) - np.log(np.linalg.det(quotients)) - 4
        is_positive = self.numbers > 0
        scalars = np.asarray(numbers)[is_positive] / self.numbers[is_positive]
        return float(distances.sum() + (scalars - np.log(scalars) - 1).sum())

    @property
    def largest_ratio(self) -> float:
        """Largest ratio of an estimate and its initial value, or of the initial value and the estimate."""
        is_positive = self._initial_numbers > 0
        scalars = self.numbers[is_positive] / self._initial_numbers[is_positive]
        ratios = np.concatenate([np.linalg.eigvalsh(self._ratios).ravel(), scalars, [1.0]])
        return float(np.maximum(ratios, 1 / ratios).max())


def _matrix_function(matrices: Array, function: Callable[[Array], Array]) -> Array:
    """Return a function of the eigenvalues of symmetric matrices (..., k, k)."""
    values, vectors = np.linalg.eigh(matrices)
    results: Array = (vectors * function(values)[..., None, :]) @ np.swapaxes(vectors, -1, -2)
    return (results + np.swapaxes(results, -1, -2)) / 2


def _is_body(P: Array) -> bool:
    """Whether a pseudo-inertia (4, 4) is positive definite, well above rounding."""
    diagonal = np.diag(P)
    if not (diagonal > 0).all():
        return False
    units = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(P * units * units[:, None])[0] > SMALLEST_EIGENVALUE)
