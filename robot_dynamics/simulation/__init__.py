"""Time integration of the direct dynamic models: fixed, free, planar and wheeled bases; ground contact.

`Simulation` is the entry point; the other modules hold its parts, one idea a file.
"""

from robot_dynamics.simulation.ground import Ground
from robot_dynamics.simulation.simulation import Simulation
from robot_dynamics.simulation.simulation_state import SimulationState
from robot_dynamics.simulation.wheels import Wheel

__all__ = ["Ground", "Simulation", "SimulationState", "Wheel"]
