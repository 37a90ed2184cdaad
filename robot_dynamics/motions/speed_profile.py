"""The fastest speed along a path within limits of efforts and speeds, by forward and backward passes.

The state of a section is x = σ̇²; its control is u = σ̈ = x'/2. Both are constrained in the middle of each interval of a
grid, where x is the mean of its values at the ends and u their difference divided by twice the step. At given x the
efforts a u + b x + c + f(√x) are linear in u, so that limits of efforts become an interval of u, with friction of any
dependence on speed, and with torque-speed curves. The backward pass finds the largest x at each point from which the
end can be reached at rest, the forward pass the largest x from the beginning.

Sources: J. Bobrow, S. Dubowsky, J. Gibson, Time-optimal control of robotic manipulators along specified paths,
International Journal of Robotics Research 4 (1985); H. Pham, Q.-C. Pham, A new approach to time-optimal path
parameterization based on reachability analysis, IEEE Transactions on Robotics 34 (2018), whose passes over controllable
sets these are, with intervals of u from limits that are not linear in x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.errors import InvalidInputError

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.motions.actuator_limits import ActuatorLimits
    from robot_dynamics.motions.effort_model import PathEfforts

CANDIDATES = 33
"""Values of x that are tried at once."""
REFINEMENTS = 5
"""Rounds, each between two neighbouring candidates of the round before."""
INFEASIBLE = 5e-2
"""Violation of limits, relative to the controls, from which on a path cannot be passed."""
DOUBLINGS = 60
"""Of the range of x, until its end passes a limit."""


@dataclass(frozen=True, eq=False)
class IntervalLimits:
    """Limits in the middles of N intervals of a path: 2 c inequalities, of upper and then of lower limits.

    Inequality: a u + b x + c + f(ṡ) <= margin · limit(speed).

    Attributes
    ----------
    limits : of the actuators.
    a, b, c : (N, 2 c) coefficients.
    friction_speeds : (K,) values of ṡ of the table of friction.
    friction : (N, K, 2 c) friction f at these speeds; linear between and beyond them.
    speed_rates : (N, c) speeds of the actuators at ṡ = 1.
    margins : (N,) parts of the limits of efforts that may be used.
    ceilings : (N + 1,) largest x at the points between the intervals, by limits of speeds.
    """

    limits: ActuatorLimits
    a: Array
    b: Array
    c: Array
    friction_speeds: Array
    friction: Array
    speed_rates: Array
    margins: Array
    ceilings: Array

    def controls(self, number: int, x: Array) -> tuple[Array, Array]:
        """Lowest and highest u (k,) in an interval at values x (k,); the first one is above the other where none is."""
        rates = np.sqrt(np.maximum(x, 0.0))
        speeds = rates[:, None] * self.speed_rates[number]
        bounds = self.margins[number] * self.limits.effort_limits(speeds)
        room = np.concatenate([bounds, bounds], axis=1) - self._friction(number, rates)
        room -= x[:, None] * self.b[number] + self.c[number]
        a = self.a[number]
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = room / a
        highest = np.where(a > 0, ratio, np.inf).min(axis=1)
        lowest = np.where(a < 0, ratio, -np.inf).max(axis=1)
        is_impossible = ((a == 0) & (room < 0)).any(axis=1) | (speeds > self.limits.max_speeds).any(axis=1)
        highest[is_impossible] = -np.inf
        return lowest, highest

    def describe_impasse(self, number: int) -> str:
        """Say why no control in an interval is within the limits: which actuator is too weak, if it is at rest."""
        at_rest = self._friction(number, np.zeros(1))[0] + self.c[number]
        limits = self.margins[number] * self.limits.effort_limits(np.zeros((1, self.speed_rates.shape[1])))[0]
        with np.errstate(divide="ignore", invalid="ignore"):  # limits of zero
            usage = np.nan_to_num(at_rest / np.concatenate([limits, limits]), nan=0.0, posinf=np.inf)
        worst = int(usage.argmax())
        if usage[worst] > 1:
            name = self.limits.names[worst % len(limits)]
            reason = f"to rest there takes {usage[worst]:.0%} of it" if np.isfinite(usage[worst]) else "it is zero"
            return f"the effort limit of {name!r} is passed at a point of the path however slow the motion is: {reason}"
        return "limits are passed at a point of the path however slow the motion is: no one effort is to blame"

    def _friction(self, number: int, rates: Array) -> Array:
        """Friction (k, 2 c) at values ṡ (k,)."""
        table, speeds = self.friction[number], self.friction_speeds
        index = np.minimum(np.maximum(np.searchsorted(speeds, rates) - 1, 0), len(speeds) - 2)
        part = (rates - speeds[index]) / (speeds[index + 1] - speeds[index])
        friction: Array = table[index] + part[:, None] * (table[index + 1] - table[index])
        return friction


def find_interval_limits(
    efforts: PathEfforts, limits: ActuatorLimits, speed_rates: Array, ceilings: Array
) -> IntervalLimits:
    """Return the limits in intervals with efforts in their middles; speed_rates (N, c) and ceilings (N + 1,) as there.

    Load-dependent friction makes an effort y = Γ + μ |Γ| sign(q̇). Where the joint moves in positive direction, that is
    (1 + μ) Γ at the upper limit, where Γ > 0, and (1 - μ) Γ at the lower one. Where the direction changes, the larger
    factor counts, and of other friction the worse value.
    """
    rows = np.concatenate([limits.effort_rows, -limits.effort_rows])
    above, below = np.maximum(rows, 0.0).T, np.maximum(-rows, 0.0).T  # joints at their upper limits, and at their lower
    at_upper, at_lower = (
        1 + efforts.load_friction * np.where(efforts.is_turning, 1.0, sign * efforts.directions) for sign in (1, -1)
    )
    a, b, c = (
        (at_upper * values) @ above - (at_lower * values) @ below for values in (efforts.a, efforts.b, efforts.c)
    )
    friction = efforts.highest_friction @ above - efforts.lowest_friction @ below
    return IntervalLimits(limits, a, b, c, efforts.speeds, friction, speed_rates, np.ones(len(a)), ceilings)


def fastest_profile(steps: Array, intervals: IntervalLimits) -> Array:
    """Return the largest x = σ̇² (N + 1,) at the points of a grid, from rest to rest.

    Parameters
    ----------
    steps : (N,) array
        Lengths of the intervals between the points.
    intervals : IntervalLimits
        Limits in the N intervals.

    Raises
    ------
    InvalidInputError
        The path cannot be passed within the limits however slowly, or nothing limits the speed.
    """
    count = len(steps)
    controllable = np.zeros(count + 1)
    for number in range(count - 1, 0, -1):
        most = _largest_controllable(intervals, number, float(steps[number]), float(controllable[number + 1]))
        controllable[number] = min(most, intervals.ceilings[number])
    x = np.zeros(count + 1)
    for number in range(count - 1):
        ends = float(x[number]), float(controllable[number + 1])
        x[number + 1] = _largest_reachable(intervals, number, float(steps[number]), *ends)
    return x


def _largest_controllable(intervals: IntervalLimits, number: int, step: float, end: float) -> float:
    """Largest x at the beginning of an interval from which x at its end can be at most `end`."""

    def evaluate(middle: Array) -> tuple[Array, Array]:
        """Largest x at the beginning for values in the middle (k,), and by how much controls pass their limits."""
        lowest, highest = intervals.controls(number, middle)
        control = np.maximum(lowest, -middle / step)  # the end is not below rest
        return middle - step * control, control - np.minimum(highest, (end - middle) / step)

    reach = _reach(intervals, number, step, end)
    high = end + reach
    for _ in range(DOUBLINGS):
        if evaluate(np.array([high]))[1][0] > 0:
            break
        high = end + 2 * (high - end)
    else:
        raise InvalidInputError("nothing limits the speed of the motion: give limits of efforts and velocities")
    best = _search(evaluate, max(end - reach, 0.0), high)
    if best is None or best[1] > 0:
        best = _search(evaluate, 0.0, high)
    if best is None or best[1] > INFEASIBLE * reach / step:
        raise InvalidInputError(intervals.describe_impasse(number))
    return max(best[0], 0.0)


def _largest_reachable(intervals: IntervalLimits, number: int, step: float, begin: float, most: float) -> float:
    """Largest x at the end of an interval, at most `most`, that is reached from x = `begin`.

    Where rounding leaves no control within the limits, the nearest one.
    """

    def evaluate(middle: Array) -> tuple[Array, Array]:
        """The value at the end for values in the middle (k,), and by how much controls pass their limits."""
        lowest, highest = intervals.controls(number, middle)
        control = (middle - begin) / step
        return 2 * middle - begin, np.maximum(lowest - control, control - highest)

    reach = _reach(intervals, number, step, begin)
    low, high = begin / 2, (begin + most) / 2
    best = _search(evaluate, max(low, min(begin - reach, high)), min(high, begin + reach))
    if best is None or best[1] > 0:
        wide = _search(evaluate, low, high)
        best = wide if best is None or (wide is not None and wide[1] < best[1]) else best
    if best is None or best[1] > INFEASIBLE * reach / step:
        raise InvalidInputError(intervals.describe_impasse(number))
    return min(max(best[0], 0.0), most)


def _reach(intervals: IntervalLimits, number: int, step: float, x: float) -> float:
    """Change of x in half an interval that no control at x passes, twice over."""
    bounds = np.abs(np.concatenate(intervals.controls(number, np.array([x]))))
    finite = bounds[np.isfinite(bounds)]
    return 2 * step * float(finite.max(initial=0.0)) or max(x, 1e-9)


def _search(evaluate: Callable[[Array], tuple[Array, Array]], low: float, high: float) -> tuple[float, float] | None:
    """Return the largest value of a function between low and high where it has no violation, and the violation there.

    evaluate: returns values (k,) and violations (k,) for arguments (k,). Where all are violated, the value of the
    smallest violation is returned; None where no violation is finite.
    """
    best: tuple[float, float] | None = None
    for _ in range(REFINEMENTS):
        candidates = np.linspace(low, high, CANDIDATES)
        values, violations = evaluate(candidates)
        violations = np.where(np.isnan(violations), np.inf, violations)
        is_possible = violations <= 0
        if is_possible.any():
            index = int(np.argmax(np.where(is_possible, values, -np.inf)))
            if best is None or best[1] > 0 or values[index] > best[0]:
                best = float(values[index]), 0.0
            if index == CANDIDATES - 1:
                break
        else:
            index = int(np.argmin(violations))
            if np.isfinite(violations[index]) and (best is None or violations[index] < best[1]):
                best = float(values[index]), float(violations[index])
        low, high = candidates[max(index - 1, 0)], candidates[min(index + 1, CANDIDATES - 1)]
    return best
