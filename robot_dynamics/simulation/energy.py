"""Mechanical energy of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.newton_euler.centroid import first_moments, moving_mass
from robot_dynamics.newton_euler.joint_springs import spring_energy

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot


def kinetic_energy(A: Array, rates: Array) -> float:
    """Kinetic energy [J] of bodies and rotors, from the inertia matrix (m, m) and the last m of the rates."""
    rates = rates[-len(A) :] if len(A) else rates[:0]
    return 0.5 * float(rates @ A @ rates)


def potential_energy(robot: Robot, pose: Array, joint_positions: Array) -> float:
    """Potential energy [J] of weights and springs; that of weights is zero at the origin of the world.

    pose: (4, 4) of the base in the world; joint_positions: (all joints,). The weight of a fixed base does not count.
    """
    moments = pose[:3, :3] @ first_moments(robot, joint_positions) + moving_mass(robot) * pose[:3, 3]
    return float(spring_energy(robot, joint_positions)) - float(robot.gravity @ moments)
