"""Ground that gives: a spring and a damper under each point that touches it, and Coulomb friction along it."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.errors import DescriptionError


@dataclass(frozen=True)
class Ground:
    """A level plane in the world, which pushes on the origins of named link frames that are below it.

        N = max(0, k d - c ḋ⁻),   F = -μ N v / √(|v|² + v_s²)

    points: names of the links whose origins touch; height: z of the plane [m]; stiffness k [N/m] and damping c [N s/m]
    of each point, d its depth; friction μ; slip_velocity v_s [m/s], at which friction has 0.7 of its full value: what
    rests on a slope creeps with about v_s. Ground pushes only, and never pulls.

    What hits the ground goes into it: a mass m on one point at the speed v by about v √(m/k), and rests m g/k deep. At
    the default stiffness, 0.3 kg at 30 m/s go 0.12 m deep. Choose k = m (v/d)² for a depth d. Steps should be short
    beside v_s/(μ g), √(m/k) and m/c; a Simulation integrates longer ones in parts, which takes more time, and raises
    SimulationError where their error is too large all the same.
    """

    points: tuple[str, ...]
    height: float = 0.0
    stiffness: float = 2e4
    damping: float = 2e2
    friction: float = 0.8
    slip_velocity: float = 0.01

    def __post_init__(self):
        object.__setattr__(self, "points", tuple(self.points))
        if len(set(self.points)) < len(self.points):
            raise DescriptionError(f"ground: points {', '.join(self.points)}: each link once")
        for name in ("height", "stiffness", "damping", "friction", "slip_velocity"):
            value = getattr(self, name)
            if not (isinstance(value, int | float) and np.isfinite(value)):
                raise DescriptionError(f"ground: {name} is {value!r}, a finite number is needed")
            if value < 0 and name != "height":
                raise DescriptionError(f"ground: {name} is {value}, which is negative")
        if not self.stiffness or not self.slip_velocity:
            raise DescriptionError("ground: stiffness and slip_velocity must be positive")

    def forces(self, positions, velocities):
        """(points, 3) [N] on points at positions (points, 3) with velocities (points, 3), all in the world."""
        depth = self.height - positions[:, 2]
        normal = np.where(depth > 0, self.stiffness * depth - self.damping * velocities[:, 2], 0.0)
        normal = np.maximum(normal, 0.0)
        slip = velocities[:, :2]
        share = self.friction * normal / np.sqrt(np.sum(slip**2, axis=1) + self.slip_velocity**2)
        return np.column_stack([-share[:, None] * slip, normal])
