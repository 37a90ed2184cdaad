"""Where a simulated robot is, and how it moves."""

from dataclasses import dataclass

import numpy as np

from robot_dynamics.simulation.constrained_motion import LoopCoordinates


@dataclass(frozen=True, eq=False)
class SimulationState:
    """The state of a simulation at a time. Arrays of it are not to be written into.

    steps: how many steps led here; time: [s]; pose: (4, 4) of frame 0 in the world; twist: (6,) of the base, [linear;
    angular] in the base frame; positions, velocities: (n,) of Dynamics.joint_names; joint_positions, joint_velocities:
    (all joints,) of all joints, mimic ones and those that loops place too; coordinates: the LoopCoordinates of a robot
    with loops, else None.
    """

    steps: int
    time: float
    pose: np.ndarray
    twist: np.ndarray
    positions: np.ndarray
    velocities: np.ndarray
    joint_positions: np.ndarray
    joint_velocities: np.ndarray
    coordinates: LoopCoordinates | None = None

    def __post_init__(self):
        for array in (self.pose, self.twist, self.positions, self.velocities,
                      self.joint_positions, self.joint_velocities):  # fmt: skip
            array.flags.writeable = False

    @property
    def rates(self):
        """(6 + n,) twist of the base, then the velocities of the independent joints that are integrated."""
        if self.coordinates is None:
            return np.concatenate([self.twist, self.velocities])
        return np.concatenate([self.twist, self.joint_velocities[[*self.coordinates.independent]]])
