"""Motion along one branch of a mechanism, through singular positions of its loops.

Where branches cross, as in a flat parallelogram, the constraint Jacobian loses rank in any coordinates. On its own
branch the motion is smooth there all the same. Values of a model at such a point are interpolated between points of the
branch on both sides of it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from robot_dynamics.array_types import Array
from robot_dynamics.constraints.newton_iteration import NEWTON_TOLERANCE
from robot_dynamics.errors import SingularModelError
from robot_dynamics.simulation.constrained_motion import (
    SINGULAR_QUALITY,
)
from robot_dynamics.simulation.step_limits import MAX_CORRECTION, NEAR_SINGULAR_QUALITY

if TYPE_CHECKING:
    from robot_dynamics.simulation.constrained_motion import (
        ConstrainedMotion,
        LoopCoordinates,
    )

UNDETERMINED_QUALITY = 1e-9
"""Quality of coordinates below which the tangent is rounding."""
OFFSETS = (1, 2, 3)
"""Distances of the points on each side from the singular position, in strides."""
WEIGHTS = (15 / 20, -6 / 20, 1 / 20)
"""Weights of these points in the interpolation, which is exact for polynomials of degree 5."""
NEIGHBOUR_DISTANCES = tuple(0.004 * 1.5**k for k in range(9))
"""Strides that are tried, the shortest first [rad or characteristic lengths]."""
LATERAL_TOLERANCE = 0.1
"""Distance of a point from its prediction, relative to the stride, at which the search fails."""
TIGHT_CLOSURE_TOLERANCE = 3e-16
"""Residual [characteristic lengths, rad] near a singular position. The error of the tangent there is the residual
divided by the square of the distance."""
REST_VELOCITY = 1e-12
"""Velocity [rad/s or characteristic lengths/s] below which the direction of motion is unknown."""

Neighbours: TypeAlias = list[tuple[float, Array]]
"""Weights in the interpolation, and positions (all joints,)."""


def interpolate(evaluate: Callable[[Array], Sequence[Array]], neighbours: Neighbours) -> list[Array]:
    """Weighted sums of the arrays that evaluate(q) returns at neighbouring positions q (all joints,)."""
    (first_weight, first_q), *others = neighbours
    sums = [first_weight * value for value in evaluate(first_q)]
    for weight, q in others:
        terms = [weight * value for value in evaluate(q)]
        sums = [total + term for total, term in zip(sums, terms, strict=True)]
    return sums


def evaluate_on_branch(
    motion: ConstrainedMotion,
    function: Callable[[Array], Array],
    coordinates: LoopCoordinates,
    q: Array,
    direction: Array,
) -> Array:
    """function(q) at positions q (all joints,) that close the loops, interpolated where q is singular.

    coordinates: with their quality at q; direction: velocities (all joints,) near q.
    """
    if coordinates.quality > SINGULAR_QUALITY:
        return function(q)
    return interpolate(lambda q: [function(q)], find_neighbours(motion, coordinates, q, direction))[0]


def close_on_branch(
    motion: ConstrainedMotion, coordinates: LoopCoordinates, q: Array, velocities: Array
) -> tuple[Array, float]:
    """Put positions on the constraints after a part of a step, on the branch of the motion.

    Parameters
    ----------
    motion : ConstrainedMotion
    coordinates : LoopCoordinates
        With the quality before the part of the step.
    q : ndarray, shape (all joints,)
        Positions predicted by the integration.
    velocities : ndarray, shape (all joints,)
        Direction of motion.

    Returns
    -------
    q : ndarray, shape (all joints,)
    quality : float

    Raises
    ------
    SingularModelError
        The loops do not close near q, or only on another branch.
    """
    is_near_singular = coordinates.quality < NEAR_SINGULAR_QUALITY
    if is_near_singular and motion.quality(coordinates, q) < SINGULAR_QUALITY:
        neighbours = find_neighbours(motion, coordinates, q, velocities)
        closed = interpolate(lambda q: [q], neighbours)[0]
        return closed, motion.quality(coordinates, closed)
    tolerance = TIGHT_CLOSURE_TOLERANCE if is_near_singular else NEWTON_TOLERANCE
    closed, quality = motion.close_loops(coordinates, q, tolerance)
    if motion.correction(q, closed) > MAX_CORRECTION:
        motion.raise_singular(q, "close only off the branch of the motion")
    return closed, quality


def find_neighbours(motion: ConstrainedMotion, coordinates: LoopCoordinates, q: Array, velocities: Array) -> Neighbours:
    """Positions on the branch on both sides of a singular position, with their weights in the interpolation.

    Parameters
    ----------
    motion : ConstrainedMotion
    coordinates : LoopCoordinates
    q : ndarray, shape (all joints,)
        Positions near the constraints.
    velocities : ndarray, shape (all joints,)
        Velocities near q: the direction of the branch.

    Returns
    -------
    list of (float, ndarray)
        Weight and positions (all joints,).

    Raises
    ------
    SingularModelError
        The mechanism is at rest, so that its branch is not determined; or the branch turns or ends here.
    """
    rates = _branch_direction(motion, coordinates, q, velocities)
    speed = motion.loop_speed(rates)
    for distance in NEIGHBOUR_DISTANCES:
        sides = [_follow_side(motion, coordinates, q, sign * distance / speed * rates) for sign in (1, -1)]
        complete_sides = [side for side in sides if side is not None]
        if len(complete_sides) == len(sides):
            return [(weight, side[k]) for k, weight in enumerate(WEIGHTS) for side in complete_sides]
    motion.raise_singular(q, "are singular all along the direction of motion, or on a branch that turns sharply")


def _branch_direction(motion: ConstrainedMotion, coordinates: LoopCoordinates, q: Array, velocities: Array) -> Array:
    """Rates (all joints,) along the branch at q (all joints,), in the charts of platforms.

    They are those of the velocities (all joints,); at rest those of the tangent where it is determined.
    """
    rates = motion.attitudes.chart_rates(q, velocities)
    if motion.loop_speed(rates) > REST_VELOCITY:
        return rates
    if motion.quality(coordinates, q) < UNDETERMINED_QUALITY:
        reason = "can leave this position on more than one branch, and they are at rest: "
        motion.raise_singular(q, reason + "no direction of motion determines the branch")
    state = motion.constrained_state(coordinates, q)
    tangent: Array = state.expand_rates(np.ones(len(coordinates.independent)))
    return tangent


def _follow_side(
    motion: ConstrainedMotion, coordinates: LoopCoordinates, q: Array, stride: Array
) -> list[Array] | None:
    """Positions on the branch at OFFSETS times the stride (all joints,) from q; None where they are not regular."""
    positions = [q]
    direction = motion.non_mimic_positions(stride)
    for _ in OFFSETS:
        predicted = motion.displace(positions[-1], direction)
        try:
            closed, quality = motion.close_loops(coordinates, predicted, TIGHT_CLOSURE_TOLERANCE)
        except SingularModelError:
            return None
        deviation = np.abs(motion.displacement(predicted, closed)).max()
        if quality < SINGULAR_QUALITY or deviation > LATERAL_TOLERANCE * np.abs(stride).max():
            return None
        direction = motion.displacement(positions[-1], closed)
        positions.append(closed)
    return positions[1:]
