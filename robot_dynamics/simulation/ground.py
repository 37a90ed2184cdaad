"""Elastic ground: a spring and a damper under each contact point, and Coulomb friction along the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.errors import DescriptionError
from robot_dynamics.procedures import select

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array


@dataclass(frozen=True)
class Ground:
    """A level plane in the world that pushes on contact points below it.

    Contact points are the origins of named link frames. The ground exerts on each of them ::

        N = max(0, k d - c ḋ⁻),   F = -μ N v / √(|v|² + v_s²)

    where d is the depth of the point and v its velocity along the plane.

    Parameters
    ----------
    points : tuple of str
        Names of the links whose origins can touch the ground.
    height : float
        z coordinate of the plane in the world [m].
    stiffness : float
        Stiffness k below each point [N/m].
    damping : float
        Damping c below each point [N s/m].
    friction : float
        Coefficient of friction μ.
    slip_velocity : float
        Velocity v_s at which friction reaches 0.7 of its full value [m/s]. A body at rest on a slope creeps with about
        v_s.

    Raises
    ------
    DescriptionError
        A link is named twice, or a number is negative or not finite.

    Notes
    -----
    The ground pushes only and never pulls.

    A mass m that hits the ground with one point at the speed v penetrates it by about v √(m/k), and rests m g/k deep.
    At the default stiffness a mass of 0.3 kg at 30 m/s penetrates 0.12 m. Choose k = m (v/d)² for a depth d. Steps
    should be short compared with v_s/(μ g), √(m/k) and m/c. A Simulation divides longer steps, which takes more time,
    and raises SimulationError where the error is too large all the same.
    """

    points: tuple[str, ...]
    height: float = 0.0
    stiffness: float = 2e4
    damping: float = 2e2
    friction: float = 0.8
    slip_velocity: float = 0.01

    def __post_init__(self) -> None:
        object.__setattr__(self, "points", tuple(self.points))
        if len(set(self.points)) < len(self.points):
            raise DescriptionError(f"ground: points {', '.join(self.points)} name a link more than once")
        for name in ("height", "stiffness", "damping", "friction", "slip_velocity"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and np.isfinite(value)):
                raise DescriptionError(f"ground: {name} is {value!r}, it must be a finite number")
            if value < 0 and name != "height":
                raise DescriptionError(f"ground: {name} is {value}, it must not be negative")
        if not self.stiffness or not self.slip_velocity:
            raise DescriptionError("ground: stiffness and slip_velocity must be positive")

    def forces(self, positions: Array, velocities: Array) -> Array:
        """Forces of the ground on points, all in world axes.

        Parameters
        ----------
        positions, velocities : ndarray, shape (points, 3)
            Positions [m] and velocities [m/s] of the points.

        Returns
        -------
        ndarray, shape (points, 3)
            Forces [N]; zero for points above the ground.
        """
        return np.array([self.force(*motion) for motion in zip(positions, velocities, strict=True)]).reshape(-1, 3)

    def force(self, position: Any, velocity: Any) -> Any:
        """The force (3,) [N] on one point at a position (3,) [m] with a velocity (3,) [m/s], in world axes."""
        x, y, z = velocity
        depth = self.height - position[2]
        normal = select(depth > 0, self.stiffness * depth - self.damping * z, 0.0)
        normal = select(normal < 0, 0.0, normal)
        share = self.friction * normal / np.sqrt(x * x + y * y + self.slip_velocity**2)
        return np.array([-share * x, -share * y, normal])
