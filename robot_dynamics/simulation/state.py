"""Where a simulated robot is, and how it moves."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class SimulationState:
    """The state of a simulation at a time. Arrays of it are not to be written into.

    steps: how many steps led here; time: [s]; pose: (4, 4) of frame 0 in the world; twist: (6,) of the base, [linear;
    angular] in the base frame; positions, velocities: (n,) of Dynamics.joint_names; joint_positions: (all joints,) of
    all joints, mimic ones and those that loops place too.
    """

    steps: int
    time: float
    pose: np.ndarray
    twist: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    joint_positions: np.ndarray

    def __post_init__(self):
        for array in (self.pose, self.twist, self.positions, self.velocities, self.joint_positions):
            array.flags.writeable = False

    @property
    def rates(self):
        """(6 + n,) twist of the base, then the velocities of the joints."""
        return np.concatenate([self.twist, self.velocities])
