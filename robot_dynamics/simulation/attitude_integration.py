"""Integration of platform attitudes near pitch ±90°, where yaw, pitch and roll are no coordinates.

In one part of a step such an attitude is integrated as a rotation vector from the attitude at the beginning of the
part. The rotation vector takes the place of the three angles among the integration variables.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

from robot_dynamics.constraints import attitude_angles, attitude_charts
from robot_dynamics.simulation.rotation import exponential, rotation_vector_rate

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.constraints.topology import ConstraintTopology


class LocalAttitudeChart(NamedTuple):
    """The attitude of a platform as a rotation from where a part of a step begins.

    Attributes
    ----------
    joints : list of int
        Numbers of the joints of yaw, pitch and roll.
    angles : ndarray, shape (3,)
        Yaw, pitch and roll [rad] where the part begins.
    """

    joints: list[int]
    angles: Array


class AttitudeIntegration:
    """Integration variables of a robot with platforms, for joint positions and velocities.

    Parameters
    ----------
    topology : ConstraintTopology
    """

    def __init__(self, topology: ConstraintTopology) -> None:
        self._attitudes = topology.attitudes
        self._offset = topology.offset

    def chart_rates(self, q: Array, velocities: Array) -> Array:
        """Rates (all joints,) in the charts of platforms, from velocities (all joints,) at positions q."""
        return attitude_charts.chart_rates(q, velocities, self._attitudes, self._offset)

    def joint_velocities(self, q: Array, rates: Array) -> Array:
        """Velocities (all joints,), from rates (all joints,) in the charts of platforms at positions q."""
        return attitude_charts.joint_velocities(q, rates, self._attitudes, self._offset)

    def local_charts(self, q: Array) -> list[LocalAttitudeChart]:
        """Charts of the platforms whose pitch is near ±90° at positions q (all joints,)."""
        return [
            LocalAttitudeChart(list(attitude.joints), self._angles(q, attitude.joints))
            for attitude in self._attitudes
            if abs(attitude_charts.pitch_sine_cosine(q, attitude, self._offset)[1]) < attitude_charts.STEEP_PITCH_COSINE
        ]

    def variables(self, q: Array, local_charts: Sequence[LocalAttitudeChart]) -> Array:
        """Integration variables (all joints,) at positions q (all joints,) where the local charts begin."""
        if not local_charts:
            return q
        x: Array = q.copy()
        for chart in local_charts:
            x[chart.joints] = 0.0
        return x

    def positions(self, x: Array, local_charts: Sequence[LocalAttitudeChart]) -> Array:
        """Positions (all joints,) for integration variables x (all joints,)."""
        if not local_charts:
            return x
        q: Array = x.copy()
        for joints, angles in local_charts:
            R = attitude_angles.rotation_from_angles(angles) @ exponential(x[joints])
            q[joints] = attitude_angles.nearest_angles(R, angles) + self._offset[joints]
        return q

    def variable_rates(self, x: Array, q: Array, rates: Array, local_charts: Sequence[LocalAttitudeChart]) -> Array:
        """dx/dt (all joints,) of integration variables x.

        q: positions at x; rates: (all joints,) in the charts of platforms at q.
        """
        if not self._attitudes:
            return rates
        x_rates = self.joint_velocities(q, rates)
        for joints, _ in local_charts:
            roll = self._angles(q, joints)[2]
            omega = attitude_angles.axis_rotation(0, roll).T @ rates[joints][::-1]  # in the axes of the platform
            x_rates[joints] = rotation_vector_rate(x[joints], omega)
        return x_rates

    def _angles(self, q: Array, joints: Sequence[int]) -> Array:
        """Yaw, pitch and roll (3,) at positions q of the joints with these numbers."""
        return q[[*joints]] - self._offset[[*joints]]
