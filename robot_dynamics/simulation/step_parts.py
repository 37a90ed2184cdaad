"""Division of a step into as many parts as its error requires, in machine code and in Python."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np

from robot_dynamics.procedures import is_finite, largest, magnitude, procedure, select
from robot_dynamics.simulation.step_limits import (
    MAX_CONTACT_SUBSTEPS,
    MAX_RELATIVE_ERROR,
    MAX_SUBSTEPS,
    MIN_RATE_SCALE,
    ROUNDING_SHARE,
    STEP_GROWTH_THRESHOLD,
    TOLERANCE,
)


class StepMotion(Protocol):
    """The motion in one step. `progress` is what one part leaves to the next beside y."""

    def limit(self, length: Any, y: Any, progress: Any) -> Any:
        """The length [s] of the next part, at most `length` [s]."""

    def attempt(self, elapsed: Any, length: Any, y: Any, progress: Any) -> Any:
        """y at the end of a part, the relative error of its rates, and whether its stages resolve the contacts."""

    def finish(self, elapsed: Any, y: Any, progress: Any) -> Any:
        """y and progress after a part is accepted, and whether the step goes on."""


@procedure
def integrate_in_parts(motion: StepMotion, y: Any, progress: Any, step: float) -> Any:
    """Integrate a step.

    Parameters
    ----------
    motion : StepMotion
    y, progress
        Where the step begins.
    step : float
        Length of the step [s].

    Returns
    -------
    y, progress
        Where the step ends.
    shortest : float
        Length of its shortest part [s].
    is_regular : bool
        Whether the step was integrated to its end: not where the error is too large even in the shortest parts.
    """
    elapsed = 0.0
    length = step
    shortest = step
    is_regular: Any = True
    while elapsed < step and is_regular:
        if step - elapsed < length:
            length = step - elapsed
        length = motion.limit(length, y, progress)
        end, error, is_resolved = motion.attempt(elapsed, length, y, progress)
        is_divisible = length / 2 >= step / MAX_SUBSTEPS
        is_exact = error <= TOLERANCE or (error <= MAX_RELATIVE_ERROR and not is_divisible)
        is_accepted = is_exact and (is_resolved or length < step / MAX_CONTACT_SUBSTEPS)
        if is_accepted:
            if length < shortest:
                shortest = length
            elapsed = elapsed + length
            if elapsed >= (1 - ROUNDING_SHARE) * step:
                elapsed = step
            y, progress, is_regular = motion.finish(elapsed, end, progress)
            if error < STEP_GROWTH_THRESHOLD * TOLERANCE:
                length = 2 * length
        else:
            is_regular = is_exact or is_divisible
            length = length / 2
    return y, progress, shortest, is_regular


@procedure
def limit_travel(length: Any, speed: Any, travel: Any, step: float) -> Any:
    """A length [s], halved until nothing travels further than `travel` in it, down to the shortest part of a step.

    speed: [travel/s].
    """
    while length * speed > travel and length > step / MAX_SUBSTEPS:
        length = length / 2
    return length


def relative_error(error: Any, rates: Any, units: Any, chart: Any) -> Any:
    """Largest error (m,) relative to the largest of the rates (m,), in units (m,) that count as radians.

    It is infinite where the integration of the chart of the base diverges.
    """
    scale = MIN_RATE_SCALE + largest(magnitude(rates / units))
    return select(is_finite(chart), largest(magnitude(error / units)) / scale, np.inf)
