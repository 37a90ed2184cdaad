"""Efforts that springs and dampers at joints require: k Δq + c q̇ with Δq = q - q₀ (Khalil, section 6)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from robot_dynamics.array_types import ScalarArray
    from robot_dynamics.model.robot import Robot


def spring_force(robot: Robot, q: ScalarArray, qd: ScalarArray) -> ScalarArray:
    """Efforts (..., n) [N m or N] at joint positions q and velocities qd (..., n); zero for joints without a spring.

    The spring of an elastic joint exerts the opposite on the link that it moves.
    """
    springs = [joint.spring for joint in robot.joints]
    if not any(springs):
        return np.zeros_like(q)
    stiffness = np.array([spring.stiffness if spring else 0.0 for spring in springs])
    rest = np.array([spring.rest if spring else 0.0 for spring in springs])
    damping = np.array([spring.damping if spring else 0.0 for spring in springs])
    efforts: ScalarArray = stiffness * (q - rest) + damping * qd
    return efforts


def spring_energy(robot: Robot, q: ScalarArray) -> ScalarArray:
    """Energy (...) that the springs at joints store [J], at positions q (..., joints): k (q - q₀)² / 2."""
    energy: ScalarArray = np.zeros(q.shape[:-1])
    for number, joint in enumerate(robot.joints):
        if joint.spring:
            energy = energy + 0.5 * joint.spring.stiffness * (q[..., number] - joint.spring.rest) ** 2
    return energy
