"""Kinematics of a bent beam element: placements of its sections in the frame of its start, and their motion.

The section at a fraction s of the length L is at p(s) = [s L + u - ½ eᵀ S(s) e, v, w], turned by the rotation vector
θ(s) = [φ, -w', v'], where u, v, w and φ are interpolated from the elastic coordinates e by the shape functions of the
element (element.py). ½ eᵀ S(s) e = ½ ∫ v'² + w'² dx is the shortening of the beam by bending, so that u is its
elongation: this term makes a centrifugal force stiffen a beam and a weight soften it. Velocities and accelerations
below are the exact derivatives of this placement; nothing in them is linearised.
"""

from __future__ import annotations

from math import factorial
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from robot_dynamics.model.vector_product import skew
from robot_dynamics.newton_euler.screw import apply, apply_transposed, cross, dot, screw

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.flexible.element import Element

TERMS = 12  # of the series: exact to rounding up to φ = π


def _series_coefficients() -> Array:
    """Return (TERMS, 5) coefficients of series in x = φ².

    Columns: sin φ / φ, (1 - cos φ) / φ², (φ - sin φ) / φ³, and the derivatives of the last two with respect to x.
    """
    values = np.array([[(-1) ** k / factorial(2 * k + first) for first in (1, 2, 3)] for k in range(TERMS)])
    derivatives = np.zeros((TERMS, 2))
    derivatives[:-1] = np.arange(1, TERMS)[:, None] * values[1:, 1:]
    return np.hstack([values, derivatives])


SERIES = _series_coefficients()


class AttachedFrames(NamedTuple):
    """The p frames that the same coordinates x (..., k) move in a parent frame.

    rotations, positions: (..., p, 3, 3) and (..., p, 3) in the parent frame; columns: (..., p, 6, k) relative twists
    for unit rates, in the axes of the frames at their origins; rates: (..., p, 6) relative twists; drifts: (..., p, 6)
    derivatives of these twists at constant rates of the coordinates.
    """

    rotations: Array
    positions: Array
    columns: Array
    rates: Array
    drifts: Array


def place_sections(element: Element, placement: Array, e: Array, rates: Array) -> AttachedFrames:
    """Return the sections of an element in the frame in which its start has `placement` (4, 4).

    e, rates: (..., 6) elastic coordinates and their rates.
    """
    sections = element.sections
    e = e[..., None, :]
    rates = rates[..., None, :]
    shortening_gradient = apply(sections.shortenings, e)  # S e
    displacement = apply(sections.shapes, e)
    displacement_rate = apply(sections.shapes, rates)
    axis = np.array([1.0, 0.0, 0.0])
    p = displacement[..., :3] + axis * (sections.distances[:, None] - dot(e, shortening_gradient) / 2)
    velocity = displacement_rate[..., :3] - axis * dot(rates, shortening_gradient)
    drift = -axis * dot(rates, apply(sections.shortenings, rates))
    R, E, angular_drift = _rotate(displacement[..., 3:], displacement_rate[..., 3:])
    linear = sections.shapes[:, :3] - axis[:, None] * shortening_gradient[..., None, :]
    angular = E @ sections.shapes[:, 3:]
    R_transposed = np.swapaxes(R, -1, -2)
    columns = np.concatenate([R_transposed @ linear, R_transposed @ angular], axis=-2)
    omega = apply(E, displacement_rate[..., 3:])
    start_rotation = placement[:3, :3]
    start_position = placement[:3, 3]
    return AttachedFrames(
        start_rotation @ R,
        start_position + apply(start_rotation, p),
        columns,
        screw(apply_transposed(R, velocity), apply_transposed(R, omega)),
        screw(apply_transposed(R, drift), apply_transposed(R, angular_drift)),
    )


def _rotate(theta: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Return R = exp θ̂, E and Ė θ̇ of rotation vectors θ (..., 3) with rates θ̇ (..., 3).

    E θ̇ is the angular velocity, in the axes in which θ is given.
    """
    x = dot(theta, theta)
    sine, a, b, a_derivative, b_derivative = np.polynomial.polynomial.polyval(x, SERIES)
    x_rate = 2 * dot(theta, rate)
    theta_hat = skew(theta)
    product = cross(theta, rate)
    squared = theta_hat @ theta_hat
    R = np.eye(3) + sine[..., None] * theta_hat + a[..., None] * squared
    E = np.eye(3) + a[..., None] * theta_hat + b[..., None] * squared
    drift = x_rate * (a_derivative * product + b_derivative * cross(theta, product)) + b * cross(rate, product)
    return R, E, drift
