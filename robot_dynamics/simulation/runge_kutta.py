"""The explicit Runge-Kutta method of order 6 in seven stages.

Source: J. C. Butcher, On Runge-Kutta processes of high order, J. Australian Mathematical Society 4 (1964), 179-194.
Why order 6: the fastest links of an arm turn by some hundredths of a radian in a step of 1 ms. A step of order 4 then
loses 1e-10 of the energy, and a minute of such steps 1e-6. Two more orders cost three calls of a compiled model.

The slopes of the two stages in the middle of the step differ by a term of order 4 in the step. Shifting weight from one
of them to the other leaves the order conditions up to 4 satisfied. The step times the difference of the slopes
therefore estimates the error of an embedded method of order 4 at no cost. The estimate is far above the error of the
method itself, and grows at once where a step is too long.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from robot_dynamics.procedures import as_array, procedure, zeros

NODES = np.array([0, 1 / 3, 2 / 3, 1 / 3, 1 / 2, 1 / 2, 1])
STAGES = (
    np.array([1 / 3]),
    np.array([0, 2 / 3]),
    np.array([1 / 12, 1 / 3, -1 / 12]),
    np.array([-1 / 16, 9 / 8, -3 / 16, -3 / 8]),
    np.array([0, 9 / 8, -3 / 8, -3 / 4, 1 / 2]),
    np.array([9 / 44, -9 / 11, 63 / 44, 18 / 11, 0, -16 / 11]),
)
WEIGHTS = np.array([11 / 120, 0, 27 / 40, 27 / 40, -4 / 15, -4 / 15, 11 / 120])
ERROR_STAGES = (4, 5)
"""The two stages in the middle of the step, whose slopes estimate the error."""
ERROR_WEIGHT = 4 / 15
"""Weight that the embedded method shifts from one of these stages to the other."""


@procedure
def increment(derivative: Callable[[float, Any], Any], time: Any, y: Any, step: Any) -> tuple[Any, Any]:
    """Change (m,) of y (m,) in a step [s] that begins at `time` [s], and an estimate (m,) of its error.

    derivative(time, y) returns dy/dt (m,).
    """
    slopes = [derivative(time, y)]
    for weights, node in zip(STAGES, NODES[1:], strict=True):
        slopes.append(derivative(time + node * step, y + (step * weights) @ np.array(slopes)))
    first, second = ERROR_STAGES
    return (step * WEIGHTS) @ np.array(slopes), step * ERROR_WEIGHT * (slopes[second] - slopes[first])


@procedure
def increment_in_loop(derivative: Callable[[Any, Any], Any], time: Any, y: Any, step: Any) -> tuple[Any, Any]:
    """As `increment`, with a loop over the stages: machine code then has the derivative once instead of seven times."""
    stage_count = len(NODES)
    size = len(y)
    nodes = as_array(NODES)
    weights = as_array(np.array([[*row, *np.zeros(stage_count - len(row))] for row in ((), *STAGES)]))
    slopes = zeros(stage_count, size)
    for stage in range(stage_count):
        point = as_array(y)
        for before in range(stage):
            for k in range(size):
                point[k] = point[k] + step * weights[stage, before] * slopes[before, k]
        slopes[stage] = derivative(time + nodes[stage] * step, point)
    first, second = ERROR_STAGES
    return (step * WEIGHTS) @ slopes, step * ERROR_WEIGHT * (slopes[second] - slopes[first])
