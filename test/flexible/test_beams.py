"""A clamped beam of an increasing number of elements against closed forms."""

import numpy as np
import pytest
from peers.beams import clamped_free, rayleigh_clamped_free

from robot_dynamics import Dynamics, load_robot
from robot_dynamics.model.beam_sections import circle, rectangle, tube

LENGTH, E, G, RHO = 0.8, 70e9, 26e9, 2700.0
BEAM = """
robot: beam
materials: {{alloy: {{youngs_modulus: 70e9, shear_modulus: 26e9, density: 2700}}}}
sections:
  bar: {{area: 4e-4, second_moment_y: 5e-8, second_moment_z: 2e-8, torsion_constant: 3e-8, polar_moment: 7e-8}}
joints:
  - joint: motor
    link: arm
    beams: [{{to: [0.8, 0, 0], section: bar, material: alloy, elements: {elements}, rotary_inertia: {rotary}}}]
"""


def frequencies_by_kind(elements, rotary):
    """Return {kind: frequencies [Hz]} of a clamped beam; the largest displacement of the end gives the kind."""
    robot = load_robot(BEAM.format(elements=elements, rotary=str(rotary).lower()))
    result = Dynamics(robot).elastodynamics.natural_frequencies(np.zeros(1))
    kinds = {"x": "axial", "y": "bending z", "rz": "bending z", "z": "bending y", "ry": "bending y", "rx": "torsion"}
    frequencies = {}
    for frequency, shape in zip(result.frequencies, result.mode_shapes, strict=True):
        component = result.coordinates[np.argmax(np.abs(shape))].rsplit(".", 1)[1]
        frequencies.setdefault(kinds[component], []).append(frequency)
    return frequencies


@pytest.mark.parametrize("rotary", [False, True])
@pytest.mark.parametrize("kind, second", [("bending z", 2e-8), ("bending y", 5e-8)])
def test_bending_frequencies_converge_from_above(kind, second, rotary):
    """The error falls as h⁴: cubic shape functions give the energy to h⁴."""
    exact = (rayleigh_clamped_free if rotary else clamped_free)(3, LENGTH, E * second, RHO * 4e-4, RHO * second)
    errors = np.array([frequencies_by_kind(elements, rotary)[kind][:3] / exact - 1 for elements in (2, 4, 8, 16)])
    single_error = frequencies_by_kind(1, rotary)[kind][0] / exact[0] - 1
    assert single_error > errors[0, 0] > 0
    assert (errors > 0).all()
    assert (np.diff(errors, axis=0) < 0).all()
    orders = np.log2(errors[1:-1] / errors[2:])
    assert np.abs(orders[-1] - 4).max() < 0.2, orders
    assert errors[2].max() < 1e-3


@pytest.mark.parametrize("kind, speed", [("axial", np.sqrt(E / RHO)), ("torsion", np.sqrt(G * 3e-8 / (RHO * 7e-8)))])
def test_axial_and_torsional_frequencies_converge_from_above(kind, speed):
    """The error falls as h²: linear shape functions."""
    exact = speed / (4 * LENGTH) * np.array([1, 3, 5])
    errors = [
        frequencies_by_kind(elements, True)[kind][: min(3, elements)] / exact[: min(3, elements)] - 1
        for elements in (1, 2, 4, 8, 16)
    ]
    assert all((error > 0).all() for error in errors)
    orders = np.log2(np.array(errors[-2]) / np.array(errors[-1]))
    assert np.abs(orders - 2).max() < 0.1, orders
    assert abs(errors[0][0] - (np.sqrt(3) / (np.pi / 2) - 1)) < 1e-12  # one linear element, by hand


def test_element_matrices_agree_with_the_textbook():
    """Links 1 to 4 of the NaVARo, in the nodal form of finite elements, by the six numbers a node of Przemieniecki."""
    from peers.frame import local_matrices
    from peers.navaro import BAR

    from robot_dynamics.flexible.element import Element

    beam = load_robot("navaro").links[7].flexibility.beams[0]
    element = Element(0.21, beam.section, beam.material)
    nodal = np.zeros((12, 12))  # [t; q_e] from the displacements of both ends
    nodal[:6, :6] = nodal[6:, 6:] = np.eye(6)
    nodal[6:, :6] = -np.eye(6)
    nodal[7, 5], nodal[8, 4] = -0.21, 0.21
    M, K = local_matrices(0.21, *BAR)
    assert np.abs(nodal.T @ element.mass @ nodal - M).max() < 1e-15
    stiffness = nodal[6:].T @ element.stiffness @ nodal[6:]
    assert np.abs(stiffness - K).max() < 1e-14 * np.abs(K).max()
    assert stiffness[4, 10] == pytest.approx(8118.85714, rel=1e-8)
    assert stiffness[1, 5] == pytest.approx(20136.05442, rel=1e-8)


def test_sections():
    """Torsion of rectangles: Timoshenko and Goodier's table, 0.1406 a⁴ of a square and 0.229 a b³ at two to one."""
    square, flat = rectangle(0.02, 0.02), rectangle(0.02, 0.01)
    assert square.torsion_constant == pytest.approx(0.14058 * 0.02**4, rel=1e-4)
    assert flat.torsion_constant == pytest.approx(0.22868 * 0.02 * 0.01**3, rel=1e-4)
    assert rectangle(0.01, 0.024).torsion_constant == pytest.approx(5.902e-9, rel=1e-3)  # Briot, Table 1
    assert flat.second_moment_z == pytest.approx(0.01 * 0.02**3 / 12)  # y is the long side
    assert flat.second_moment_y == pytest.approx(0.02 * 0.01**3 / 12)
    assert circle(0.02).polar_moment == pytest.approx(np.pi / 32 * 0.02**4)
    assert circle(0.02).torsion_constant == pytest.approx(np.pi / 32 * 0.02**4)
    thin = tube(0.02, 1e-6)
    assert thin.second_moment_y == pytest.approx(np.pi * 0.01**3 * 1e-6, rel=1e-3)
    assert thin.area == pytest.approx(2 * np.pi * 0.01 * 1e-6, rel=1e-3)
