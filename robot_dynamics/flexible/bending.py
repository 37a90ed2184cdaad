"""How a beam element moves while it bends: where its sections stand in its beginning, and how they move against it.

The section at a share s of the length L stands at p(s) = [s L + u - ½ eᵀ S(s) e, v, w], turned by the rotation vector
θ(s) = [φ, -w', v'], where u, v, w and φ are interpolated from the elastic coordinates e by the shape functions of the
element (element.py). ½ eᵀ S(s) e = ½ ∫ v'² + w'² dx is by how much the beam's end comes nearer as it bends, so that u
is what stretches it: this is where a centrifugal force stiffens a beam and a weight softens it. Velocities and
accelerations below are the exact derivatives of this placement, nothing in them is linearised.
"""

from math import factorial
from typing import NamedTuple

import numpy as np

from robot_dynamics.model.inertia import skew
from robot_dynamics.newton_euler.screw import apply, apply_transposed, cross, dot, screw

TERMS = 12  # exact to rounding up to π


def _series():
    """(TERMS, 5) coefficients of series in x = φ²: of sin φ / φ, (1 - cos φ) / φ², (φ - sin φ) / φ³, and of the
    derivatives of the last two."""
    told = np.array([[(-1) ** k / factorial(2 * k + first) for first in (1, 2, 3)] for k in range(TERMS)])
    slopes = np.zeros((TERMS, 2))
    slopes[:-1] = np.arange(1, TERMS)[:, None] * told[1:, 1:]
    return np.hstack([told, slopes])


SERIES = _series()


class AttachedFrames(NamedTuple):
    """Frames that hang on one frame and that the same coordinates x (..., k) move against it, p of them.

    rotations, positions: (..., p, 3, 3) and (..., p, 3) in it; columns: (..., p, 6, k), their twists against it for
    unit rates, in their own axes at their origins; rates: (..., p, 6) these twists; drifts: (..., p, 6) by how much
    they change where the rates of the coordinates do not.
    """

    rotations: np.ndarray
    positions: np.ndarray
    columns: np.ndarray
    rates: np.ndarray
    drifts: np.ndarray


def place_sections(element, placement, e, rates):
    """The Hung sections of an Element, in the frame in which `placement` (4, 4) has its beginning.

    e, rates: (..., 6) elastic coordinates and their rates.
    """
    told, e, rates = element.sections, e[..., None, :], rates[..., None, :]
    nearer = apply(told.shortenings, e)  # S e
    moved, moving = apply(told.shapes, e), apply(told.shapes, rates)
    along = np.array([1.0, 0.0, 0.0])
    p = moved[..., :3] + along * (told.distances[:, None] - dot(e, nearer) / 2)
    velocity = moving[..., :3] - along * dot(rates, nearer)
    drift = -along * dot(rates, apply(told.shortenings, rates))
    R, E, turning = _turned(moved[..., 3:], moving[..., 3:])
    linear = told.shapes[:, :3] - along[:, None] * nearer[..., None, :]
    angular = E @ told.shapes[:, 3:]
    transposed = np.swapaxes(R, -1, -2)
    columns = np.concatenate([transposed @ linear, transposed @ angular], axis=-2)
    omega = apply(E, moving[..., 3:])
    begin, start = placement[:3, :3], placement[:3, 3]
    return AttachedFrames(
        begin @ R,
        start + apply(begin, p),
        columns,
        screw(apply_transposed(R, velocity), apply_transposed(R, omega)),
        screw(apply_transposed(R, drift), apply_transposed(R, turning)),
    )


def _turned(theta, rate):
    """Of rotation vectors θ (..., 3) with rates θ̇: (R = exp θ̂, E, Ė θ̇), where the angular velocity is E θ̇, in the
    axes against which they turn."""
    x = dot(theta, theta)
    sine, a, b, slope_a, slope_b = np.polynomial.polynomial.polyval(x, SERIES)
    change = 2 * dot(theta, rate)  # of x, with time
    hat, once = skew(theta), cross(theta, rate)
    squared = hat @ hat
    R = np.eye(3) + sine[..., None] * hat + a[..., None] * squared
    E = np.eye(3) + a[..., None] * hat + b[..., None] * squared
    drift = change * (slope_a * once + slope_b * cross(theta, once)) + b * cross(rate, once)
    return R, E, drift
