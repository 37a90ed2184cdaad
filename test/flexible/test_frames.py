"""Frames and linkages against finite-element programs.

OpenSees (the wheels openseespy and openseespylinux; they need libblas3 and liblapack3 of the system): its consistent
mass matrix of a beam has no rotary inertia, and its torsional inertia is that of the torsion constant; so do the beams
here. The frame of test/peers has rotary inertia too.
"""

from importlib import import_module
from itertools import pairwise

import numpy as np
import pytest
from peers.frame import Frame
from scipy.linalg import eigh

from robot_dynamics import Dynamics, InvalidInputError, SingularModelError, load_robot
from robot_dynamics.flexible.elastodynamics import Elastodynamics

HEAD = """
materials: {alloy: {youngs_modulus: 70e9, poissons_ratio: 0.3, density: 2700}}
sections:
  thick: {area: 4e-4, second_moment_y: 5e-8, second_moment_z: 2e-8, torsion_constant: 3e-8, polar_moment: %s}
  thin: {area: 2e-4, second_moment_y: 1e-8, second_moment_z: 8e-9, torsion_constant: 9e-9, polar_moment: %s}
"""
THICK = [4e-4, 5e-8, 2e-8, 3e-8, 7e-8, 70e9, 70e9 / 2.6, 2700.0]
THIN = [2e-4, 1e-8, 8e-9, 9e-9, 1.8e-8, 70e9, 70e9 / 2.6, 2700.0]
TWO_LINKS = """
robot: two_links
joints:
  - joint: shoulder
    link: upper
    mdh: {alpha: 0.3}
    beams: [{to: [0.5, 0, 0], section: thick, material: alloy, elements: 3%s}]
  - joint: elbow
    link: fore
    mdh: {d: 0.5, alpha: pi/2}
    beams: [{to: [0.4, 0, 0], section: thin, material: alloy, elements: 2%s}]
"""
FOUR_BAR = """
robot: four_bar
joints:
  - joint: crank
    link: crank
    beams: [{to: [0.2, 0, 0], section: thick, material: alloy, elements: 2%s}]
  - joint: knee
    link: coupler
    role: passive
    mdh: {d: 0.2}
    initial_position: -0.7
    beams: [{to: [0.5, 0, 0], section: thin, material: alloy, elements: 3%s}]
  - joint: rocker
    link: rocker
    antecedent: base_link
    role: passive
    mdh: {d: 0.45}
    initial_position: 1.4
    beams: [{to: [0.35, 0, 0], section: thin, material: alloy, elements: 2%s}]
loops:
  - joint: pin
    moved: {antecedent: coupler, mdh: {d: 0.5}}
    closed_on: {antecedent: rocker, mdh: {d: 0.35}}
    initial_position: 1
"""


def described(text, rotary):
    polar = (7e-8, 1.8e-8) if rotary else (3e-8, 9e-9)
    option = "" if rotary else ", rotary_inertia: false"
    return Dynamics(load_robot(HEAD % polar + text.replace("%s", option)))


def chain_points(dynamics, q):
    """(points (3,) of base, elbow and tip, z axes of both links) of two links."""
    upper, fore = (dynamics.link_pose(name, q) for name in ("upper", "fore"))
    return upper[:3, 3], fore[:3, 3], fore[:3, 3] + 0.4 * fore[:3, 0], upper[:3, 2], fore[:3, 2]


def linkage_points(dynamics, q):
    crank, coupler, rocker = (dynamics.link_pose(name, q)[:3, 3] for name in ("crank", "coupler", "rocker"))
    return crank, coupler, coupler + 0.5 * dynamics.link_pose("coupler", q)[:3, 0], rocker


ANGLES = [(0.4, 0.9), (-1.1, 2.0)]
CRANKS = [0.9, 2.1, -0.6]


@pytest.mark.parametrize("q", ANGLES)
def test_two_links_agree_with_a_frame_of_beams(q):
    dynamics = described(TWO_LINKS, rotary=True)
    base, elbow, tip, z_upper, z_fore = chain_points(dynamics, q)
    frame = Frame()
    a, b, c = frame.node(base, clamped=True), frame.node(elbow), frame.node(tip)
    frame.beam(a, b, THICK, z_upper, 3)
    frame.beam(b, c, THIN, z_fore, 2)
    actual, expected = dynamics.elastodynamics.frequencies(q), frame.frequencies()
    assert len(actual) == len(expected) == 30
    assert np.abs(actual / expected - 1).max() < 1e-9


def test_moving_base_adds_six_rigid_modes():
    """Six rigid motions have no stiffness; the other frequencies are those of a free frame."""
    q, text = ANGLES[0], HEAD % (7e-8, 1.8e-8) + TWO_LINKS.replace("%s", "")
    dynamics = Dynamics(load_robot(text, moving_base=True))
    base, elbow, tip, z_upper, z_fore = chain_points(described(TWO_LINKS, rotary=True), q)
    frame = Frame()
    a, b, c = frame.node(base), frame.node(elbow), frame.node(tip)
    frame.beam(a, b, THICK, z_upper, 3)
    frame.beam(b, c, THIN, z_fore, 2)
    actual, expected = dynamics.elastodynamics.frequencies(q), frame.frequencies()
    assert not actual[:6].any()
    assert len(actual) == len(expected) == 36
    assert np.abs(actual[6:] / expected[6:] - 1).max() < 1e-8


@pytest.mark.parametrize("q", CRANKS)
def test_hinged_four_bar_agrees_with_a_frame_with_hinges(q):
    dynamics = described(FOUR_BAR, rotary=True)
    ground, knee, pin, foot = linkage_points(dynamics, [q])
    frame = Frame()
    a, b, c = frame.node(ground, clamped=True), frame.node(knee), frame.node(pin)
    d = frame.hinge(frame.node(foot, clamped=True))
    frame.beam(a, b, THICK, elements=2)
    frame.beam(frame.hinge(b), c, THIN, elements=3)
    frame.beam(d, frame.hinge(c), THIN, elements=2)
    actual, expected = dynamics.elastodynamics.frequencies([q]), frame.frequencies()
    assert len(actual) == len(expected)
    assert np.abs(actual / expected - 1).max() < 1e-9


class OpenSees:
    """The finite-element program, with nodes and beams numbered from 1."""

    def __init__(self):
        try:
            self.program = import_module("openseespy.opensees")
        except (ImportError, RuntimeError) as reason:
            pytest.skip(f"OpenSees is not there: {reason}")
        self.program.wipe()
        self.program.model("basic", "-ndm", 3, "-ndf", 6)
        self.nodes = self.elements = 0

    def node(self, position):
        self.nodes += 1
        self.program.node(self.nodes, *map(float, position))
        return self.nodes

    def hinge(self, node, position):
        """Return a node at the same position that may turn about the z axis of the ground."""
        twin = self.node(position)
        self.program.equalDOF(node, twin, 1, 2, 3, 4, 5)
        return twin

    def beams(self, first, second, ends, z, section, elements):
        A, I_y, I_z, I_0, _, E, G, rho = section
        start, end = map(np.asarray, ends)
        nodes = [first, *(self.node(start + (end - start) * k / elements) for k in range(1, elements)), second]
        for a, b in pairwise(nodes):
            self.elements += 1
            self.program.geomTransf("Linear", self.elements, *map(float, z))
            self.program.element("elasticBeamColumn", self.elements, a, b, A, E, G, I_0, I_y, I_z, self.elements,
                                 "-mass", rho * A, "-cMass")  # fmt: skip

    def frequencies(self, count):
        values = np.array(self.program.eigen("-fullGenLapack", count))
        return np.sqrt(np.sort(values)) / (2 * np.pi)


@pytest.mark.parametrize("q", ANGLES)
def test_two_links_agree_with_opensees(q):
    dynamics, peer = described(TWO_LINKS, rotary=False), OpenSees()
    base, elbow, tip, z_upper, z_fore = chain_points(dynamics, q)
    a, b, c = (peer.node(point) for point in (base, elbow, tip))
    peer.program.fix(a, 1, 1, 1, 1, 1, 1)
    peer.beams(a, b, (base, elbow), z_upper, THICK, 3)
    peer.beams(b, c, (elbow, tip), z_fore, THIN, 2)
    actual = dynamics.elastodynamics.frequencies(q, count=10)
    assert np.abs(actual / peer.frequencies(10) - 1).max() < 1e-6


@pytest.mark.parametrize("q", CRANKS)
def test_hinged_four_bar_agrees_with_opensees(q):
    dynamics, peer = described(FOUR_BAR, rotary=False), OpenSees()
    ground, knee, pin, foot = linkage_points(dynamics, [q])
    a, b, c, d = (peer.node(point) for point in (ground, knee, pin, foot))
    peer.program.fix(a, 1, 1, 1, 1, 1, 1)
    peer.program.fix(d, 1, 1, 1, 1, 1, 0)
    z = (0, 0, 1)
    peer.beams(a, b, (ground, knee), z, THICK, 2)
    peer.beams(peer.hinge(b, knee), c, (knee, pin), z, THIN, 3)
    peer.beams(d, peer.hinge(c, pin), (foot, pin), z, THIN, 2)
    actual = dynamics.elastodynamics.frequencies([q], count=10)
    assert np.abs(actual / peer.frequencies(10) - 1).max() < 1e-6


def test_elimination_by_elements_agrees_with_elimination_by_qr():
    """Elimination by QR serves loops that close on rigid links; where both apply they agree."""
    from robot_dynamics.flexible.eigenmodes import natural_frequencies
    from robot_dynamics.flexible.matrices import constrained_matrices, constrained_matrices_by_qr

    dynamics = described(FOUR_BAR, rotary=True)
    structure, q = dynamics.elastodynamics.structure, dynamics.expand_positions([0.9])
    systems = [
        constrained_matrices(structure, dynamics.robot, q),
        constrained_matrices_by_qr(structure, dynamics.robot, q),
    ]
    by_elements, by_numbers = (natural_frequencies(system.mass, system.stiffness) for system in systems)
    assert np.abs(by_elements / by_numbers - 1).max() < 1e-9


def test_loop_that_closes_on_a_rigid_link_agrees_with_a_stiff_frame():
    """The rocker is rigid, with a mass; that of the frame has increasing stiffness."""
    text = FOUR_BAR[: FOUR_BAR.index("  - joint: rocker")] + """
  - joint: rocker
    link: rocker
    antecedent: base_link
    role: passive
    mdh: {d: 0.45}
    initial_position: 1.4
    mass: 0.3
    centre_of_mass: [0.35, 0, 0]
""" + FOUR_BAR[FOUR_BAR.index("loops:") :]  # fmt: skip
    dynamics = described(text, rotary=True)
    points = linkage_points(dynamics, [0.9])
    stiff, stiffer = (linkage_with_a_stiff_rocker(points, factor) for factor in (1e6, 2e6))
    actual = dynamics.elastodynamics.frequencies([0.9], count=10)
    assert np.abs(actual / (2 * stiffer - stiff) - 1).max() < 1e-5  # what is left of 1 / factor falls as its square


def linkage_with_a_stiff_rocker(points, factor):
    ground, knee, pin, foot = points
    frame = Frame()
    a, b, c = frame.node(ground, clamped=True), frame.node(knee), frame.node(pin)
    end = frame.hinge(c)
    frame.beam(a, b, THICK, elements=2)
    frame.beam(frame.hinge(b), c, THIN, elements=3)
    section = [value * factor for value in THIN[:5]]
    frame.beam(frame.hinge(frame.node(foot, clamped=True)), end, [*section, *THIN[5:7], 0.0])
    frame.mass(end, 0.3)
    M, K = frame.matrices()
    return 1 / np.sqrt(eigh(M, K, eigvals_only=True)[:-11:-1]) / (2 * np.pi)  # so stiff, these are the exact ones


def test_elastic_joints_and_lumped_masses_have_their_closed_form():
    """A rigid mass on a spring, and a massless cantilever with F = 3 E I w / L³ at its end."""
    text = """
robot: pendulum
joints:
  - joint: a
    link: bar
    role: elastic
    spring: {stiffness: 50}
    mass: 2
    central_inertia: {zz: 0.1}
    centre_of_mass: [0.3, 0, 0]
"""
    actual = Dynamics(load_robot(text)).elastodynamics.frequencies([0.0])
    assert actual == pytest.approx(np.sqrt(50 / (0.1 + 2 * 0.09)) / (2 * np.pi), rel=1e-12)
    text = """
robot: flagpole
materials: {nothing: {youngs_modulus: 70e9, poissons_ratio: 0.3, density: 0}}
sections: {rod: {circle: {diameter: 0.01}}}
joints:
  - {joint: a, link: pole, beams: [{to: [0.5, 0, 0], section: rod, material: nothing, elements: 2}]}
  - {type: fixed, link: weight, antecedent: pole, mdh: {d: 0.5}, mass: 3}
"""
    result = Dynamics(load_robot(text)).elastodynamics.natural_frequencies([0.0])
    stiffness = 3 * 70e9 * np.pi / 64 * 0.01**4 / 0.5**3
    assert result.frequencies[:2] == pytest.approx(np.sqrt(stiffness / 3) / (2 * np.pi), rel=1e-9)
    assert np.isinf(result.frequencies[3:]).all()
    assert np.sum(np.isfinite(result.frequencies)) == 3  # the weight is a point: it moves by three coordinates


def test_mechanism_has_zero_frequencies_and_no_nan():
    dynamics = described(FOUR_BAR, rotary=True)
    free = Elastodynamics(dynamics, held=[]).natural_frequencies([0.9])
    assert free.frequencies[0] == 0
    assert free.frequencies[1] > 1
    assert np.isfinite(free.frequencies).all()


def test_motion_without_mass_and_stiffness_is_refused():
    text = """
robot: loose
materials: {alloy: {youngs_modulus: 70e9, poissons_ratio: 0.3, density: 2700}}
sections: {rod: {circle: {diameter: 0.01}}}
joints:
  - {joint: a, link: pole, beams: [{to: [0.5, 0, 0], section: rod, material: alloy}]}
  - {joint: b, link: nothing, mdh: {d: 0.5}, role: passive}
"""
    with pytest.raises(SingularModelError, match="neither mass nor stiffness"):
        Dynamics(load_robot(text)).elastodynamics.frequencies([0.0, 0.0])


def test_planar_option_refuses_a_spatial_robot():
    with pytest.raises(InvalidInputError, match="does not move in the plane"):
        Elastodynamics(described(TWO_LINKS, rotary=True), planar=True)
