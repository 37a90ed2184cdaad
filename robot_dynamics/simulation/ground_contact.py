"""Contact of a simulated robot with elastic ground."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from robot_dynamics.procedures import largest
from robot_dynamics.simulation.frame_program import FrameProgram

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.ground import Ground
    from robot_dynamics.simulation.plant import Plant

MAX_CONTACT_DEPTH = 1e-5
"""Depth [characteristic lengths] that a point may reach in the part of a step in which it meets the ground."""


class GroundContact:
    """Wrenches of a Ground on links, and the depths of its points in a part of a step.

    Parameters
    ----------
    ground : Ground
    links : sequence of str
        Names of the links that wrenches act on, among them the points of the ground.
    kinematics : callable
        Rotations (k, 3, 3), positions (k, 3) and velocities (k, 3) of the points in frame 0, from positions q as the
        programs take them and rates (6 + n,).
    characteristic_length : float
        Of the robot [m].
    """

    def __init__(
        self,
        ground: Ground,
        links: Sequence[str],
        kinematics: Callable[[Any, Any], tuple[Any, Any, Any]],
        characteristic_length: float,
    ) -> None:
        self._ground = ground
        self._links = [links.index(name) for name in ground.points]
        self._kinematics = kinematics
        self._max_depth = MAX_CONTACT_DEPTH * characteristic_length
        self._depths: list[Any] = []

    def begin_substep(self) -> None:
        """Clear the recorded depths: another part of a step begins."""
        self._depths = []

    def add_wrenches(self, q: Any, rates: Any, R: Any, P: Any, wrenches: Sequence[Any]) -> list[Any]:
        """Wrenches (6,) on the links, with those of the ground added; the depths are recorded.

        q: positions as the programs take them; rates: (6 + n,); R (3, 3), P (3,): pose of the base in the world.
        """
        rotations, positions, velocities = self._kinematics(q, rates)
        positions = P + positions @ R.T
        velocities = velocities @ R.T
        self._depths.append(self._ground.height - positions[:, 2])
        wrenches = list(wrenches)
        for point, link in enumerate(self._links):
            force = (self._ground.force(positions[point], velocities[point]) @ R) @ rotations[point]
            wrenches[link] = wrenches[link] + np.concatenate([force, np.zeros(3)])
        return wrenches

    def changes_in_substep(self) -> Any:
        """Whether a contact begins or ends within the part of a step.

        A point was then both above the ground and deeper in it than MAX_CONTACT_DEPTH at the stages of the part: the
        slopes of the part do not resolve its force.
        """
        has_changed: Any = False
        for depths in np.array(self._depths).T:
            has_changed = has_changed | ((largest(depths) > self._max_depth) & (largest(-depths) >= 0))
        return has_changed


class PlantKinematics:
    """Kinematics of named links of a Plant, for the coordinates that it uses.

    Parameters
    ----------
    plant : Plant
    names : sequence of str
        Names of k links.
    """

    def __init__(self, plant: Plant, names: Sequence[str]) -> None:
        self._plant = plant
        self._names = names
        self._kinematics: dict[tuple[int, ...] | None, FrameProgram] = {}

    def __call__(self, q: Array, rates: Array) -> tuple[Array, Array, Array]:
        """Rotations (k, 3, 3), positions (k, 3) and velocities (k, 3) in frame 0.

        q: positions as the programs take them; rates: (6 + n,).
        """
        return self.of_coordinates(self._plant.independent)(q, rates)

    def of_coordinates(self, independent: tuple[int, ...] | None) -> FrameProgram:
        """The kinematics for rates of the joints with these numbers; None for those of Dynamics.joint_names."""
        if independent not in self._kinematics:
            self._kinematics[independent] = FrameProgram(self._plant.dynamics, self._names, independent)
        return self._kinematics[independent]
