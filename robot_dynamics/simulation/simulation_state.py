"""State of a simulated robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.simulation.constrained_motion import LoopCoordinates


@dataclass(frozen=True, eq=False)
class SimulationState:
    """State of a simulation at one time. Its arrays are read-only.

    Attributes
    ----------
    steps : int
        Number of steps since the start.
    time : float
        Simulated time since the start [s].
    pose : ndarray, shape (4, 4)
        Pose of frame 0 in the world, a homogeneous matrix.
    twist : ndarray, shape (6,)
        Twist of the base [linear, m/s; angular, rad/s] at the origin of frame 0, in the base frame.
    positions, velocities : ndarray, shape (n,)
        Joints of Dynamics.joint_names [rad or m; rad/s or m/s].
    joint_positions, joint_velocities : ndarray, shape (all joints,)
        All joints of the robot, mimic joints and dependent joints of loops included.
    coordinates : LoopCoordinates or None
        The independent coordinates of a robot with loops; None without loops.
    """

    steps: int
    time: float
    pose: Array
    twist: Array
    positions: Array
    velocities: Array
    joint_positions: Array
    joint_velocities: Array
    coordinates: LoopCoordinates | None = None

    def __post_init__(self) -> None:
        joint_arrays = (self.positions, self.velocities, self.joint_positions, self.joint_velocities)
        for array in (self.pose, self.twist, *joint_arrays):
            array.flags.writeable = False

    @property
    def rates(self) -> Array:
        """Twist of the base and velocities of the independent joints that are integrated (6 + n,)."""
        if self.coordinates is None:
            return np.concatenate([self.twist, self.velocities])
        return np.concatenate([self.twist, self.joint_velocities[[*self.coordinates.independent]]])
