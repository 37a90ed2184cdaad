"""Mode shapes as bodies, against closed forms and against the displacements of the nodes."""

import numpy as np
import pytest

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.beam_sections import circle, rectangle
from robot_dynamics.model.loading import read_robot
from robot_dynamics.viewing.mode_geometry import CORNERS, SECTIONS, ModeGeometry, section_size, tube_faces

LENGTH = 1.2
CANTILEVER = f"""
format: 1
robot: cantilever
materials: {{steel: {{youngs_modulus: 210e9, poissons_ratio: 0.3, density: 7850}}}}
sections: {{bar: {{rectangle: {{y: 0.01, z: 0.03}}}}}}
joints:
  - joint: clamp
    link: bar
    beams: [{{to: [{LENGTH}, 0, 0], section: bar, material: steel, elements: 6}}]
"""


@pytest.fixture(scope="module")
def navaro():
    return Dynamics(load_robot("navaro"))


def test_sections_of_a_cantilever_bend_as_the_closed_form():
    """cosh κx - cos κx - σ (sinh κx - sin κx), κL = 1.8751 (Timoshenko, Vibration Problems in Engineering)."""
    elastodynamics = Dynamics(read_robot(CANTILEVER, source="a table")).elastodynamics
    q = np.zeros(1)
    geometry = ModeGeometry(elastodynamics, q)
    displacements = geometry.displacements(elastodynamics.natural_frequencies(q).mode_shapes[0])
    sections = displacements[-6 * SECTIONS :]
    x = np.concatenate([np.linspace(k, k + 1, SECTIONS) for k in range(6)]) * LENGTH / 6
    k = 1.8751040687 / LENGTH
    sigma = (np.cosh(k * LENGTH) + np.cos(k * LENGTH)) / (np.sinh(k * LENGTH) + np.sin(k * LENGTH))
    expected = np.cosh(k * x) - np.cos(k * x) - sigma * (np.sinh(k * x) - np.sin(k * x))
    slope = k * (np.sinh(k * x) + np.sin(k * x) - sigma * (np.cosh(k * x) - np.cos(k * x)))
    across = int(np.argmax(np.abs(sections[-1, :3])))
    assert across == 1  # the thin side of the bar
    factor = sections[-1, 1] / expected[-1]
    assert np.abs(sections[:, 1] - factor * expected).max() < 1e-4 * abs(sections[-1, 1])
    assert np.abs(sections[:, 5] - factor * slope).max() < 1e-3 * np.abs(sections[:, 5]).max()


def test_frames_of_nodes_move_as_the_nodes(navaro):
    elastodynamics = navaro.elastodynamics
    q = navaro.initial_joint_positions
    geometry = ModeGeometry(elastodynamics, q)
    for shape in elastodynamics.natural_frequencies(q, count=6).mode_shapes:
        _, expected = elastodynamics.node_positions(q, shape)
        found = geometry.displacements(shape)[: len(expected), :3]
        assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_elements_that_meet_stay_together(navaro):
    """The last section of an element moves as the node at its end: beams do not tear in the picture."""
    geometry = ModeGeometry(navaro.elastodynamics, navaro.initial_joint_positions)
    shape = navaro.elastodynamics.natural_frequencies(navaro.initial_joint_positions, count=3).mode_shapes[2]
    displacements = geometry.displacements(shape)
    nodes = navaro.elastodynamics.structure.nodes
    ends = [number for number, node in enumerate(nodes) if node.element is not None]
    assert len(ends) > 10
    for place, number in enumerate(ends):
        section = displacements[len(nodes) + (place + 1) * SECTIONS - 1]
        assert np.abs(section - displacements[number]).max() < 1e-9 * np.abs(displacements).max()


def test_vertices_of_a_turning_frame_turn_about_it(navaro):
    geometry = ModeGeometry(navaro.elastodynamics, navaro.initial_joint_positions)
    displacements = np.zeros((geometry.beams.frames.max() + 1, 6))
    displacements[:, 5] = 0.01
    moved = geometry.vertex_displacements(geometry.beams, displacements)
    assert not moved[:, 2].any()
    lengths = np.linalg.norm(moved, axis=1)
    sizes = [section_size(node.element.section) for node in navaro.elastodynamics.structure.nodes if node.element]
    assert lengths.max() <= 0.01 * max(np.linalg.norm(size) / 2 for size in sizes) + 1e-12
    assert geometry.scale(displacements, 0.1) == 0.0


def test_section_has_its_sides_or_those_of_the_same_stiffness():
    assert section_size(rectangle(0.02, 0.05)) == pytest.approx([0.02, 0.05])
    assert section_size(circle(0.04)) == pytest.approx([0.04 * np.sqrt(3) / 2] * 2)


def test_tube_is_closed():
    faces = tube_faces(3)
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
    assert faces.max() == 3 * len(CORNERS) - 1
