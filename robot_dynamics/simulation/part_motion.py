"""The motion in one step of machine code, as `integrate_in_parts` takes it."""

from __future__ import annotations

from itertools import accumulate
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from robot_dynamics.procedures import procedure
from robot_dynamics.simulation.runge_kutta import increment, increment_in_loop
from robot_dynamics.simulation.step_parts import relative_error

if TYPE_CHECKING:
    from collections.abc import Sequence

    from robot_dynamics.simulation.compiled_steps import CompiledSteps


class HeldInputs(NamedTuple):
    """Inputs of a step: efforts, wrenches (6,) on links, reference twist (6,) of a driven base."""

    efforts: Any
    wrenches: Sequence[Any]
    reference_twist: Any


class PartMotion:
    """The motion in one step, as integrate_in_parts takes it; what one part leaves to the next are qualities (2,).

    Parameters
    ----------
    steps : CompiledSteps
    R, P
        Orientation (3, 3) and position (3,) of the base where the step begins.
    held : HeldInputs
    speed : float
        Of joints in loops.
    """

    def __init__(self, steps: CompiledSteps, R: Any, P: Any, held: HeldInputs, speed: Any) -> None:
        self._steps = steps
        self._pose = R, P
        self._held = held
        self._speed = speed

    def limit(self, length: Any, _y: Any, _qualities: Any) -> Any:
        """The length [s] of a part in which no joint of the loops travels too far."""
        return self._steps.limit(length, self._speed)

    @procedure
    def attempt(self, _elapsed: Any, length: Any, y: Any, _qualities: Any) -> Any:
        """y at the end of a part, the relative error of its rates, and whether its stages resolve the contacts."""
        contact = self._steps.contact
        is_resolved: Any = True
        if contact is not None:
            contact.begin_substep()
        integrate = increment_in_loop if self._steps.has_long_derivative else increment
        change, y_error = integrate(lambda _, y: self._steps.derivative(y, *self._pose, self._held), 0.0, y, length)
        end = y + change
        if contact is not None:
            is_resolved = not contact.changes_in_substep()
        chart, _, rates = self._steps.split_variables(end)
        _, _, rates_error = self._steps.split_variables(y_error)
        return end, relative_error(rates_error, rates, self._steps.units, chart), is_resolved

    @procedure
    def finish(self, _elapsed: Any, y: Any, qualities: Any) -> Any:
        """y and qualities after a part, with the loops closed, and whether the step goes on."""
        chart, q, rates = self._steps.split_variables(y)
        q, qualities, is_regular = self._steps.close(q, qualities)
        return np.concatenate([chart, q, rates]), qualities, is_regular


def split(values: Any, sizes: Sequence[int]) -> list[Any]:
    """The parts of an array (..., size) with these numbers of entries."""
    return [values[..., end - size : end] for size, end in zip(sizes, accumulate(sizes), strict=True)]
