"""Motion of the base within one step, in a chart that begins where the step begins.

A point of the chart (6,) is a rotation vector [rad] and a displacement [m] of the base, in its axes at the beginning.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from robot_dynamics.simulation.rotation import exponential, orthonormalize, rotation_vector_rate


def chart_motion(R: Any, P: Any, chart: Any, twist: Any) -> tuple[Any, Any, Any]:
    """Orientation (3, 3) and position (3,) of the base at a point of the chart (6,), and the derivative (6,) of it.

    R, P: orientation and position where the step begins; twist: (6,) of the base.
    """
    E = exponential(chart[:3])
    chart_rates = np.concatenate([np.array(rotation_vector_rate(chart[:3], twist[3:6])), E @ twist[:3]])
    return R @ E, P + R @ chart[3:6], chart_rates


def displaced(R: Any, P: Any, chart: Any) -> tuple[Any, Any]:
    """Orientation and position of the base at the end of a step, at a point of the chart (6,)."""
    return orthonormalize(R @ exponential(chart[:3])), P + R @ chart[3:6]


def convective_acceleration(twist: Any) -> Any:
    """ω × v (3,): the classical acceleration of the base minus the derivative of v in the base frame."""
    a, b, c, x, y, z = twist.tolist()
    return np.array([y * c - z * b, z * a - x * c, x * b - y * a])


def rates_derivative(twist: Any, base_acceleration: Any, accelerations: Any) -> Any:
    """ν̇ (6 + n,) from the classical acceleration (6,) of the base at a twist (6,), and those of the joints (n,)."""
    linear = base_acceleration[:3] - convective_acceleration(twist)
    return np.concatenate([linear, base_acceleration[3:6], accelerations])
