"""The momentum of a robot whose base flies freely, and the base twist that has a given one.

    h = A₁₁ V0 + A₁₂ q̇ = [P; L],   the wrench of all momenta in the base frame, at its origin

Without external wrenches P changes by gravity alone, and the angular momentum about the centre of mass, L - c × P, not
at all. An integrator keeps both to its order; `Momentum` keeps them to rounding.
"""

from typing import NamedTuple

import numpy as np

from robot_dynamics.newton_euler.screw import cross


class Momentum(NamedTuple):
    """linear: P (3,) [kg m/s]; angular: (3,) [kg m²/s] about the centre of mass, both in world axes."""

    linear: np.ndarray
    angular: np.ndarray


def centre_of_mass(A):
    """(mass [kg], centre of mass (3,) in the base frame) from the inertia matrix (6 + n, 6 + n)."""
    mass = A[0, 0]
    return mass, np.array([A[1, 5], A[2, 3], A[0, 4]]) / mass


def momentum(A, R, rates):
    """The Momentum of a robot with inertia matrix A (6 + n, 6 + n), its base turned by R (3, 3), at rates (6 + n,)."""
    h = A[:6] @ rates
    _, c = centre_of_mass(A)
    return Momentum(R @ h[:3], R @ (h[3:] - cross(c, h[:3])))


def twist_from_momentum(kept, A, R, rates):
    """The twist (6,) of the base for which the robot has the Momentum `kept`, its joints moving as `rates` say."""
    _, c = centre_of_mass(A)
    P = kept.linear @ R
    h = np.concatenate([P, kept.angular @ R + cross(c, P)])
    return rates[:6] + np.linalg.solve(A[:6, :6], h - A[:6] @ rates)
