"""Momentum of a robot whose base moves freely, and the base twist for a prescribed momentum.

    h = A₁₁ V0 + A₁₂ q̇ = [P; L],   the wrench of all momenta in the base frame, at its origin

Without external wrenches gravity alone changes P, and nothing changes the angular momentum about the centre of mass,
L - c × P. An integrator conserves both up to its order; the simulation corrects the base twist so that both are
conserved up to rounding.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.newton_euler.screw import cross
from robot_dynamics.procedures import solve

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array


class Momentum(NamedTuple):
    """Momentum of a robot, in world axes.

    Attributes
    ----------
    linear : ndarray, shape (3,)
        Linear momentum P [kg m/s].
    angular : ndarray, shape (3,)
        Angular momentum about the centre of mass [kg m²/s].
    """

    linear: Array
    angular: Array


def centre_of_mass(A: Any) -> tuple[Any, Any]:
    """Mass [kg] and centre of mass (3,) [m] in the base frame, from the inertia matrix (6 + n, 6 + n)."""
    mass = A[0, 0]
    return mass, np.array([A[1, 5], A[2, 3], A[0, 4]]) / mass


def momentum(A: Any, R: Any, rates: Any) -> Momentum:
    """Momentum of a robot with the inertia matrix A (6 + n, 6 + n) at rates (6 + n,).

    R (3, 3): orientation of the base in the world.
    """
    h = A[:6] @ rates
    _, c = centre_of_mass(A)
    return Momentum(R @ h[:3], R @ (h[3:] - cross(c, h[:3])))


def twist_from_momentum(conserved: Momentum, A: Any, R: Any, rates: Any) -> Any:
    """Twist (6,) of the base with which the robot has a momentum, its joints moving at rates[6:].

    A (6 + n, 6 + n): inertia matrix; R (3, 3): orientation of the base in the world.
    """
    _, c = centre_of_mass(A)
    P = conserved.linear @ R
    h = np.concatenate([P, conserved.angular @ R + cross(c, P)])
    return rates[:6] + solve(A[:6, :6], (h - A[:6] @ rates)[:, None])[:, 0]


def after_gravity(conserved: Momentum, mass: Any, gravity: Any, time: Any) -> Momentum:
    """The momentum after gravity (3,) [m/s²] in the world has acted on a mass [kg] for a time [s]."""
    return Momentum(conserved.linear + mass * time * gravity, conserved.angular)
