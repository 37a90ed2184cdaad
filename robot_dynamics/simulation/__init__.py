"""Time integration of the direct models: bases that are fixed, fly, slide on a plane or roll on wheels; ground contact.

`Simulation` is the one door; what it is made of stands beside it, one idea a file.
"""

from robot_dynamics.simulation.ground import Ground
from robot_dynamics.simulation.simulation import Simulation
from robot_dynamics.simulation.state import SimulationState
from robot_dynamics.simulation.wheels import Wheel

__all__ = ["Ground", "Simulation", "SimulationState", "Wheel"]
