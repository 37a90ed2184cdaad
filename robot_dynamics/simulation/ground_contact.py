"""Contact of a simulated robot with elastic ground."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from robot_dynamics.simulation.frame_kinematics import FrameKinematics

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.ground import Ground
    from robot_dynamics.simulation.plant import Plant

MAX_CONTACT_DEPTH = 1e-5
"""Depth [characteristic lengths] that a point may reach in the part of a step in which it meets the ground."""


class GroundContact:
    """Wrenches of a Ground on the links of a Plant, and the depths of its points in a part of a step.

    Parameters
    ----------
    plant : Plant
        Its wrench_links include the points of the ground.
    ground : Ground
    """

    def __init__(self, plant: Plant, ground: Ground) -> None:
        self._plant = plant
        self._ground = ground
        self._max_depth = MAX_CONTACT_DEPTH * plant.dynamics.robot.characteristic_length
        self._kinematics: dict[tuple[int, ...] | None, FrameKinematics] = {}
        self._depths: list[Array] = []

    def begin_substep(self) -> None:
        """Clear the recorded depths: another part of a step begins."""
        self._depths = []

    def add_wrenches(self, q: Array, rates: Array, R: Array, P: Array, wrenches: Sequence[Array]) -> list[Array]:
        """Wrenches (6,) on the links of the plant, with those of the ground added; the depths are recorded.

        q: positions as the programs take them; rates: (6 + n,); R (3, 3), P (3,): pose of the base in the world.
        """
        rotations, positions, velocities = self._frame_kinematics()(q, rates)
        positions = P + positions @ R.T
        self._depths.append(self._ground.height - positions[:, 2])
        forces = self._ground.forces(positions, velocities @ R.T)
        wrenches = list(wrenches)
        for point, name in enumerate(self._ground.points):
            if forces[point, 2]:
                link = self._plant.wrench_links.index(name)
                wrench = wrenches[link].copy()
                wrench[:3] += (forces[point] @ R) @ rotations[point]
                wrenches[link] = wrench
        return wrenches

    def changes_in_substep(self) -> bool:
        """Whether a contact begins or ends within the part of a step.

        A point was then both above the ground and deeper in it than MAX_CONTACT_DEPTH at the stages of the part: the
        slopes of the part do not resolve its force.
        """
        depths = np.array(self._depths)
        has_changed = (depths > 0).any(axis=0) & (depths <= 0).any(axis=0)
        return bool((depths.max(axis=0)[has_changed] > self._max_depth).any())

    def _frame_kinematics(self) -> FrameKinematics:
        """Kinematics of the points for the coordinates that the plant uses."""
        independent = self._plant.independent
        if independent not in self._kinematics:
            points = self._ground.points
            self._kinematics[independent] = FrameKinematics(self._plant.dynamics, points, independent)
        return self._kinematics[independent]
