"""Uniform scaling of time: the same motion in s times the time, with velocities q̇/s and accelerations q̈/s².

Efforts do not scale: weight and Coulomb friction stay, viscous friction becomes 1/s of itself, and what bodies need to
accelerate 1/s². The smallest s at which no limit is passed is therefore sought on the inverse model itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.motions.actuator_limits import ActuatorLimits
    from robot_dynamics.motions.effort_model import EffortModel

STEP = 1.25
"""Factor between the scales that bracket the result."""
SMALLEST, LARGEST = 1e-3, 1e3
"""Scales that are tried."""
TOLERANCE = 1e-10
"""Relative tolerance of the scale."""


@dataclass(frozen=True)
class TimeScale:
    """The smallest factor of time at which no limit is passed.

    Attributes
    ----------
    scale : s; below 1 where the motion could be faster.
    actuator : name of the joint or motor that reaches its limit there.
    quantity : effort or velocity, whichever it reaches.
    sample : number of the sample at which it does.
    """

    scale: float
    actuator: str
    quantity: Literal["effort", "velocity"]
    sample: int


def find_time_scale(model: EffortModel, limits: ActuatorLimits, q: Array, qd: Array, qdd: Array) -> TimeScale | None:
    """Find the smallest time scale of a motion.

    Parameters
    ----------
    model, limits : EffortModel, ActuatorLimits
    q : (N, all joints) positions, with loops closed.
    qd, qdd : (N, n) velocities and accelerations.

    Returns
    -------
    TimeScale or None
        None where no scale from SMALLEST to LARGEST is the smallest one: no limit is reached however fast the motion
        is, or one is passed however slow it is. `largest_usage` at LARGEST tells which.
    """

    def usage(scale: float) -> float:
        return largest_usage(model, limits, q, qd, qdd, scale)

    possible = 1.0
    while usage(possible) > 1:
        possible *= STEP
        if possible > LARGEST:
            return None
    impossible = possible / STEP
    while usage(impossible) <= 1:
        possible = impossible
        impossible /= STEP
        if impossible < SMALLEST:
            return None
    while possible - impossible > TOLERANCE * possible:
        middle = (possible + impossible) / 2
        if usage(middle) <= 1:
            possible = middle
        else:
            impossible = middle
    of_efforts, of_speeds = limits.usage(model.efforts(q, qd / possible, qdd / possible**2), qd / possible)
    both = np.stack([of_efforts, of_speeds])
    kind, sample, actuator = np.unravel_index(np.argmax(both), both.shape)
    return TimeScale(possible, limits.names[actuator], "velocity" if kind else "effort", int(sample))


def largest_usage(
    model: EffortModel, limits: ActuatorLimits, q: Array, qd: Array, qdd: Array, scale: float = 1.0
) -> float:
    """Largest part of any limit of effort or speed that a motion uses in `scale` times its time; arguments as above."""
    usages = limits.usage(model.efforts(q, qd / scale, qdd / scale**2), qd / scale)
    return max(float(usage.max(initial=0.0)) for usage in usages)
