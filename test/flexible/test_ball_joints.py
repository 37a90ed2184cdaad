"""Loops that close at ball joints: a Gough-Stewart platform on rods that are elastic along their axes."""

import numpy as np
import pytest
from scipy.linalg import eigh

from robot_dynamics import Dynamics, load_robot, shipped_robots
from robot_dynamics.parallel.platform_dynamics import pose_from_coordinates

AREA, E, LENGTH = 1e-3, 2e11, 0.5
DEFINITIONS = """
materials: {weightless: {youngs_modulus: 2e11, poissons_ratio: 0.3, density: 0}}
sections:
  rod: {area: 1e-3, second_moment_y: 1e-7, second_moment_z: 1e-7, torsion_constant: 2e-7}
"""


@pytest.fixture(scope="module")
def dynamics():
    """The shipped platform with weightless legs, each with half a metre of flexible rod."""
    text = shipped_robots()["gough_stewart"].read_text()
    rod, end = text.index("        mass: m_rod"), text.index("    end: {joint: ball")
    beam = "        beams: [{from: [0, 0, -0.5], to: [0, 0, 0], section: rod, material: weightless}]\n"
    text = text[:rod] + beam + text[end:]
    text = text.replace("\nbase: {", DEFINITIONS + "\nbase: {", 1)
    return Dynamics(load_robot(text, values={"m_tube": 0}))


@pytest.mark.parametrize("x", [(0, 0, 2, 0, 0, 0), (0.1, -0.2, 1.9, 0.1, -0.15, 0.2)])
def test_frequencies_of_a_platform_on_six_springs_have_a_closed_form(dynamics, x):
    """M = diag(m, I), K = Σ k s sᵀ with the line s = [u; r × u] of each leg, k = E A / L; other bodies have no mass."""
    pose = pose_from_coordinates(np.array(x, dtype=float))
    q = dynamics.platform.joint_positions(pose)
    actual = dynamics.elastodynamics.frequencies(q)
    K = np.zeros((6, 6))
    for leg in range(1, 7):
        foot, ball = (dynamics.link_pose(f"{name}_{leg}", q)[:3, 3] for name in ("cross", "rod"))
        direction = (ball - foot) / np.linalg.norm(ball - foot)
        line = np.concatenate([direction, np.cross(ball - pose[:3, 3], direction)])
        K += E * AREA / LENGTH * np.outer(line, line)
    mass = 76e3 / 9.81 * np.pi * 0.05
    inertia = pose[:3, :3] @ np.diag([mass / 12 * (3 + 0.05**2)] * 2 + [mass / 2]) @ pose[:3, :3].T
    M = np.zeros((6, 6))
    M[:3, :3], M[3:, 3:] = mass * np.eye(3), inertia
    expected = np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)
    assert np.abs(actual[:6] / expected - 1).max() < 1e-6
    assert np.isinf(actual[6:]).all()
