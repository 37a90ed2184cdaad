"""Mechanical energy of a robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

from robot_dynamics.newton_euler.kinematics import link_placements

if TYPE_CHECKING:
    from robot_dynamics.array_types import Array
    from robot_dynamics.model.robot import Robot


def kinetic_energy(A: Array, rates: Array) -> float:
    """Kinetic energy [J] of bodies and rotors, from the inertia matrix (m, m) and the last m of the rates."""
    rates = rates[-len(A) :] if len(A) else rates[:0]
    return 0.5 * float(rates @ A @ rates)


def potential_energy(robot: Robot, pose: Array, joint_positions: Array) -> float:
    """Potential energy [J] of weights and springs; that of weights is zero at the origin of the world.

    pose: (4, 4) of the base in the world; joint_positions: (all joints,).
    """
    return _weight_energy(robot, pose, joint_positions) + _spring_energy(robot, joint_positions)


def _weight_energy(robot: Robot, pose: Array, joint_positions: Array) -> float:
    energy = 0.0
    for link, (R, P) in zip(robot.links, link_placements(robot, joint_positions), strict=True):
        moments = R @ link.inertia.first_moments + link.inertia.mass * P
        world_moments = pose[:3, :3] @ moments + link.inertia.mass * pose[:3, 3]
        energy -= float(robot.gravity @ world_moments)
    return energy


def _spring_energy(robot: Robot, joint_positions: Array) -> float:
    energies = (
        0.5 * joint.spring.stiffness * (position - joint.spring.rest) ** 2
        for joint, position in zip(robot.joints, joint_positions, strict=True)
        if joint.spring
    )
    return float(sum(energies))
